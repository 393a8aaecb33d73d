"""What a result file promises: nothing acknowledged is lost, nothing is overwritten by accident, axes have names."""

import random
import re
import subprocess
import sys
import time
from dataclasses import fields

import h5py
import numpy as np
import pytest
import xarray

from jaxves.results.hdf5 import Description, StoreError
from jaxves.results.run_store import HISTORY, read_result, state
from jaxves.results.run_writer import Writer, resume

SCENE = 'β = 1\n"x" = 2'
TIMES = np.linspace(0.0, 1.0, 6)
SIZES = {"t": 6, "vesicle": 2, "node": 8, "xy": 2, "ab": 2}
DATASETS = HISTORY | {
    "diagnostics/area": Description("a^2", "area", ("t", "vesicle")),
    "diagnostics/center": Description("a", "center", ("t", "vesicle", "xy")),
    "diagnostics/stress": Description("1", "stress", ("t", "xy", "ab")),
    "diagnostics/min_gap": Description("a", "smallest gap", ("t",)),
}
STATES = [
    {
        "x": np.full((2, 8, 2), np.pi * k),
        "steps": np.array(k, np.int32),
        "dt[0].next": np.array(0.1 * k),
        "V_m": np.array([1j * k]),
        "first": np.array(k == 0),
        "none": np.zeros((0, 3)),
    }
    for k in range(SIZES["t"])
]
AVERAGES = {"area": np.array([3.0, 3.1]), "stress": np.eye(2)}


@pytest.fixture
def history():
    random_numbers = np.random.default_rng(1)
    return {
        name: (100 * random_numbers.normal(size=[SIZES[dim] for dim in dims])).astype(dtype)
        for name, (_, _, dims, dtype) in DATASETS.items()
    }


def rows(history, start, stop):
    return {name: array[start:stop] for name, array in history.items()}


def new(path, **options):
    datasets = options.pop("datasets", DATASETS)
    return Writer(path, scene_text=SCENE, attributes={}, times=TIMES, vesicles=2, nodes=8, datasets=datasets, **options)


def assert_holds(record, history):
    """The record has exactly these rows."""
    saved = {field.name: getattr(record, field.name) for field in fields(record) if field.name in HISTORY}
    saved |= {f"diagnostics/{name}": array for name, array in record.diagnostics.items()}
    assert saved.keys() == history.keys()
    for name, array in saved.items():
        assert array.dtype == history[name].dtype
        np.testing.assert_array_equal(array, history[name])


def assert_same_leaves(leaves, expected):
    assert leaves.keys() == expected.keys()
    for name, leaf in leaves.items():
        assert (leaf.dtype, leaf.shape) == (expected[name].dtype, expected[name].shape)
        np.testing.assert_array_equal(leaf, expected[name])


def test_what_was_written_is_read(tmp_path, history):
    with new(tmp_path / "run.h5") as writer:
        writer.append(rows(history, 0, 1), STATES[0])
        writer.append(rows(history, 1, 6), STATES[5])
        writer.finish("complete", "nothing to do", 12.5, AVERAGES)
    record = read_result(tmp_path / "run.h5")
    assert_holds(record, history)
    assert (record.status, record.scene) == ("complete", 'β = 1\n"x" = 2')
    assert record.attributes["advice"] == "nothing to do"
    assert record.attributes["wall_time"] == 12.5
    assert record.attributes["schema_version"] == 2
    assert {"version", "jax_version", "jaxlib_version", "numpy_version", "platform"} <= record.attributes.keys()
    assert_same_leaves(record.averages, AVERAGES)
    assert [file.name for file in tmp_path.iterdir()] == ["run.h5"]


def test_a_run_without_a_field_has_no_potential(tmp_path, history):
    datasets = {name: described for name, described in DATASETS.items() if name != "V_m"}
    with new(tmp_path / "run.h5", datasets=datasets) as writer:
        writer.append({name: history[name] for name in datasets}, {})
    record = read_result(tmp_path / "run.h5")
    assert record.V_m is None
    assert record.averages is None
    with h5py.File(tmp_path / "run.h5") as file:
        assert "V_m" not in file


def test_an_unfinished_file_holds_its_rows_and_says_so(tmp_path, history):
    with new(tmp_path / "run.h5") as writer:
        writer.append(rows(history, 0, 4), STATES[3])
    record = read_result(tmp_path / "run.h5")
    assert_holds(record, rows(history, 0, 4))
    assert record.status == "running"
    with h5py.File(tmp_path / "run.h5") as file:
        assert np.isnan(file["x"][4:]).all()


