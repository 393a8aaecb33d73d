"""The command line: exit status, one line per complaint, files that nothing destroys."""

import contextlib
import io
import math
import os
import signal
import subprocess
import sys
import time
import tomllib

import h5py
import numpy as np
import pytest
import xarray
from conftest import stored
from scipy.special import ellipe

from jaxves.cli.commands import answer
from jaxves.inputs.scene_files import parse, read_scene
from jaxves.results import hdf5, run_store, run_writer
from jaxves.runs import runner

VESICLE = "t_end = 0.05\nsaves = 5\n[[vesicle]]\nreduced_area = 0.9\nangle = 90.0\n"
FIELD = "[field]\nbeta = 3.2\nconductivity_ratio = 0.1\n"
NODES = "[numerics]\nnodes = 32\n"
SCENE = VESICLE + FIELD + NODES


def call(*arguments):
    """Exit status, standard output and standard error of one command, in this process."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = answer([str(argument) for argument in arguments])
    return code, out.getvalue(), err.getvalue()


def assert_refused(result, *words):
    code, out, err = result
    assert code == 2 and out == ""
    assert err.count("\n") == 1 and err.startswith("jaxves: ")
    for word in words:
        assert word in err


# --- bad input ----------------------------------------------------------------------------------

TWO = "t_end = 1.0\n" + "[[vesicle]]\nshape = 'circle'\n" * 2

# (scene, what the complaint must hold: key, value, expected)
BROKEN = [
    ("", "t_end is missing", "positive"),
    ("t_end = 1.0", "vesicle is missing", "[[vesicle]]"),
    (VESICLE.replace("0.05", "-1"), "t_end = -1", "positive"),
    (VESICLE.replace("0.05", "nan"), "t_end = nan", "positive"),
    (VESICLE.replace("0.05", "'soon'"), 't_end = "soon"', "positive"),
    (VESICLE.replace("saves = 5", "saves = 0"), "saves = 0", "whole number >= 1"),
    (VESICLE.replace("saves = 5", "savess = 5"), "savess = 5", "did you mean saves?"),
    ("average = [0.0, 9.0]\n" + VESICLE, "average = [0.0, 9.0]", "t_end = 0.05"),
    (VESICLE.replace("0.9", "1.1"), "vesicle[0].reduced_area = 1.1", "(0, 1]"),
    (VESICLE.replace("0.9", "0.0"), "vesicle[0].reduced_area = 0.0", "(0, 1]"),
    (VESICLE.replace("reduced_area = 0.9", ""), "vesicle[0].reduced_area is missing", "(0, 1]"),
    (VESICLE + "shape = 'triangle'", 'vesicle[0].shape = "triangle"', '"ellipse"'),
    (VESICLE + "bending = -1.0", "vesicle[0].bending = -1.0", "positive"),
    (VESICLE + "center = [0.0]", "vesicle[0].center = [0.0]", "two finite numbers"),
    (VESICLE + "chi = 0.1", "vesicle[0].chi = 0.1", "[field]"),
    (VESICLE.replace("reduced_area = 0.9", "shape = 'points'\nfile = 'none.csv'"), "vesicle[0].file", "No such file"),
    (TWO, "vesicle[1].center = [0.0, 0.0]", "overlap"),
    (VESICLE + "[pair]\nseparation = 0.5", "pair.separation = 0.5", "overlap"),
    (VESICLE + "[field]\nbeta = 3.2", "field.conductivity_ratio is missing", ">= 0"),
    (VESICLE + FIELD + "chi = 0.0", "field.chi = 0.0", "positive"),
    (VESICLE + FIELD + "direction = [0, 0]", "field.direction = [0, 0]", "not both zero"),
    (VESICLE + FIELD + "[field.time]\nkind = 'square'", 'field.time.kind = "square"', '"pulse"'),
    (VESICLE + "[flow]\nkind = 'shear'", "flow.capillary_number is missing", "finite"),
    (VESICLE + "[flow]\nkind = 'linear'\ngradient = [[1, 0], [0, 1]]", "flow.gradient", "trace-free"),
    (VESICLE + "[stop]\nclass = 'POP'", 'stop.class = "POP"', "[field]"),
    (VESICLE + FIELD + "[stop]\nclass = 'Q'", 'stop.class = "Q"', '"POP"'),
    (VESICLE + "[numerics]\nnodes = 31", "numerics.nodes = 31", "even"),
    (VESICLE + "[numerics]\ntolerance = 0.0", "numerics.tolerance = 0.0", "0.1]"),
    (VESICLE + "[numerics]\nmethod = 'rk4'", 'numerics.method = "rk4"', '"ark4"'),
    (VESICLE + "[numerics]\nsolver = 'gmres'", 'numerics.solver = "gmres"', '"dense"'),
    (VESICLE + "[numeric]\nnodes = 32", "numeric", "did you mean numerics?"),
    ("t_end = = 1", "line 1", "TOML"),
    (b"\xff\xfe", "UTF-8", "TOML"),
]


@pytest.mark.parametrize(("scene", "found", "expected"), BROKEN)
def test_a_broken_scene_is_refused_in_one_line_and_nothing_is_written(tmp_path, scene, found, expected):
    path, out = tmp_path / "scene.toml", tmp_path / "out.h5"
    path.write_bytes(scene if isinstance(scene, bytes) else scene.encode())
    assert_refused(call("run", path, "--out", out), str(path), found, expected, "expected")
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "pop"], "--out"),
        (["run", "--out", "x.h5"], "issing argument"),
        (["run", "popp", "--out", "x.h5"], "did you mean pop?"),
        (["run", ".", "--out", "x.h5"], "directory"),
        (["run", "pop", "--out", "no/such/folder/x.h5"], "no/such/folder"),
        (["run", "pop", "--out", "x.h5", "--resume"], "x.h5 does not exist"),
        (["run", "pop", "--out", "x.h5", "--resume", "--force"], "one of them"),
        (["run", "pop", "--out", "x.h5", "--fast"], "--fast"),
        (["simulate"], "simulate"),
        (["show", "absent.h5"], "absent.h5 does not exist"),
        (["plot", "absent.h5"], "absent.h5 does not exist"),
        (["plot", "absent.h5", "--what", "poster"], "poster"),
        (["units", "--a", "1e-5"], "--E"),
    ],
)
def test_a_wrong_command_is_refused_in_one_line(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    assert_refused(call(*arguments), words)
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_result_file_is_refused(tmp_path):
    text, foreign = tmp_path / "text.h5", tmp_path / "foreign.h5"
    text.write_text("no HDF5")
    h5py.File(foreign, "w").close()
    for path in (text, foreign):
        for command in (["show", path], ["plot", path], ["run", "pop", "--out", path, "--resume"]):
            assert_refused(call(*command), str(path), "not a jaxves result file")


@pytest.mark.parametrize("out", [".", "", "..", "/", "folder", "device", "link"])
@pytest.mark.parametrize("how", [[], ["--force"], ["--resume"]])
def test_what_is_there_and_no_file_is_never_replaced(tmp_path, monkeypatch, out, how):
    """Root could replace /dev/null itself."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "device")
    (tmp_path / "link").symlink_to("folder")
    before = sorted(tmp_path.iterdir())
    words = "is no ordinary file" if out == "device" else "is a folder"
    assert_refused(call("run", "pop", "--out", out, *how), words, "expected the name of")
    assert_refused(call("show", out), words)
    with pytest.raises(hdf5.StoreError, match=words):
        runner.run(parse(tomllib.loads(SCENE)), out, force=how == ["--force"], resume=how == ["--resume"])
    assert sorted(tmp_path.iterdir()) == before


