"""Files that `Result.save` wrote, which have no scene: every command works on them or refuses them in one line."""

import contextlib
import io
import warnings
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.cli import long_runs
from jaxves.cli.commands import answer
from jaxves.geometry.outlines import OutlineNoise
from jaxves.inputs.scene_files import parse
from jaxves.plots.forcing import forcing_of


def call(*arguments):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = answer([str(argument) for argument in arguments])
    return code, out.getvalue(), err.getvalue()


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("python")
    field = jaxves.dc_field(beta=3.2, conductivity_ratio=0.1)
    scene = jaxves.make_scene(jaxves.ellipse(16, 0.95, angle=jnp.pi / 2), field=field, flow=jaxves.Shear(1.0))
    jaxves.simulate(scene, 0.01, saves=2, march=jaxves.Fixed(1)).save(folder / "made.h5")
    (folder / "scene.toml").write_text(SCENE)
    return folder / "made.h5"


SCENE = """t_end = 0.01
saves = 1
[[vesicle]]
reduced_area = 0.95
[field]
beta = 3.2
conductivity_ratio = 0.1
[numerics]
nodes = 32
certify = false
"""
WORK = [
    ["show"],
    ["show", "--stability"],
    ["plot", "--what", "snapshots", "--what", "history"],
    ["plot", "--what", "animation"],
    ["export", "--out", "{}.csv"],
    ["export", "--out", "{}.pvd"],
    ["run", "{}/scene.toml", "--out", "{}.h5", "--from"],
]
REFUSED = [
    ["plot", "--what", "streamlines"],
    ["plot", "--what", "field-lines"],
    ["plot", "--what", "phases"],
    ["run", "{}/scene.toml", "--resume", "--out"],
    ["run", "{}/scene.toml", "--out"],
    ["sweep"],
]


def filled(arguments, file, tmp_path):
    found = [text.replace("{}/", f"{file.parent}/").replace("{}", str(tmp_path / "out")) for text in arguments]
    extra = ["--out", tmp_path / "out"] if arguments[0] in ("plot", "sweep") else []
    place = len(found) if arguments[0] == "run" else 1
    return [*found[:place], file, *found[place:], *extra]


@pytest.mark.parametrize("arguments", WORK, ids=" ".join)
def test_what_needs_no_scene_works(arguments, file, tmp_path):
    code, out, err = call(*filled(arguments, file, tmp_path))
    assert code == 0 and out and err == ""
    if arguments[-1] == "--stability":
        assert "stability: not known for a result made in Python" in out


@pytest.mark.parametrize("arguments", REFUSED, ids=" ".join)
def test_what_needs_a_scene_is_refused_in_one_line(arguments, file, tmp_path):
    before = file.read_bytes()
    code, out, err = call(*filled(arguments, file, tmp_path))
    assert code == 2 and out == "" and err.count("\n") == 1 and err.startswith("jaxves: ")
    assert file.read_bytes() == before


def test_a_field_without_a_direction_has_no_arrow_in_figures(file):
    """A field of Python that is not uniform."""
    assert not forcing_of(jaxves.load(file)).is_absent()
    assert forcing_of(SimpleNamespace(scene="[field]\nbeta = 3.2\n")).is_absent()


def test_without_a_terminal_a_long_run_says_how_far_it_is(file, tmp_path, monkeypatch):
    monkeypatch.setattr(long_runs, "_BETWEEN_LINES", 0.0)
    code, out, err = call("run", file.with_name("scene.toml"), "--out", tmp_path / "a.h5")
    assert code == 0 and "jaxves: t = 0.01 of 0.01, " in err and "steps" in err
    longer = tmp_path / "longer.toml"
    longer.write_text(SCENE.replace("t_end = 0.01\nsaves = 1", "t_end = 0.02\nsaves = 2"))
    code, out, _ = call("run", longer, "--out", tmp_path / "a.h5", "--resume")
    assert code == 0 and "continued at t = 0.01 (2 saved times were there)" in out


def test_the_noise_of_an_outline_is_reported_once_at_the_line_that_reads_it():
    theta = 2 * np.pi * np.arange(200) / 200
    noise = 0.005 * np.random.default_rng(3).normal(size=(200, 2))
    points = np.stack([np.cos(theta), 0.7 * np.sin(theta)], axis=-1) + noise
    tables = {"t_end": 1.0, "vesicle": [{"shape": "points", "points": points.tolist()}]}
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", OutlineNoise)
        for _ in range(2):
            parse(tables)
    assert [warning.filename for warning in found] == [__file__]