def test_a_finished_file_has_no_empty_rows(tmp_path, history):
    with new(tmp_path / "run.h5") as writer:
        writer.append(rows(history, 0, 2), STATES[1])
        writer.finish("interrupted", "resume", 1.0)
    with h5py.File(tmp_path / "run.h5") as file:
        assert {file[name].shape[0] for name in DATASETS} == {2}


def test_the_time_of_a_run_is_the_sum_of_its_parts_also_of_one_that_was_killed(tmp_path, history):
    path = tmp_path / "run.h5"
    with new(path) as writer:
        writer.append(rows(history, 0, 1), STATES[0], 0.5)
        writer.append(rows(history, 1, 2), STATES[1], 4.0)
    assert read_result(path).attributes["wall_time"] == 4.0
    with resume(path, SCENE, TIMES) as writer:
        writer.append(rows(history, 2, 4), STATES[3], 1.0)
        assert read_result(path).attributes["wall_time"] == 5.0
        writer.finish("interrupted", "resume", 2.0)
    with resume(path, SCENE, TIMES) as writer:
        writer.append(rows(history, 4, 6), STATES[5], 8.0)
        writer.finish("complete", "", 16.0)
    assert read_result(path).attributes["wall_time"] == 22.0


@pytest.mark.parametrize("finished", [True, False])
def test_a_resumed_run_goes_on_where_rows_and_state_agree(tmp_path, history, finished):
    with new(tmp_path / "run.h5") as writer:
        writer.append(rows(history, 0, 1), STATES[0])
        writer.append(rows(history, 1, 2), STATES[1])
        writer.append(rows(history, 2, 4), STATES[3])
        if finished:
            writer.finish("interrupted", "resume", 1.0, AVERAGES)
    leaves, writer = state(tmp_path / "run.h5"), resume(tmp_path / "run.h5", SCENE, TIMES)
    assert_same_leaves(leaves, STATES[3])
    with writer:
        record_while_running = writer.saved
        writer.append(rows(history, 4, 6), STATES[5])
        writer.finish("complete", "", 2.0, {"area": AVERAGES["area"]})
    assert record_while_running == 4
    record = read_result(tmp_path / "run.h5")
    assert_holds(record, history)
    assert record.attributes["wall_time"] == (3.0 if finished else 2.0)
    assert record.averages.keys() == {"area"}


def test_a_state_may_change_its_shapes(tmp_path, history):
    """As it does when the number of nodes is adapted."""
    finer = STATES[4] | {"x": np.ones((2, 16, 2))}
    with new(tmp_path / "run.h5") as writer:
        writer.append(rows(history, 0, 4), STATES[3])
        writer.append(rows(history, 4, 5), finer)
    leaves, writer = state(tmp_path / "run.h5"), resume(tmp_path / "run.h5", SCENE, TIMES)
    writer.close()
    assert_same_leaves(leaves, finer)
    assert_holds(read_result(tmp_path / "run.h5"), rows(history, 0, 5))


def test_a_row_without_its_commit_does_not_count(tmp_path, history):
    """As after a kill between the data and the count: the older state is found with the older rows."""
    with new(tmp_path / "run.h5") as writer:
        for k in range(4):
            writer.append(rows(history, k, k + 1), STATES[k])
    with h5py.File(tmp_path / "run.h5", "r+") as file:
        file.attrs.modify("saved", 3)
    leaves, writer = state(tmp_path / "run.h5"), resume(tmp_path / "run.h5", SCENE, TIMES)
    with writer:
        assert writer.saved == 3
        assert_same_leaves(leaves, STATES[2])
        writer.append(rows(history, 3, 6), STATES[5])
    assert_holds(read_result(tmp_path / "run.h5"), history)


def test_blocks_which_do_not_fit_are_refused(tmp_path, history):
    with new(tmp_path / "run.h5") as writer:
        with pytest.raises(ValueError, match="must hold"):
            writer.append({"t": history["t"]}, {})
        with pytest.raises(ValueError, match=re.escape("x must have shape (6, 2, 8, 2), but has (6, 2, 8, 1)")):
            writer.append(history | {"x": history["x"][..., :1]}, {})
        writer.append(rows(history, 0, 5), {})
        with pytest.raises(ValueError, match="room for 6 times, but gets 7"):
            writer.append(rows(history, 0, 2), {})
    assert_holds(read_result(tmp_path / "run.h5"), rows(history, 0, 5))


