"""Sweeps: each case as if it were alone, each with its own end, and all of it again after whatever interrupted it."""

import contextlib
import io
import math
import os
import signal
import subprocess
import sys
import time

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray
from conftest import stored

import jaxves
from jaxves.cli.commands import answer
from jaxves.inputs.checking import SceneError
from jaxves.inputs.sweep_files import parse
from jaxves.results import sweep_store
from jaxves.results.hdf5 import StoreError
from jaxves.runs.build import scene_of
from jaxves.stepping.adaptive import Adaptive
from jaxves.sweeps import batches

BETA, CONDUCTANCE, AREA = "field.beta", "field.membrane_conductance", "vesicle.reduced_area"
SHEAR = "flow.capillary_number"
SCENE = {
    "t_end": 0.02,
    "saves": 4,
    "average": [0.005, 0.02],
    "vesicle": [{"reduced_area": 0.9, "angle": 90.0}],
    "field": {"beta": 3.2, "conductivity_ratio": 0.1},
    "numerics": {"nodes": 32},
}
GRID = {"scene": SCENE, "keep": ["history", "shapes"], "axes": {BETA: [1.0, 3.2, 6.0], CONDUCTANCE: [0.0, 1.0]}}
FILE = """
keep = ["history", "shapes"]
[scene]
t_end = 0.02
saves = 4
average = [0.005, 0.02]
[[scene.vesicle]]
reduced_area = 0.9
angle = 90.0
[scene.field]
beta = 3.2
conductivity_ratio = 0.1
[scene.numerics]
nodes = 32
[axes]
"field.beta" = { start = 0.5, stop = 6.0, num = 12 }
"field.membrane_conductance" = [0.0, 0.5, 1.0, 2.0]
"""


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep") / "whole.h5"
    jaxves.sweep(GRID, path, devices=1, batch=2)
    return path


# --- what a case is -----------------------------------------------------------------------------


def test_a_case_is_what_the_same_scene_gives_alone(whole):
    record = sweep_store.read_sweep(whole)
    assert record.counts() == {"complete": 6}
    scene_file = parse(GRID).scene

    @jax.jit
    def alone(beta, conductance):
        scene = scene_of(scene_file, {BETA: beta, CONDUCTANCE: conductance})
        return jaxves.simulate(scene, 0.02, saves=4, march=Adaptive(1e-4), average=jnp.array([0.005, 0.02]))

    result = alone(3.2, 1.0)
    at = (1, 1)
    assert record.at(at) == {BETA: 3.2, CONDUCTANCE: 1.0}
    assert record.data["steps"][at] == result.state.steps
    close = {"rtol": 1e-9, "atol": 1e-12}
    deformation = result.diagnostics["deformation"]
    np.testing.assert_allclose(record.data["deformation_final"][at], deformation[-1], **close)
    np.testing.assert_allclose(record.data["deformation_min"][at], deformation.min(0), **close)
    np.testing.assert_allclose(record.data["deformation_max"][at], deformation.max(0), **close)
    np.testing.assert_allclose(record.data["deformation_average"][at], result.averages["deformation"], **close)
    np.testing.assert_allclose(sweep_store.history(whole, "deformation", at), deformation, **close)
    np.testing.assert_allclose(sweep_store.history(whole, "x", at), result.x, **close)


def test_charge_relaxation_and_frequency_vary_in_one_program(tmp_path):
    """Both reach each case of an averaged AC field. One program is compiled, which serves other values too."""
    delta, frequency = "field.charge_relaxation", "field.time.frequency"
    field = SCENE["field"] | {
        "beta": 1.0,
        "charge_relaxation": 0.01,
        "time": {"kind": "ac", "averaged": True, "frequency": 1.0},
    }
    vesicle = [{"reduced_area": 0.98, "angle": 45.0}]
    scene = {"t_end": 0.01, "saves": 1, "vesicle": vesicle, "field": field, "numerics": {"nodes": 24}}
    before = batches._compiled.cache_info().misses
    for name, axes in {
        "one": {delta: [0.01, 0.3], frequency: [10.0, 50.0, 200.0]},
        "other": {delta: [0.02, 0.1], frequency: [20.0, 100.0]},
    }.items():
        record = jaxves.sweep({"scene": scene, "axes": axes}, tmp_path / f"{name}.h5", devices=1, batch=3)
        found = record.data["deformation_along_field_final"][..., 0]
        assert np.all(np.isfinite(found)) and np.all(np.abs(np.diff(found, axis=0)) > 1e-6)
        assert np.all(np.abs(np.diff(found, axis=1)) > 1e-6)
    assert batches._compiled.cache_info().misses == before + 1


