"""Runs that are continued: to a later end, with the bits of a longer run, and only with their own scene."""

import gzip
import shutil
import tomllib
from decimal import Decimal
from importlib.util import find_spec
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray
from conftest import Stops, stored

from jaxves.inputs.scene_files import parse, to_toml
from jaxves.results import run_store, run_writer
from jaxves.results.hdf5 import StoreError
from jaxves.runs import beginning, runner
from jaxves.runs.continuation import differing, is_done, saved_times

SCENE = """
t_end = {t_end}
saves = {saves}
average = [0.02, 0.05]
[[vesicle]]
reduced_area = 0.9
angle = 90.0
[field]
beta = 3.2
conductivity_ratio = 0.1
[numerics]
nodes = {nodes}
certify = false
"""


def pop(t_end=0.06, saves=6, more="", nodes=32):
    return parse(tomllib.loads(SCENE.format(t_end=t_end, saves=saves, nodes=nodes) + more))


# --- what a run may be continued with -----------------------------------------------------------


@pytest.mark.parametrize("spacing", ["0.005", "0.07", "0.1", "3.3e-5"])
def test_saved_times_of_runs_with_one_spacing_have_the_same_bits(spacing):
    """Whatever t_end is, although neither it nor the spacing is a binary number."""
    longest = saved_times(bare(float(2000 * Decimal(spacing)), 2000))
    for saves in (1, 7, 12, 19, 300, 1999):
        t_end = float(saves * Decimal(spacing))
        times = saved_times(bare(t_end, saves))
        assert times[-1] == t_end
        np.testing.assert_array_equal(times, longest[: saves + 1])


def bare(t_end=0.06, saves=6, more=""):
    return parse(tomllib.loads(f"t_end = {t_end!r}\nsaves = {saves}\n[[vesicle]]\nreduced_area = 0.9\n" + more))


def held(path, scene_file, status):
    """A result file of this scene with two rows, as far as one can do without computing them."""
    datasets = {name: described for name, described in run_store.HISTORY.items() if name != "V_m"}
    sizes = {"t": 2, "vesicle": 1, "node": 8, "xy": 2}
    block = {name: np.zeros([sizes[dim] for dim in dims]) for name, (_, _, dims, _) in datasets.items()}
    scene = {"scene_text": to_toml(scene_file), "times": saved_times(scene_file)}
    with run_writer.Writer(path, **scene, attributes={}, vesicles=1, nodes=8, datasets=datasets, force=True) as writer:
        writer.append(block, {"x": np.zeros(3)})
        writer.finish(status, "advice", 1.0)
    return path


@pytest.mark.parametrize(
    ("new", "words"),
    [
        (bare(0.12, 6), "t_end = 0.12 with saves = 6 would not save the times that {path} has: expected saves = 12."),
        (bare(0.06, 12), "t_end = 0.06 with saves = 12 would not save the times that {path} has: expected saves = 6."),
        (bare(0.065, 6), "expected t_end = 0.07 with saves = 7, or another multiple."),
        (bare(0.05, 5), "t_end = 0.05, expected at least 0.06: {path} holds a run to that time."),
        (bare(0.12, 12, "[numerics]\nnodes = 32\n"), "another scene, in which numerics.nodes differs"),
        (bare(0.12, 12, "[numerics]\ntolerance = 1e-3\n"), "another scene, in which numerics.tolerance differs"),
        (bare(0.12, 12, "[stop]\nsteady = 1e-3\n"), "another scene, in which stop.steady differs"),
        (bare(0.06, 6, "angle = 1.0\nbending = 2.0\n"), "in which vesicle[0].angle, vesicle[0].bending differ:"),
    ],
)
def test_a_scene_that_does_not_continue_a_run_is_refused_with_the_keys_and_what_would_fit(tmp_path, new, words):
    path = held(tmp_path / "run.h5", bare(), "complete")
    before = path.read_bytes()
    with pytest.raises(StoreError) as caught:
        is_done(path, new)
    assert words.format(path=path) in str(caught.value) and "\n" not in str(caught.value)
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("word", "new", "done"),
    [
        ("complete", bare(), True),
        ("complete", bare(0.07, 7), False),
        ("interrupted", bare(), False),
        ("interrupted", bare(0.07, 7), False),
        ("running", bare(0.12, 12), False),
        ("too many steps", bare(0.12, 12), False),
        ("steady", bare(0.12, 12), True),
        ("class reached", bare(0.12, 12), True),
        ("complete", bare(more="[numerics]\ncertify = false\n"), True),
    ],
)
def test_what_is_left_to_do_depends_on_how_a_run_ended_and_how_far_it_shall_go(tmp_path, word, new, done):
    assert is_done(held(tmp_path / "run.h5", bare(), word), new) is done


def test_a_run_that_would_break_down_again_is_refused_with_a_later_end_too(tmp_path):
    path = held(tmp_path / "run.h5", bare(), "drift")
    for scene_file in (bare(), bare(0.12, 12)):
        with pytest.raises(StoreError, match="ended with the status 'drift'"):
            is_done(path, scene_file)


def test_scenes_are_compared_by_their_values_and_not_by_their_text(tmp_path):
    """A file that an older version wrote lacks the keys that are new, and may order the others in another way."""
    path = held(tmp_path / "run.h5", bare(), "interrupted")
    with h5py.File(path, "r+") as file:
        file.attrs["scene"] = "saves = 6\nt_end = 6e-2\n[[vesicle]]\nreduced_area = 0.90\n"
    assert is_done(path, bare()) is False
    assert differing(bare(), bare(0.12, 12)) == set()