def test_an_existing_file_is_refused(tmp_path, history):
    path = tmp_path / "run.h5"
    path.write_bytes(b"precious")
    with pytest.raises(
        StoreError, match=r"run\.h5 exists already: replace it with force=True \(--force on the command line\)"
    ):
        new(path)
    assert path.read_bytes() == b"precious"


def test_force_replaces_only_when_the_new_file_is_complete(tmp_path, history, monkeypatch):
    path = tmp_path / "run.h5"
    path.write_bytes(b"precious")

    def no_space(*arguments):
        raise OSError("file write failed: time = now\n, errno = 28, error message = 'No space left on device', buf")

    with monkeypatch.context() as patch:
        patch.setattr(h5py.Dataset, "make_scale", no_space)
        with pytest.raises(StoreError, match=r"^cannot write .*run\.h5: No space left on device$"):
            new(path, force=True)
    assert path.read_bytes() == b"precious"
    assert list(tmp_path.iterdir()) == [path]
    with path.open("rb") as old:
        new(path, force=True).close()
        assert old.read() == b"precious"  # it lost its name at once, not its content bit by bit
    assert read_result(path).t.shape == (0,)


def test_other_files_are_refused_in_one_line(tmp_path):
    def complaint(path):
        with pytest.raises(StoreError) as caught:
            read_result(path)
        assert "\n" not in str(caught.value)
        return str(caught.value)

    assert complaint(tmp_path / "none.h5").endswith("none.h5 does not exist.")
    (tmp_path / "text.h5").write_text("no")
    assert complaint(tmp_path / "text.h5").endswith("text.h5 is not a jaxves result file.")
    h5py.File(tmp_path / "other.h5", "w").close()
    assert complaint(tmp_path / "other.h5").endswith("other.h5 is not a jaxves result file.")
    new(tmp_path / "later.h5").close()
    with h5py.File(tmp_path / "later.h5", "r+") as file:
        file.attrs["schema_version"] = 3
    assert "later.h5 has schema version 3" in complaint(tmp_path / "later.h5")
    with pytest.raises(StoreError, match="holds no state"):
        new(tmp_path / "empty.h5").close()
        state(tmp_path / "empty.h5")
    with pytest.raises(StoreError, match="cannot write"):
        new(tmp_path / "no such folder" / "run.h5")


@pytest.mark.parametrize("finished", [True, False])
def test_xarray_sees_names_and_coordinates(tmp_path, history, finished):
    with new(tmp_path / "run.h5") as writer:
        writer.append(history, STATES[5])
        if finished:
            writer.finish("complete", "", 1.0, AVERAGES)
    with xarray.open_dataset(tmp_path / "run.h5", engine="h5netcdf") as data:
        assert {name: data[name].dims for name in HISTORY} == {name: HISTORY[name].dims for name in HISTORY}
        np.testing.assert_array_equal(data.t, history["t"])
        np.testing.assert_array_equal(data.x.sel(vesicle=1, xy="y"), history["x"][:, 1, :, 1])
        np.testing.assert_array_equal(data.node, np.arange(8))
        assert data.tension.attrs["units"] == "kappa_B/a^2"
        assert data.attrs["scene"] == 'β = 1\n"x" = 2'
        assert all({"units", "long_name"} <= data[name].attrs.keys() for name in data.variables)
    with xarray.open_dataset(tmp_path / "run.h5", group="diagnostics", engine="h5netcdf") as data:
        for name in data.data_vars:
            assert data[name].dims == DATASETS[f"diagnostics/{name}"].dims
            assert data[name].attrs["long_name"] == DATASETS[f"diagnostics/{name}"].long_name
            np.testing.assert_array_equal(data[name], history[f"diagnostics/{name}"])
        assert set(data.coords) == {"t", "vesicle", "xy", "ab"} and len(data.data_vars) == 4
    if finished:
        with xarray.open_dataset(tmp_path / "run.h5", group="averages", engine="h5netcdf") as data:
            assert (data.area.dims, data.stress.dims) == (("vesicle",), ("xy", "ab"))


ENDLESS_RUN = """
import sys
import numpy as np
from jaxves.results.hdf5 import Description
from jaxves.results.run_store import HISTORY
from jaxves.results.run_writer import Writer

assert "jax" not in sys.modules
saves, M, N = 20_000, 2, 64
sizes = {"t": saves, "vesicle": M, "node": N, "xy": 2}
options = {"scene_text": "", "attributes": {}, "vesicles": M, "nodes": N, "datasets": HISTORY}
with Writer(sys.argv[1], times=np.arange(saves), **options) as writer:
    for k in range(0, saves, 2):
        block = {name: np.stack([np.full([sizes[d] for d in dims[1:]], k + i, dtype) for i in (0, 1)])
                 for name, (_, _, dims, dtype) in HISTORY.items()}
        writer.append(block, {"x": np.full((4, M, N, 2), k + 2.0), "steps": np.array(k + 2)})
        print(k + 2, flush=True)
"""