def test_an_existing_file_is_left_alone_without_force(tmp_path):
    out = tmp_path / "thesis.h5"
    out.write_text("precious")
    assert_refused(call("run", "pop", "--out", out), str(out), "--force")
    scene = tmp_path / "scene.toml"
    scene.write_text("mine")
    assert_refused(call("init", scene), str(scene), "--force")
    assert (out.read_text(), scene.read_text()) == ("precious", "mine")
    assert len(list(tmp_path.iterdir())) == 2


def test_bad_input_is_answered_without_importing_jax(tmp_path):
    (tmp_path / "bad.toml").write_text(VESICLE.replace("0.9", "1.1"))
    for arguments in (["run", "bad.toml", "--out", "x.h5"], ["run", "pop"], ["scenes"], ["show", "x.h5"], ["--help"]):
        code = (
            f"import sys\nfrom jaxves.cli.commands import answer\nanswer({arguments})\nsys.exit('jax' in sys.modules)"
        )
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=False)
        assert done.returncode == 0, (arguments, done.stderr)


# --- commands that compute nothing --------------------------------------------------------------


@pytest.mark.parametrize("command", [[], ["run"], ["sweep"], ["show"], ["plot"], ["scenes"], ["init"], ["units"]])
def test_every_command_has_help(command):
    code, out, err = call(*command, "--help")
    assert code == 0 and err == "" and "Usage: jaxves" in out


