"""Other programs open the files: as a tree of groups whose datasets share their coordinates, whatever ended the run."""

import numpy as np
import pytest
import xarray
from test_store import AVERAGES, DATASETS, SIZES, STATES
from test_sweepstore import PLAN, VARIABLES

from jaxves.results import hdf5, run_writer
from jaxves.results.sweep_store import Variable, history
from jaxves.results.sweep_writer import SweepWriter

TIMES = np.linspace(0.0, 1.0, SIZES["t"])
HISTORY = {
    name: np.arange(np.prod([SIZES[dim] for dim in dims])).reshape([SIZES[dim] for dim in dims]).astype(dtype)
    for name, (_, _, dims, dtype) in DATASETS.items()
} | {"t": TIMES}


def block(first, last):
    return {name: values[first:last] for name, values in HISTORY.items()}


def new(path):
    return run_writer.Writer(path, scene_text="", attributes={}, times=TIMES, vesicles=2, nodes=8, datasets=DATASETS)


def just_begun(path):
    new(path).close()


def killed(path):
    with new(path) as writer:
        writer.append(block(0, 4), STATES[3])


def killed_twice(path):
    killed(path)
    with run_writer.resume(path, "", TIMES) as writer:
        writer.append(block(4, 5), STATES[4])


def interrupted(path):
    with new(path) as writer:
        writer.append(block(0, 3), STATES[2])
        writer.append(block(3, 4), STATES[3])
        writer.finish("interrupted", "", 1.0, AVERAGES)


def resumed(path):
    interrupted(path)
    with run_writer.resume(path, "", TIMES) as writer:
        writer.append(block(4, 6), STATES[5])
        writer.finish("complete", "", 1.0, AVERAGES)


def with_more_nodes(path):
    with new(path) as writer:
        writer.append(block(0, 1), STATES[0])
        writer.append(block(1, 4), STATES[3] | {"x": np.ones((2, 16, 2))})
        writer.append(block(4, 6), STATES[5] | {"x": np.ones((2, 16, 2))})
        writer.finish("complete", "", 1.0)


def without_a_state(path):
    with new(path) as writer:
        writer.append(block(0, 6), {})
        writer.finish("complete", "", 1.0)


ENDS = {just_begun: 0, killed: 4, killed_twice: 5, interrupted: 4, resumed: 6, with_more_nodes: 6, without_a_state: 6}


@pytest.fixture(params=ENDS, ids=lambda made: made.__name__)
def result(request, tmp_path):
    """A file, and how many of its rows count."""
    request.param(tmp_path / "run.h5")
    return tmp_path / "run.h5", ENDS[request.param]


@pytest.mark.parametrize("engine", ["h5netcdf", "netcdf4"])
def test_a_result_opens_as_a_tree_with_its_times(result, engine):
    path, saved = result
    with xarray.open_datatree(path, engine=engine) as tree:
        assert {"/diagnostics", "/restart/a", "/restart/b"} <= set(tree.groups)
        diagnostics = tree["diagnostics"].to_dataset()
        np.testing.assert_array_equal(diagnostics.t[:saved], TIMES[:saved])
        if saved:
            near = diagnostics["area"].sel(t=0.41, method="nearest")
            np.testing.assert_array_equal(near.sel(vesicle=1), HISTORY["diagnostics/area"][2, 1])
    with xarray.open_dataset(path, group="diagnostics", engine=engine) as data:
        np.testing.assert_array_equal(data.t[:saved], TIMES[:saved])
        assert data.area.dims == ("t", "vesicle") and list(data.xy.values) == ["x", "y"]


def sweep(path, finished):
    kept = {"history/area": Variable("a^2", "area", ("t", "vesicle")), "shape": Variable("a", "x", ("vesicle", "xy"))}
    sizes = {"vesicle": 1, "t": 3, "xy": 2}
    outcome = {
        "class": np.array([b"POP"], "S16"),
        "deformation_final": np.zeros((1, 1)),
        "history/area": np.arange(3.0).reshape(1, 3, 1),
        "shape": np.zeros((1, 1, 2)),
    }
    with SweepWriter.create(path, PLAN, VARIABLES | kept, sizes, {}) as writer:
        writer.write(np.array([3]), ["complete"], 1, outcome)
        if finished:
            writer.finish("complete", 1.0)


@pytest.mark.parametrize("finished", [True, False])
def test_a_sweep_opens_as_a_tree_with_its_axes(tmp_path, finished):
    sweep(tmp_path / "sweep.h5", finished)
    axes = {"field.beta": 2.0, "field.membrane_conductance": 0.1}
    scene = PLAN.sweep_file.scene
    with xarray.open_datatree(tmp_path / "sweep.h5", engine="h5netcdf") as tree:
        area = tree["history"].to_dataset()["area"].sel(axes | {"vesicle": 0})
        np.testing.assert_array_equal(area, np.arange(3.0))
        np.testing.assert_allclose(area.t, scene.t_end * np.arange(3) / scene.saves)
    with xarray.open_dataset(tmp_path / "sweep.h5", group="history", engine="h5netcdf") as data:
        np.testing.assert_array_equal(data.area.sel(axes)[:, 0], np.arange(3.0))
    with pytest.raises(hdf5.StoreError, match="keeps no history of t"):
        history(tmp_path / "sweep.h5", "t", (1, 1))
