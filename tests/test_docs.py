"""The website can be built, its references are complete, and the package says who to cite."""

import os
import pickle
import pydoc
import re
import runpy
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from sphinx.search import IndexBuilder

import jaxves
from jaxves.base import physical_numbers
from jaxves.cli import commands
from jaxves.observables.quantities import QUANTITIES

ROOT = Path(__file__).parent.parent
PAGES = str(ROOT / "docs" / "generated_pages.py")


def test_the_website_is_built_without_a_warning(tmp_path):
    """As `docs/website.py` builds it, but pages are read and not written."""
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--quiet", "-b", "dummy", "-c", "docs"]
    quiet = os.environ | {"PYTHONWARNINGS": "ignore"}
    found = subprocess.run([*command, ".", str(tmp_path)], cwd=ROOT, env=quiet, capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    symbols = symbols_of_the_glossary()
    assert len(symbols) > 40 and found_by_search(tmp_path / ".doctrees", "glossary", symbols) == symbols
    assert found_by_search(tmp_path / ".doctrees", "glossary", ["ξ", "length scale"]) == ["length scale"]


def symbols_of_the_glossary() -> list[str]:
    """Returns the symbols of the paper. The length "a" is left out: no search finds an article; its name is found."""
    rows = re.findall(r"^\| ([^|]+) \|", (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8"), re.MULTILINE)
    symbols = [symbol.strip() for row in rows[2:] for symbol in row.replace("\\", "").split(",")]
    return [symbol for symbol in symbols if symbol != "a"]


def found_by_search(doctrees: Path, page: str, queries: list[str]) -> list[str]:
    """Returns the queries with which the search of the website finds a page: all their words are in its index."""
    with open(doctrees / "environment.pickle", "rb") as file:
        index = IndexBuilder(pickle.load(file), "en", {}, "")
    with open(doctrees / "docs" / f"{page}.doctree", "rb") as file:
        index.feed(page, f"{page}.md", page, pickle.load(file))
    known = {word for words in (index._mapping, index._title_mapping) for word in words if page in words[word]}
    words = {
        query: [w.lower() for w in re.findall(r"\w+", query) if w.lower() not in index.lang.stopwords]
        for query in queries
    }
    return [query for query in queries if words[query] and {index.lang.stem(word) for word in words[query]} <= known]


def test_the_references_have_every_key_quantity_command_and_name():
    pages = runpy.run_path(PAGES)["pages"]()
    scene = pages["reference/scene-file.md"]
    assert [n.name for n in physical_numbers.NUMBERS if f"`{n.name}`" not in scene or f"`{n.key}`" not in scene] == []
    assert [name for name in QUANTITIES if f"`/diagnostics/{name}`" not in pages["reference/result-file.md"]] == []
    named = [command.name or command.callback.__name__ for command in commands.app.registered_commands]
    assert [name for name in named if f"## `jaxves {name}`" not in pages["reference/command-line.md"]] == []
    assert [n for n in jaxves.__all__ if n != "plots" and f":: jaxves.{n}" not in pages["reference/python.md"]] == []
    experiments = [name for name in pages if name.startswith("validation/experiments/")]
    assert len(experiments) > 35


@pytest.mark.parametrize("name", ["scene-file", "sweep-file", "result-file"])
def test_the_references_of_files_in_the_repository_are_those_that_their_command_writes(name):
    page = f"reference/{name}.md"
    assert (ROOT / "docs" / page).read_text(encoding="utf-8") == runpy.run_path(PAGES)["pages"]()[page]


def test_every_key_of_a_scene_file_has_a_meaning():
    tables = re.findall(r"^\| `(\w+)` \| ([^|]*) \|", runpy.run_path(PAGES)["scene_file"](), re.MULTILINE)
    assert len(tables) > 40 and [key for key, meaning in tables if not meaning.strip()] == []


def test_every_function_that_a_page_links_to_exists():
    for page in (ROOT / "docs").rglob("*.md"):
        for target in re.findall(r"\{py:\w+\}`([\w.]+)`", page.read_text(encoding="utf-8")):
            assert pydoc.locate(target) is not None, f"{page.name}: {target}"


def without_a_caption(text: str) -> list[str]:
    """Returns the images of a page that lack an alt text, a line of their own, or a next paragraph in italics."""
    captioned = r"^!\[[^\]\n]+\]\(([^)\n]+)\)\n\n\*(?:[^*\n]|\n(?!\n))+\*\s*?(?:\n\n|\Z)"
    found = re.findall(captioned, text, re.MULTILINE)
    return [image for image in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text) if image not in found]


@pytest.mark.parametrize(
    ("text", "lacking"),
    [
        ("![Shapes](a.png)\n\n*Two lines\nof `code`.*\n", []),
        ("![Shapes](a.png)\n\n*One.*\n\n![More](b.gif)\n\n*Two.*\n\nText.\n", []),
        ("![](a.png)\n\n*No alt text.*\n", ["a.png"]),
        ("![Shapes](a.png)\n\nText, not italic.\n", ["a.png"]),
        ("![Shapes](a.png)\n\n**`name`.** The next section.\n", ["a.png"]),
        ("![Shapes](a.png) ![More](b.png)\n\n*One caption for two.*\n", ["a.png", "b.png"]),
    ],
)
def test_an_image_without_a_caption_is_found(text, lacking):
    assert without_a_caption(text) == lacking


def test_every_image_has_an_alt_text_and_a_caption():
    """In the pages of the repository, and in those that are generated from them."""
    files = [ROOT / "README.md", ROOT / "experiments" / "README.md", *(ROOT / "docs").rglob("*.md")]
    pages = {str(file.relative_to(ROOT)): file.read_text(encoding="utf-8") for file in files}
    assert len(re.findall(r"!\[", pages["experiments/README.md"])) > 50
    pages |= {f"docs/{name}": text for name, text in runpy.run_path(PAGES)["pages"]().items()}
    assert {name: lacking for name, text in pages.items() if (lacking := without_a_caption(text))} == {}


def test_the_table_of_experiments_is_what_its_command_prints():
    table = runpy.run_path(str(ROOT / "docs" / "which_experiments.py"))["table"]()
    assert table in (ROOT / "docs" / "which-experiments.md").read_text(encoding="utf-8")


def test_this_software_is_cited_first_and_the_paper_of_the_model_with_it():
    """`preferred-citation` would take the place of the software in "Cite this repository"."""
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert "preferred-citation" not in text
    assert re.search(r"^type: software$", text, re.MULTILINE)
    assert "Electrohydrodynamics of deflated vesicles" in text.partition("references:")[2]


def test_the_version_to_cite_is_the_version_there_is():
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    assert cited[1] == jaxves.__version__
    assert f"## {jaxves.__version__}" in (ROOT / "CHANGELOG.md").read_text()


@pytest.mark.parametrize(("page", "least"), [("architecture.md", 31), ("adding-a-number.md", 12)])
def test_every_file_that_a_page_names_exists(page, least):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    named = set(re.findall(r"`([\w./]+\.(?:py|toml))`", text))
    assert len(named) >= least
    assert [file for file in named if not any((at / file).is_file() for at in (ROOT, ROOT / "jaxves"))] == []


def test_the_page_on_adding_a_number_names_functions_and_classes_that_exist():
    text = (ROOT / "docs" / "adding-a-number.md").read_text(encoding="utf-8")
    source = "".join(file.read_text(encoding="utf-8") for file in (ROOT / "jaxves").rglob("*.py"))
    for name in ("key", "optional_key", "dc_field", "make_scene", "Field", "FieldTable", "VesicleTable", "Number"):
        assert f"`{name}`" in text and re.search(rf"^(?:def|class) {name}\b", source, re.MULTILINE)


def test_the_page_on_the_architecture_has_the_layers_that_are_checked():
    layers = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"][
        0
    ]
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    table = text.partition("## The layers")[2].partition("## The rule")[0]
    assert re.findall(r"^\| `(\w+)` \|", table, re.MULTILINE) == layers["layers"]