def test_without_a_command_there_is_help_and_the_version_is_told():
    code, out, _ = call()
    assert code == 0 and all(name in out for name in ("run", "sweep", "show", "plot", "scenes", "init", "units"))
    assert call("--version")[:2] == (0, f"{run_writer.version('jaxves')}\n")


def test_the_built_in_scenes_are_listed():
    code, out, _ = call("scenes")
    assert code == 0 and {"pop", "budding", "shear", "chain"} <= {line.split()[0] for line in out.splitlines()}


def test_init_writes_a_scene_that_can_be_read(tmp_path):
    path = tmp_path / "mine.toml"
    code, out, _ = call("init", path)
    assert code == 0 and f"jaxves run {path}" in out
    scene_file = parse(tomllib.loads(path.read_text()))
    assert scene_file.field.beta == 3.2 and scene_file.stop is None
    # What it shows behind a # is valid as well, but for the step, of which there is a choice.
    _, _, text = path.read_text().partition("\n\n")
    lines = [line.removeprefix("# ") for line in text.splitlines()]
    kept = [line for line in lines if not line.startswith(("time_step", "conductivity_ratio, ", "viscosity_ratio: "))]
    full = parse(tomllib.loads("\n".join(kept)))
    assert full.pair.separation == 2.6 and full.field.time.kind == "pulse" and full.stop.class_ == "POP"
    assert call("init", path, "--force")[0] == 0


LAB = {
    "a": 1e-5, "E": 1e5, "sigma-i": 1e-4, "sigma-e": 1e-3, "epsilon": 7e-10, "C-m": 1e-2, "kappa-B": 1e-19, "mu": 1e-3,
    "G-m": 0.0, "shear-rate": 2.0,
}  # fmt: skip


def options(**changed):
    return [text for name, value in (LAB | changed).items() for text in (f"--{name}", repr(value))]


def test_units_prints_numbers_scales_and_tables_for_a_scene():
    code, out, _ = call("units", *options())
    assert code == 0
    tables = tomllib.loads("[field]" + out.partition("[field]")[2])
    a, E, sigma_e, epsilon, C_m, kappa_B, mu = (
        LAB[k] for k in ("a", "E", "sigma-e", "epsilon", "C-m", "kappa-B", "mu")
    )
    exact = {
        "beta": epsilon * E**2 * a * C_m / (mu * sigma_e),
        "chi": C_m * kappa_B / (sigma_e * mu * a**2),
        "conductivity_ratio": 0.1,
        "membrane_conductance": 0.0,
    }
    assert tables["field"] == pytest.approx(exact, rel=1e-12)
    assert tables["flow"] == {"kind": "shear", "capillary_number": pytest.approx(mu * 2.0 * a**3 / kappa_B)}
    assert f"{mu * a**3 / kappa_B:.6g}" in out
    parse(tomllib.loads(VESICLE) | tables)
    assert "[flow]" not in call("units", *options(**{"shear-rate": 0.0}))[1]
    # β/χ = 7e4 at 1.5 V: a giant vesicle in a strong field, which the model does not describe.
    assert f"{epsilon * E**2 * a**3 / kappa_B:.3g}" in out
    warned = [line.split(":")[0] for line in out.splitlines() if line.startswith("! ")]
    assert warned == ["! Inertia", "! Poration"]
    assert "! " not in call("units", *options(E=1e3))[1]
    assert "! Wrinkles" in call("units", *options(E=3e5))[1]


@pytest.mark.parametrize("changed", [{}, {"E": 0.0}, {"E": 0.0, "shear-rate": 0.0}, {"E": 1e3, "sigma-i": 0.0}])
def test_units_writes_a_scene_with_its_numbers(changed, tmp_path):
    """In a strong field and shear, in shear alone, at rest, and where the membrane is never charged."""
    path = tmp_path / "laboratory.toml"
    code, out, _ = call("units", *options(**changed), "--reduced-area", "0.95", "--out", str(path))
    assert code == 0 and f"jaxves run {path} --out {path.with_suffix('.h5')}\n" in out
    scene = read_scene(path)
    assert scene.vesicle[0].reduced_area == 0.95 and scene.numerics.nodes == "auto" and 0 < scene.t_end < 1e3
    assert (scene.field is None) == (changed.get("E") == 0.0)
    assert (scene.flow is None) == (changed.get("shear-rate") == 0.0)
    assert (scene.vesicle[0].disturbance is not None) == (changed == {})
    assert call("units", *options(), "--out", str(path))[0] == 2


