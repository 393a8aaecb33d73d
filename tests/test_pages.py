"""The code blocks of the documentation: Python runs, scene and sweep files are valid, commands have these options."""

import inspect
import re
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest
import typer.main

import jaxves
from jaxves.cli import commands
from jaxves.inputs import scene_files, sweep_files
from jaxves.inputs.parameters import with_numbers
from jaxves.inputs.uses import FIT
from jaxves.runs.case import Case

ROOT = Path(__file__).parent.parent
WRITTEN = [
    path
    for path in sorted((ROOT / "docs").rglob("*.md"))
    if "reference" not in path.parts and path.parent.name != "experiments"
]
PAGES = [*WRITTEN, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
SMALL = {"t_end": 0.02, "saves": 2, "numerics": {"nodes": 32, "certify": False}}
POP = {"vesicle": [{"reduced_area": 0.95}], "field": {"beta": 3.2, "conductivity_ratio": 0.1}}


def blocks(language, pages):
    """The blocks of code in a language, each with the name of its page."""
    found = []
    for page in pages:
        text = re.sub(r"(?m)^  (?=\S)", "", page.read_text(encoding="utf-8"))  # blocks in lists
        for block in re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL):
            found.append(pytest.param(block, id=page.stem))
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the files that pages speak of."""
    there = tmp_path_factory.mktemp("pages")
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    np.savetxt(there / "outline.csv", np.stack([1.3 * np.cos(angle), 0.8 * np.sin(angle)], axis=1), delimiter=",")
    outline = np.loadtxt(there / "outline.csv", delimiter=",")
    film = [(frame, *(200 + 100 * point)) for frame in range(12, 16) for point in outline]
    np.savetxt(there / "film.csv", film, delimiter=",", header="frame,x,y", comments="")
    (there / "scene.toml").write_text(scene_files.to_toml(scene_files.parse(POP | SMALL)), encoding="utf-8")
    jaxves.run(POP | SMALL, there / "pop.h5")
    return there


def checked(fit):
    """Takes the place of a fit, which takes minutes and has tests of its own, and checks its numbers and scene."""

    def check(scene_file, bounds, frames, time_unit):
        inspect.signature(fit).bind(scene_file, bounds, frames, time_unit)
        scene = Case.of(scene_file, FIT).scene_file
        assert with_numbers(scene, {name: low for name, (low, _) in bounds.items()})
        assert len(frames.curves) and time_unit > 0

    return check


@pytest.mark.parametrize("block", blocks("python", (p for p in WRITTEN if p.name != "adding-a-number.md")))
def test_python_runs(block, folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    monkeypatch.setattr(jaxves, "fit_frames", checked(jaxves.fit_frames))
    exec(block, {})
    assert "nan" not in capsys.readouterr().out


@pytest.mark.parametrize("block", blocks("toml", PAGES))
def test_a_scene_or_sweep_file_is_valid(block, folder):
    tables = tomllib.loads(block)
    if "axes" in tables:
        (folder / "sweep.toml").write_text(block, encoding="utf-8")
        assert sweep_files.plan(sweep_files.read_sweep_file(folder / "sweep.toml"), origin="sweep")
    else:
        assert scene_files.parse(tables, folder=folder).vesicle


@pytest.mark.parametrize("block", blocks("sh", PAGES))
def test_a_command_has_these_options(block):
    known = typer.main.get_command(commands.app).commands
    for line in re.split(r"&&|\n", block):
        words = shlex.split(line.partition("#")[0].rstrip("& "))
        if "jaxves" in words:
            name, *arguments = words[words.index("jaxves") + 1 :]
            known[name].make_context(name, list(arguments), resilient_parsing=True)
