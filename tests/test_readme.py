"""The Python of the README runs as it stands."""

import re
from pathlib import Path

import numpy as np
import pytest

import jaxves
from jaxves.base import status

README = Path(__file__).parent.parent / "README.md"


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


@pytest.mark.parametrize("page", ["README.md", "docs/which-experiments.md", "docs/claims.md"])
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


def test_the_readme_lists_every_status_that_a_run_can_end_with():
    text = README.read_text(encoding="utf-8")
    assert [word for word in status.WORDS.values() if word != "running" and f"`{word}`" not in text] == []


def test_every_public_name_is_there_and_one_that_is_not_public_is_not():
    assert [name for name in jaxves.__all__ if getattr(jaxves, name) is None] == []
    assert callable(jaxves.critical_field) and callable(jaxves.steady_shape) and callable(jaxves.fit)
    with pytest.raises(AttributeError, match="marching"):
        jaxves.marching  # noqa: B018