@pytest.mark.parametrize("value", ["0", "1", "1.2", "nan", "-0.5"])
def test_units_refuses_a_reduced_area_that_no_vesicle_has(value):
    code, out, err = call("units", *options(), "--reduced-area", value)
    assert code == 2 and out == "" and "--reduced-area" in err and "> 0 and < 1" in err


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [("a", 0.0, "> 0"), ("mu", -1.0, "> 0"), ("E", -1.0, ">= 0"), ("C-m", math.nan, "finite")],
)
def test_units_refuses_what_no_vesicle_has(name, value, words):
    assert_refused(call("units", *options(**{name: value})), f"--{name} = {value}", words)


# --- one small run, and what is made of it ------------------------------------------------------


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp("result")
    (folder / "scene.toml").write_text(SCENE)
    path = folder / "out.h5"
    code, out, err = call("run", folder / "scene.toml", "--out", path)
    assert code == 0, err
    assert "complete at t = 0.05" in out and "class: P at t_end, still changing (in as much time again, by " in out
    assert len(out.splitlines()) == 6 and f"`jaxves show {path}`" in out
    return path


def test_a_result_is_shown_in_a_few_lines(result):
    code, out, _ = call("show", result)
    assert code == 0 and len(out.splitlines()) < 20
    for words in (
        "complete",
        "class: P at t_end, still changing",
        "kept symmetric",
        "1 vesicle of 32 nodes, 6 saved times",
        "deformation",
        "correct digits; the weakest link is",
        ", area ",
        ", energy ",
    ):
        assert words in out


def test_a_result_opens_in_xarray_with_its_labels(result):
    with xarray.open_dataset(result) as data:
        assert data.x.dims == ("t", "vesicle", "node", "xy") and data.x.shape == (6, 1, 32, 2)
        np.testing.assert_allclose(data.t, np.linspace(0, 0.05, 6), atol=1e-15)
        assert data.attrs["status"] == "complete"
        assert parse(tomllib.loads(data.attrs["scene"])) == parse(tomllib.loads(SCENE))
    with xarray.open_dataset(result, group="diagnostics") as data:
        assert {"area", "inclination", "dipole", "min_gap"} - set(data) <= {"min_gap"}
        assert all(data[name].attrs["units"] and data[name].attrs["long_name"] for name in data)


def test_a_finished_run_is_told_to_have_nothing_to_resume(result):
    before = result.read_bytes()
    code, out, _ = call("run", result.with_name("scene.toml"), "--out", result, "--resume")
    assert code == 0 and "nothing to resume" in out
    assert_refused(call("run", "pop", "--out", result, "--resume"), "another scene")
    assert_refused(call("run", result.with_name("scene.toml"), "--out", result), "--force")
    assert result.read_bytes() == before


def test_all_kinds_of_pictures_are_drawn_and_none_is_overwritten(result, tmp_path):
    kinds = ["snapshots", "history", "streamlines", "field-lines", "animation"]
    wanted = [text for kind in kinds for text in ("--what", kind)]
    arguments = ["plot", result, *wanted, "--at", "0.03", "--out", tmp_path / "pop"]
    code, _, err = call(*arguments)
    assert code == 0, err
    pictures = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert set(pictures) == {f"pop-{kind}.{'gif' if kind == 'animation' else 'png'}" for kind in kinds}
    assert all(picture[:4] in (b"\x89PNG", b"GIF8") for picture in pictures.values())
    assert_refused(call(*arguments), "--force")
    assert_refused(call("plot", result, "--at", "7.0"), "--at = 7.0", "[0, 0.05]")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == pictures


ELLIPSE_RADIUS = 1.6 * 4 * ellipe(1 - 1 / 1.6**2) / (2 * math.pi)


def test_points_in_either_sense_give_the_same_run(tmp_path):
    alpha = 2 * np.pi * np.arange(24) / 24
    points = np.stack([np.cos(alpha), 1.6 * np.sin(alpha)], axis=-1)
    shapes = []
    for name, order in {"one": points, "other": points[::-1]}.items():
        np.savetxt(tmp_path / f"{name}.csv", order, delimiter=",")
        scene = SCENE.replace("reduced_area = 0.9\nangle = 90.0", f"shape = 'points'\nfile = '{name}.csv'")
        (tmp_path / f"{name}.toml").write_text(scene)
        code, said, err = call("run", tmp_path / f"{name}.toml", "--out", tmp_path / f"{name}.h5")
        assert code == 0, err
        assert f"perimeter / 2π = {ELLIPSE_RADIUS:.4g} in the units of its points, scaled to 1 a; " in said
        shapes.append(run_store.read_result(tmp_path / f"{name}.h5").x)
    np.testing.assert_array_equal(shapes[0], shapes[1])