def test_a_stored_scene_that_this_version_cannot_read_is_named(tmp_path):
    path = held(tmp_path / "run.h5", bare(), "interrupted")
    with h5py.File(path, "r+") as file:
        file.attrs["scene"] = to_toml(bare()) + "[gravity]\ng = 1.0\n"
    with pytest.raises(StoreError, match=r"^cannot resume .*run\.h5: the scene in .*gravity"):
        is_done(path, bare())


# --- runs to a later end ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def longer(tmp_path_factory):
    """A run to t = 0.09 from its start."""
    path = tmp_path_factory.mktemp("longer") / "longer.h5"
    assert runner.run(pop(0.09, 9), path) == "complete"
    return path


def test_a_run_that_is_extended_has_the_bits_of_one_that_was_longer_from_the_start(longer, tmp_path):
    path = tmp_path / "run.h5"
    assert runner.run(pop(0.05, 5), path) == "complete"
    assert runner.run(pop(0.06, 6), path, resume=True) == "complete"  # by one saved time
    assert runner.run(pop(0.09, 9), path, resume=True, progress=Stops(2)) == "interrupted"
    assert stored(path) != stored(longer)
    assert runner.run(pop(0.09, 9), path, resume=True) == "complete"
    assert stored(path) == stored(longer)
    assert parse(tomllib.loads(run_store.read_result(path).scene)) == pop(0.09, 9)


def test_an_interrupted_run_may_be_continued_to_a_later_end(longer, tmp_path):
    path = tmp_path / "run.h5"
    assert runner.run(pop(0.06, 6), path, progress=Stops(3)) == "interrupted"
    assert runner.run(pop(0.09, 9), path, resume=True) == "complete"
    assert stored(path) == stored(longer)


def test_a_continuation_that_fails_or_is_interrupted_before_its_first_step_leaves_the_file_untouched(
    longer, tmp_path, monkeypatch
):
    path = tmp_path / "run.h5"
    shutil.copyfile(longer, path)
    before = path.read_bytes()

    def stopped(*arguments):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(beginning, "problem_of", stopped)
        with pytest.raises(KeyboardInterrupt):
            runner.run(pop(0.1, 10), path, resume=True)
    assert path.read_bytes() == before
    state = run_store.state

    def older(path):
        leaves = state(path)
        return {name: leaf for name, leaf in leaves.items() if name != "last_error"} | {"gone": np.zeros(1)}

    monkeypatch.setattr(run_store, "state", older)
    with pytest.raises(StoreError, match=r"has other parts \(gone, last_error\) than .*\(--from\)\.$"):
        runner.run(pop(0.1, 10), path, resume=True)
    assert path.read_bytes() == before


def test_every_state_of_a_file_opens_in_xarray_as_a_tree_with_times(longer, tmp_path):
    def opens(path, rows):
        for engine in ("h5netcdf", "netcdf4") if find_spec("netCDF4") else ("h5netcdf",):
            with xarray.open_datatree(path, engine=engine) as tree:
                data = tree["diagnostics"].to_dataset()
                assert data["deformation"].sel(t=0.021, method="nearest").t == 0.02
                assert tree["x"].dims == ("t", "vesicle", "node", "xy")
                assert np.isfinite(tree["x"]).all(["vesicle", "node", "xy"]).sum() == rows
            with xarray.open_dataset(path, group="diagnostics", engine=engine) as data:
                assert data["deformation"].sel(t=0.021, method="nearest").t == 0.02

    path = tmp_path / "run.h5"
    opens(longer, 10)
    assert runner.run(pop(0.06, 6), path, progress=Stops(3)) == "interrupted"
    opens(path, 4)
    # As a run leaves it that is killed once it has been continued.
    run_writer.resume(path, to_toml(pop(0.09, 9)), saved_times(pop(0.09, 9))).close()
    opens(path, 4)
    assert runner.run(pop(0.09, 9), path, resume=True) == "complete"
    opens(path, 10)


# --- files of version 0.1.0 ---------------------------------------------------------------------


def old_file(folder: Path, word: str) -> Path:
    """A file that version 0.1.0 wrote."""
    packed = Path(__file__).parent / "data" / f"version-1-{word}.h5.gz"
    path = folder / f"{word}.h5"
    with gzip.open(packed) as source, path.open("wb") as target:
        shutil.copyfileobj(source, target)
    return path


def test_a_file_of_schema_version_1_is_read_and_continued_in_the_present_form(tmp_path):
    complete, path = old_file(tmp_path, "complete"), old_file(tmp_path, "interrupted")
    assert [run_store.read_result(file).status for file in (complete, path)] == ["complete", "interrupted"]
    expected, found = run_store.read_result(complete), run_store.read_result(path)
    assert (len(expected.t), len(found.t), found.attributes["schema_version"]) == (5, 4, 1)
    assert is_done(complete, parse(tomllib.loads(expected.scene)))
    assert runner.run(parse(tomllib.loads(found.scene)), path, resume=True) == "complete"
    found = run_store.read_result(path)
    assert found.attributes["schema_version"] == 2
    np.testing.assert_array_equal(found.x[:4], expected.x[:4])
    np.testing.assert_allclose(found.x[4], expected.x[4], atol=1e-6)  # the tolerance is 1e-3, machines differ
    with xarray.open_datatree(path, engine="h5netcdf") as tree:
        assert tree["diagnostics"].to_dataset()["deformation"].sel(t=0.06).shape == (1,)
