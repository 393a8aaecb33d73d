"""The motion in shear of the cases of a sweep and of a run, as files and summaries have it."""

import numpy as np
import pytest

import jaxves
from jaxves.cli import run_summary, sweep_summary
from jaxves.inputs.scene_files import parse, to_toml
from jaxves.observables import shear_motion
from jaxves.results import sweep_store
from jaxves.results.run_store import Record
from jaxves.sweeps import motions

SCENE = {
    "t_end": 2.0,
    "saves": 50,
    "vesicle": [{"reduced_area": 0.95, "angle": 20.0}],
    "fluid": {"viscosity_ratio": 1.0},
    "flow": {"kind": "shear", "capillary_number": 10.0},
    "numerics": {"nodes": 24, "time_step": 0.02},
}
RATIO = "fluid.viscosity_ratio"


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    path = tmp_path_factory.mktemp("motions") / "sweep.h5"
    record = jaxves.sweep({"scene": SCENE, "keep": ["history"], "axes": {RATIO: [1.0, 30.0]}}, path)
    return record, path


def test_a_sweep_has_the_motion_of_each_case(swept):
    record, path = swept
    assert record.motions.tolist() == ["treading", "tumbling"]
    t = SCENE["t_end"] * np.arange(51) / 50
    angle = sweep_store.history(path, "inclination_unwrapped", (1,))[:, 0]
    viscosity = sweep_store.history(path, "effective_viscosity", (1,))
    turning = shear_motion.half_turns(t, angle)
    np.testing.assert_allclose(record.data["half_turn"][:, 0], [np.nan, turning.period])
    mean = shear_motion.average(t, angle, viscosity, len(turning.times) - 1)
    np.testing.assert_allclose(record.data["effective_viscosity_tumbling"], [np.nan, mean])
    assert "motions in shear: 1 treading, 1 tumbling" in list(sweep_summary.summary(record, path))
    assert record.to_xarray()["motion"].values.tolist() == record.motions.tolist()


def test_a_run_is_shown_with_its_motion(swept):
    """A record with the time series of the sweep, whose ratio is that of the scene or of the vesicle."""
    _, path = swept
    t = SCENE["t_end"] * np.arange(51) / 50

    def words(case, vesicle, drift=0.0):
        names = ("inclination_unwrapped", "effective_viscosity")
        found = {name: sweep_store.history(path, name, (case,)) for name in names}
        found["inclination_unwrapped"] = found["inclination_unwrapped"] + drift * t[:, None]
        shapes = np.zeros((51, 1, 4, 2)), None, np.zeros((51, 1, 4)), np.full((51, 1), 4), np.arange(51), {}
        scene = to_toml(parse(SCENE | {"vesicle": [SCENE["vesicle"][0] | vesicle]}))
        return run_summary.motion_words(Record(t, *shapes, found, None, {}, "complete", scene))

    angle = np.degrees(sweep_store.history(path, "inclination_unwrapped", (0,))[-1, 0])
    assert words(0, {}) == f"treading at {angle:.3g} degrees"
    # A slow change that is rest for ν = 1 is none for a vesicle that relaxes slowly.
    assert (
        words(0, {}, drift=0.01).startswith("treading") and words(0, {"viscosity_ratio": 100.0}, drift=0.01) == "open"
    )
    assert words(1, {}).startswith("tumbling, 0.") and "average of [μ] over whole half-turns" in words(1, {})


def test_scenes_without_a_constant_shear_have_no_motion():
    assert motions.has_motion(parse(SCENE))
    field = {"beta": 1.0, "conductivity_ratio": 0.1}
    for other in ({"flow": None, "field": field}, {"flow": {"kind": "extension", "capillary_number": 1.0}}):
        tables = {key: value for key, value in (SCENE | other).items() if value is not None}
        assert not motions.has_motion(parse(tables))