def test_a_run_that_breaks_down_ends_with_3_and_keeps_its_rows(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE.replace("0.9", "0.4").replace("0.05\nsaves = 5", "0.6\nsaves = 60"))
    out = tmp_path / "out.h5"
    code, said, _ = call("run", tmp_path / "scene.toml", "--out", out)
    record = run_store.read_result(out)
    assert code == 3 and record.status in said and record.attributes["advice"] in said
    assert record.status not in ("complete", "running") and 1 <= len(record.t) <= 60
    assert "class" not in said and "class" not in call("show", out)[1]
    assert_refused(call("run", tmp_path / "scene.toml", "--out", out, "--resume"), record.status)


# --- runs that are cut off ----------------------------------------------------------------------

LONG = SCENE.replace("t_end = 0.05\nsaves = 5", "t_end = 0.5\nsaves = 3000")


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    """Starts the installed command; compiled programs are shared."""
    cache = tmp_path_factory.mktemp("cache")
    env = os.environ | {
        "JAX_COMPILATION_CACHE_DIR": str(cache),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "OPENBLAS_NUM_THREADS": "1",
    }

    def start(*arguments):
        command = [sys.executable, "-m", "jaxves", *map(str, arguments)]
        return subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    return start


def wait_for(process, out, rows):
    """Until the file has so many rows; returns the record."""
    end = time.monotonic() + 120
    while time.monotonic() < end:
        assert process.poll() is None, process.communicate()
        if out.exists() and len((record := run_store.read_result(out)).t) >= rows:
            return record
        time.sleep(0.02)
    raise TimeoutError


def finished(process):
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def test_runs_killed_and_interrupted_leave_whole_files_and_a_resumed_one_has_the_bits_of_a_whole_run(start, tmp_path):
    scene = tmp_path / "long.toml"
    scene.write_text(LONG)
    whole, killed, stopped = (tmp_path / f"{name}.h5" for name in ("whole", "killed", "stopped"))
    assert finished(start("run", scene, "--out", whole))[0] == 0
    complete = run_store.read_result(whole)

    process = start("run", scene, "--out", killed)
    acknowledged = wait_for(process, killed, 60)
    process.kill()
    assert finished(process)[0] == -signal.SIGKILL
    record = run_store.read_result(killed)
    assert record.status == "running" and 60 <= len(acknowledged.t) <= len(record.t) < 3001
    np.testing.assert_array_equal(record.x, complete.x[: len(record.t)])
    assert "--resume" in call("show", killed)[1]
    seconds = record.attributes["wall_time"]
    assert seconds > 0 and f" after {seconds:.1f} s" in call("show", killed)[1]

    process = start("run", scene, "--out", stopped)
    wait_for(process, stopped, 60)
    process.send_signal(signal.SIGINT)
    code, out, err = finished(process)
    record = run_store.read_result(stopped)
    assert code == 130 and "interrupted at t = " in out and "Traceback" not in err
    assert record.status == "interrupted" and 60 <= len(record.t) < 3001

    process = start("run", scene, "--out", stopped, "--resume")
    wait_for(process, stopped, len(record.t) + 60)
    for _ in range(2):
        process.send_signal(signal.SIGTERM)
    code, out, err = finished(process)
    terminated = run_store.read_result(stopped)
    assert code == 143 and "interrupted at t = " in out and "Traceback" not in err
    assert terminated.status == "interrupted" and len(record.t) + 60 <= len(terminated.t) < 3001

    code, out, err = finished(start("run", scene, "--out", killed, "--resume"))
    assert code == 0, err
    assert stored(killed) == stored(whole)
    record = run_store.read_result(killed)
    assert record.status == "complete" and record.attributes["wall_time"] > seconds


@pytest.mark.parametrize(("signum", "expected"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_before_anything_is_computed_leaves_no_file(start, tmp_path, signum, expected):
    out = tmp_path / "out.h5"
    process = start("run", "pop", "--out", out)
    time.sleep(1.5)
    process.send_signal(signum)
    code, _, err = finished(process)
    assert code == expected and "Traceback" not in err
    assert not out.exists() or len(run_store.read_result(out).t) > 0
