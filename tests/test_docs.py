"""The API reference can be built, and the package says who to cite."""

import re
import runpy
import tomllib
from pathlib import Path

import pytest

import jaxves

ROOT = Path(__file__).parent.parent


def test_the_api_reference_has_a_page_for_each_module(tmp_path):
    runpy.run_path(str(ROOT / "docs" / "api.py"))["build"](tmp_path)
    package = ROOT / "jaxves"
    modules = [file.relative_to(package).with_suffix("") for file in package.glob("*/*.py")]
    pages = [f"{module.parent if module.name == '__init__' else module}.html" for module in modules]
    assert len(pages) > 100 and [page for page in pages if not (tmp_path / "jaxves" / page).exists()] == []
    assert "Runs a scene to" in (tmp_path / "jaxves.html").read_text()


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