@pytest.fixture
def endless_run(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", ENDLESS_RUN, tmp_path / "run.h5"], stdout=subprocess.PIPE, text=True
    ) as run:
        yield run
        run.kill()


@pytest.mark.parametrize("seed", range(5))
def test_a_killed_run_leaves_every_acknowledged_row(tmp_path, endless_run, seed):
    chance = random.Random(seed)
    for _ in range(chance.randint(1, 40)):
        acknowledged = int(endless_run.stdout.readline())
    time.sleep(chance.uniform(0, 0.02))
    endless_run.kill()
    acknowledged = int(([acknowledged, *endless_run.stdout])[-1])  # some were printed in the meantime
    endless_run.wait()

    with h5py.File(tmp_path / "run.h5") as file:
        saved = file.attrs["saved"]
        assert saved >= acknowledged
        for name in HISTORY:
            found = file[name][:saved]
            expected = np.arange(saved).reshape([-1] + [1] * (found.ndim - 1))
            np.testing.assert_array_equal(found, np.broadcast_to(expected, found.shape))
    leaves, writer = state(tmp_path / "run.h5"), resume(tmp_path / "run.h5", SCENE, TIMES)
    writer.close()
    assert leaves["steps"] == saved
    np.testing.assert_array_equal(leaves["x"], np.full((4, 2, 64, 2), saved))


def test_a_run_can_be_read_while_it_is_going_on(tmp_path, endless_run):
    """By this package, and by programs that lock what they read; neither disturbs the run."""
    path = tmp_path / "run.h5"
    saved = [int(endless_run.stdout.readline()) for _ in range(3)][-1]
    record = read_result(path)
    assert len(record.t) >= saved
    np.testing.assert_array_equal(record.x[:, 1, 2, 0], np.arange(len(record.t)))
    with xarray.open_datatree(path, engine="h5netcdf") as tree:
        np.testing.assert_array_equal(tree["x"][:saved, 1, 2, 0], np.arange(saved))
        assert tree["x"].sel(t=saved - 1.0).shape == (2, 64, 2)
        later = int(endless_run.stdout.readline())
    assert later > saved and len(read_result(path).t) >= later


def test_a_file_that_another_program_has_open_can_be_continued(tmp_path, history):
    path = tmp_path / "run.h5"
    with new(path) as writer:
        writer.append(rows(history, 0, 4), STATES[3])
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        with resume(path, SCENE, TIMES) as writer:
            writer.append(rows(history, 4, 6), STATES[5])
            writer.finish("complete", "", 1.0)
        np.testing.assert_array_equal(data.x[:4], history["x"][:4])
    assert_holds(read_result(path), history)


FULL_DISK = """
import resource, signal, sys
import numpy as np
from jaxves.results.hdf5 import StoreError
from jaxves.results.run_store import HISTORY, read_result
from jaxves.results.run_writer import Writer

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
path = sys.argv[1]
options = {"scene_text": "", "attributes": {}, "vesicles": 1, "nodes": 1, "datasets": HISTORY}
old = {name: np.zeros((1, *[1] * (len(d.dims) - 1)), d.dtype) for name, d in HISTORY.items()}
old["x"] = np.zeros((1, 1, 1, 2))
with Writer(path, times=np.arange(2), **options) as writer:
    writer.append(old, {})
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
    for attempt in (
        lambda: writer.append(old, {"x": np.zeros(10**5)}),
        lambda: Writer(path, times=np.arange(10**4), force=True, **options),
    ):
        try:
            attempt()
        except StoreError as error:
            print(error)
assert read_result(path).status == "running"
np.testing.assert_array_equal(read_result(path).x, old["x"])
"""


def test_a_full_disk_is_told_in_one_line_and_spoils_nothing(tmp_path):
    """A limit on the size of files fails the writes as a full disk does."""
    run = subprocess.run(
        [sys.executable, "-c", FULL_DISK, tmp_path / "run.h5"], capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr
    assert re.fullmatch(r"(cannot write \S*run\.h5: File too large\n){2}", run.stdout)
    assert [file.name for file in tmp_path.iterdir()] == ["run.h5"]
