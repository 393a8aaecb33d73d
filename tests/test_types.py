"""Editors and type checkers see the public names of jaxves with their types."""

import ast
import re
from pathlib import Path

import pytest
from mypy import api

import jaxves

STUB = Path(jaxves.__file__).with_suffix(".pyi")
NAMES = sorted(jaxves.__all__)
WRONG = """
result = jaxves.simulate(scene, t_end=0.1, savess=3)
x = jaxves.ellipse("many", 0.9)
Δ: str = jaxves.ellipse(32, 0.9)
jaxves.simulat(scene, t_end=0.1)
"""


@pytest.fixture(scope="module")
def said(tmp_path_factory):
    """What mypy says of a program that asks for the type of every public name, and then makes four mistakes."""
    program = tmp_path_factory.mktemp("types") / "program.py"
    asked = [f"reveal_type(jaxves.{name})" for name in NAMES]
    scene = ["scene = jaxves.make_scene(jaxves.ellipse(32, 0.9))", "reveal_type(jaxves.simulate(scene, 1.0).word)"]
    program.write_text("\n".join(["import jaxves", *asked, *scene]) + WRONG, encoding="utf-8")
    return api.run([str(program), f"--cache-dir={program.parent}", "--no-error-summary"])[0]


def test_every_public_name_has_a_type_and_the_package_has_every_name(said):
    shown = dict(zip([*NAMES, "word"], re.findall(r'Revealed type is "(.*)"', said), strict=True))
    assert [name for name, found in shown.items() if found in ("Any", "builtins.object")] == []
    assert shown["word"] in ("str", "builtins.str")
    imports = [node for node in ast.parse(STUB.read_text()).body if isinstance(node, ast.ImportFrom)]
    assert sorted(alias.name for node in imports for alias in node.names) == NAMES
    assert [name for name in NAMES if not hasattr(jaxves, name)] == []


def test_mistakes_of_a_user_are_found_before_the_program_runs(said):
    kinds = re.findall(r"error: .*\[([\w-]+)\]", said)
    assert kinds == ["call-arg", "arg-type", "assignment", "attr-defined"], said