def test_the_file_opens_in_xarray_as_a_labelled_grid(whole):
    with xarray.open_dataset(whole, engine="h5netcdf") as data:
        assert data.status.dims == (BETA, CONDUCTANCE)
        np.testing.assert_array_equal(data[BETA], [1.0, 3.2, 6.0])
        case = data.sel({BETA: 6.0, CONDUCTANCE: 1.0})
        assert case.status.item() == "complete" and case["class"].item() == "P"
        assert data.deformation_final.dims == (BETA, CONDUCTANCE, "vesicle")
        assert all(data[name].attrs["units"] and data[name].attrs["long_name"] for name in data)
        np.testing.assert_allclose(data.t, np.linspace(0, 0.02, 5), atol=1e-15)
    with xarray.open_dataset(whole, engine="h5netcdf", group="history") as data:
        assert data.x.dims == (BETA, CONDUCTANCE, "t", "vesicle", "node", "xy")


def test_a_case_does_not_depend_on_its_batch(whole, tmp_path):
    jaxves.sweep(GRID, tmp_path / "out.h5", devices=1, batch=4)
    assert stored(tmp_path / "out.h5") == stored(whole)


def test_cases_side_by_side_agree_with_cases_one_by_one(whole, tmp_path):
    record = jaxves.sweep(GRID, tmp_path / "out.h5", devices=1, batch=6, method="vmap")
    reference = sweep_store.read_sweep(whole)
    np.testing.assert_array_equal(record.status, reference.status)
    np.testing.assert_array_equal(record.data["steps"], reference.data["steps"])
    for name in ("deformation_final", "effective_viscosity_average", "tension_max_max"):
        if name in reference.data:
            np.testing.assert_allclose(record.data[name], reference.data[name], rtol=1e-8)


def test_show_and_plot_know_a_sweep_when_they_see_one(whole, tmp_path):
    def call(*arguments):
        with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
            code = answer([str(argument) for argument in arguments])
        return code, out.getvalue(), err.getvalue()

    code, out, _ = call("show", whole)
    assert code == 0 and "cases: 6 complete" in out and "classes: 6 P" in out
    D = sweep_store.history(whole, "deformation_along_field", (2, 0))
    trend = sweep_store.read_sweep(whole).data["deformation_trend"][2, 0]
    np.testing.assert_allclose(trend, 4 * (D[-1] - D[-2]), rtol=1e-9)
    assert "still changing" not in out
    code, _, err = call("plot", whole, "--out", tmp_path / "pop", "--what", "map", "--what", "phases")
    assert code == 0, err
    code, _, err = call("plot", whole, "--out", tmp_path / "pop", "--what", "curves", "--quantity", "max_V_m_max")
    assert code == 0, err
    assert {path.name for path in tmp_path.iterdir()} == {"pop-map.png", "pop-phases.png", "pop-max_V_m_max-curves.png"}
    for arguments, words in ((["--what", "snapshots"], "phases, map or curves"), (["-q", "colour"], "no quantity")):
        code, out, err = call("plot", whole, "--out", tmp_path / "other", *arguments)
        assert code == 2 and out == "" and err.count("\n") == 1 and words in err


# --- each case has its own end ------------------------------------------------------------------


def test_poisoned_cases_are_flagged_and_no_other(tmp_path):
    """NaN, an impossible shape, a field beyond all steps, a film too thin; the rest as if they were not there."""
    scene = SCENE | {
        "saves": 1,
        "vesicle": [{"reduced_area": 0.9}],
        "pair": {"separation": 2.4, "offset_angle": 90.0},
        "flow": {"kind": "extension", "capillary_number": 1.0},
        "numerics": {"nodes": 24, "tolerance": 0.1},
    }
    places = [(1.0, 0.9, 1.0), (math.nan, 0.9, 1.0), (3.2, 0.9, 5.0), (3.2, 1.2, 1.0), (1.0, 0.9, 50.0),
              (1e13, 0.9, 1.0), (1.0, 0.9, 800.0)]  # fmt: skip
    cases = [dict(zip((BETA, AREA, SHEAR), place, strict=True)) for place in places]
    good, nan, impossible, stiff, thin = [0, 2, 4], 1, 3, 5, 6
    record = jaxves.sweep({"scene": scene, "cases": cases}, tmp_path / "out.h5", devices=1, batch=2)
    alone = jaxves.sweep({"scene": scene, "cases": [cases[i] for i in good]}, tmp_path / "alone.h5", devices=1, batch=2)
    assert [i for i, word in enumerate(record.status) if word == "complete"] == good
    assert record.status[nan] == record.status[impossible] == "refused"
    assert "field.beta = nan" in record.reasons[nan] and "(0, 1]" in record.reasons[impossible]
    assert record.status[stiff] in ("step underflow", "not finite") and record.reasons[stiff]
    assert record.status[thin] == "unresolved" and "film" in record.reasons[thin]
    bad = [nan, impossible, stiff, thin]
    assert np.all(record.classes[good] == alone.classes) and np.all(record.classes[bad] == "")
    for name in ("deformation_final", "min_gap_final"):
        np.testing.assert_array_equal(record.data[name][good], alone.data[name])
        assert np.isnan(record.data[name][bad]).all()
    assert np.isfinite(record.data["deformation_max"][[thin]]).all()
    assert np.isnan(record.data["deformation_trend"][bad]).all()


