"""The README is short, its Python runs as it stands, and what pages call and name exists."""

import re
from pathlib import Path

import numpy as np
import pytest

import jaxves
from jaxves.base import status

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
WRITTEN = [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("[hpst]*/*.md")]  # not those that are generated
PAGES = ["README.md", *sorted(str(path.relative_to(ROOT)) for path in WRITTEN)]


def test_the_readme_is_short_and_has_the_commands_to_set_up():
    text = README.read_text(encoding="utf-8")
    assert text.count("\n") <= 130
    assert "python -m venv .venv && . .venv/bin/activate && python -m pip install ." in text
    assert "jaxves run pop --out pop.h5 && jaxves plot pop.h5" in text
    assert 'python -m pip install ".[dev]" && python -m pytest' in text


def test_the_python_of_the_readme_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    names = {}
    for block in blocks:
        exec(block, names)
    printed = capsys.readouterr().out
    assert len(blocks) == 2
    assert printed.startswith("complete")
    D = np.asarray(names["result"].diagnostics["deformation"])[:, 0]
    assert D[0] > 0 > D.min() and D[-1] > 0
    assert np.isfinite(float(printed.splitlines()[-1]))


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_calls_can_be_called(page):
    """Every `jaxves.NAME(` of the page, and every `jaxves.NAME` is there."""
    text = (README.parent / page).read_text(encoding="utf-8")
    for called in re.findall(r"\bjaxves\.([a-z_][\w.]*)\(", text):
        found = jaxves
        for part in called.split("."):
            found = getattr(found, part)
        assert callable(found), called
    for name in re.findall(r"`jaxves\.(\w+)", text):
        assert hasattr(jaxves, name), name


def test_a_page_lists_every_status_that_a_run_can_end_with():
    text = (ROOT / "docs" / "howto" / "status-words.md").read_text(encoding="utf-8")
    assert [word for word in status.WORDS.values() if word != "running" and f"`{word}`" not in text] == []


def test_every_public_name_is_there_and_one_that_is_not_public_is_not():
    assert [name for name in jaxves.__all__ if getattr(jaxves, name) is None] == []
    assert callable(jaxves.critical_field) and callable(jaxves.steady_shape) and callable(jaxves.fit)
    with pytest.raises(AttributeError, match="marching"):
        jaxves.marching  # noqa: B018