def test_cases_that_need_more_steps_get_them_in_a_second_pass_and_no_more_than_that(whole, tmp_path):
    reference = sweep_store.read_sweep(whole)
    needed = reference.data["steps"] + reference.data["rejected"]
    few, more = np.unique(needed)
    record = jaxves.sweep(GRID | {"max_steps": [int(few), int(more)]}, tmp_path / "out.h5", devices=1, batch=2)
    assert np.all(record.passes == 2)
    enough = needed < more
    np.testing.assert_array_equal(record.status, np.where(enough, "complete", "too many steps"))
    assert np.all(record.classes[~enough] == "")
    for name, values in reference.data.items():
        np.testing.assert_array_equal(record.data[name][enough], values[enough])


def test_a_class_that_is_waited_for_ends_a_case_early(tmp_path):
    scene = SCENE | {"t_end": 0.2, "saves": 20, "stop": {"class": "O", "steady": 1e-9}}
    record = jaxves.sweep({"scene": scene, "axes": {BETA: [0.5, 6.0]}}, tmp_path / "out.h5", devices=1, batch=2)
    assert list(record.status) == ["complete", "class reached"] and list(record.classes) == ["P", "O"]
    assert abs(record.data["t_reached"][0] - 0.2) < 1e-12 and record.data["t_reached"][1] < 0.15


# --- cut off, and gone on with ------------------------------------------------------------------


def check_same(path, other):
    """Names what differs, and how much of it: all bytes of both files would say nothing."""
    found, wanted = stored(path), stored(other)
    assert found.keys() == wanted.keys()
    different = {}
    with h5py.File(path) as one, h5py.File(other) as two:
        for name in [name for name in found if found[name] != wanted[name]]:
            a, b = one[name][()], two[name][()]
            places = np.argwhere(a != b)
            different[name] = [(tuple(map(int, i)), a[tuple(i)], b[tuple(i)]) for i in places[:4]]
    assert different == {}


class Counting:
    """Remembers how many cases were done at each call, and stops the sweep after so many."""

    def __init__(self, stop_at=math.inf):
        self.stop_at, self.done = stop_at, []

    def __call__(self, done, total, text):
        if text == "compiling":
            return
        self.done.append(done)
        if done >= self.stop_at:
            raise KeyboardInterrupt


def test_an_interrupted_sweep_goes_on_where_it_was_with_the_same_bits(whole, tmp_path):
    path = tmp_path / "out.h5"
    with pytest.raises(KeyboardInterrupt):
        jaxves.sweep(GRID, path, devices=1, batch=2, progress=Counting(stop_at=4))
    record = sweep_store.read_sweep(path)
    assert record.attributes["status"] == "interrupted"
    assert record.counts() == {"complete": 4, "pending": 2}
    rest = Counting()
    jaxves.sweep(GRID, path, devices=1, batch=2, resume=True, progress=rest)
    assert rest.done[0] == 4 and rest.done[-1] == 6
    check_same(path, whole)


@pytest.mark.parametrize("missing", [0, 2])
def test_the_command_says_how_many_cases_it_computed_and_how_many_were_there(whole, tmp_path, monkeypatch, missing):
    monkeypatch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", ""))
    path, file = tmp_path / "out.h5", tmp_path / "sweep.toml"
    path.write_bytes(whole.read_bytes())
    with h5py.File(path, "r+") as data:
        file.write_text(data["sweep"].asstr()[()])
        data["status"][-1, :missing] = b"pending"
    with contextlib.redirect_stdout(io.StringIO()) as out:
        code = answer(["sweep", str(file), "--out", str(path), "--resume", "--devices", "1", "--batch", "2"])
    assert code == 0 and f"{missing} cases computed now, {6 - missing} were there" in out.getvalue()
    check_same(path, whole)


def test_a_file_is_resumed_only_with_its_own_sweep_and_not_overwritten(whole, tmp_path):
    before = whole.read_bytes()
    other = GRID | {"axes": {BETA: [1.0]}}
    with pytest.raises(StoreError, match="another sweep"):
        jaxves.sweep(other, whole, resume=True)
    with pytest.raises(StoreError, match=r"force=True \(--force on the command line\)"):
        jaxves.sweep(GRID, whole)
    with pytest.raises(StoreError, match="does not exist"):
        jaxves.sweep(GRID, tmp_path / "none.h5", resume=True)
    assert whole.read_bytes() == before


def test_what_does_not_fit_is_refused_with_what_would(whole, tmp_path, monkeypatch):
    def refused(words, **how):
        with pytest.raises(SceneError, match=words):
            jaxves.sweep(GRID, tmp_path / "out.h5", devices=1, batch=2)

    program = batches.Batches(parse(GRID), (BETA, CONDUCTANCE), jax.local_devices()[:1], batch=2).program
    need = batches._bytes(batches._compiled(program, 2000))
    monkeypatch.setattr(batches, "_free", lambda devices: int(0.6 * need))
    refused(r"batch = 2, expected at most 1: 2 cases at a time need .* GiB")
    monkeypatch.setattr(batches, "_free", lambda devices: int(0.26 * need))
    refused(r"numerics.nodes = 32, expected about 16 or fewer")
    monkeypatch.undo()
    monkeypatch.setattr(sweep_store, "free_bytes", lambda path: 10_000)
    refused(r"6 cases of .* MiB need .* on the disk, .* \d cases would fit")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def start(tmp_path_factory):
    """Starts the command in a folder with the sweep file; compiled programs are shared."""
    folder = tmp_path_factory.mktemp("commands")
    (folder / "sweep.toml").write_text(FILE)
    env = os.environ | {
        "JAX_COMPILATION_CACHE_DIR": str(folder / "cache"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "OPENBLAS_NUM_THREADS": "1",
    }

    def start(out, *arguments):
        command = [sys.executable, "-m", "jaxves", "sweep", "sweep.toml", "--out", out, *map(str, arguments)]
        return subprocess.Popen(command, env=env, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    start.folder = folder
    return start


def finished(process):
    out, err = process.communicate(timeout=600)
    return process.returncode, out, err


def test_a_sweep_killed_at_any_moment_goes_on_and_ends_with_the_bits_of_a_whole_one(start):
    code, _, err = finished(start("whole.h5", "--devices", 1))
    assert code == 0, err
    killed = start.folder / "killed.h5"
    rng = np.random.default_rng()
    acknowledged, kills = 0, 0
    for _ in range(3):
        process = start("killed.h5", "--devices", 1, *(["--resume"] if killed.exists() else []))
        end = time.monotonic() + 600
        while process.poll() is None and time.monotonic() < end:
            with contextlib.suppress(StoreError):
                if np.sum(sweep_store.progress(killed).status != "pending") > acknowledged:
                    break
            time.sleep(0.005)
        time.sleep(rng.uniform(0, 0.3))
        kills += process.poll() is None
        process.kill()
        process.communicate()
        known = int(np.sum(sweep_store.progress(killed).status != "pending"))
        assert known >= acknowledged
        acknowledged = known
    assert kills >= 1
    code, out, err = finished(start("killed.h5", "--devices", 1, "--resume"))
    assert code == 0, err
    assert f"{48 - acknowledged} cases computed now, {acknowledged} were there" in out
    check_same(killed, start.folder / "whole.h5")


@pytest.mark.slow
def test_two_processes_share_a_sweep_and_give_the_bits_of_one(start):
    whole = start.folder / "whole.h5"
    if not whole.exists():
        assert finished(start("whole.h5", "--devices", 1))[0] == 0
    port = 20000 + os.getpid() % 20000
    both = [
        start("two.h5", "--devices", 1, "--coordinator", f"localhost:{port}", "--processes", 2, "--process", p)
        for p in (0, 1)
    ]
    for process in both:
        code, _, err = finished(process)
        assert code == 0, err
    check_same(start.folder / "two.h5", whole)
    assert not list(start.folder.glob("two.h5.*"))


def test_an_interrupt_ends_with_130_and_leaves_what_was_there(start):
    process = start("stopped.h5", "--devices", 1)
    end = time.monotonic() + 600
    while time.monotonic() < end:
        with contextlib.suppress(StoreError):
            if np.any(sweep_store.progress(start.folder / "stopped.h5").status == "complete"):
                break
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    code, _, err = finished(process)
    record = sweep_store.read_sweep(start.folder / "stopped.h5")
    assert (code, record.attributes["status"]) in ((130, "interrupted"), (0, "complete")) and "Traceback" not in err
