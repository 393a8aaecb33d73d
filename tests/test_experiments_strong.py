"""The experiments on strong fields, at toy size, and the numbers that are stored."""

import json

import numpy as np
import pytest

from experiments import strong_fields, strong_step
from experiments._common import HERE


def stored(name):
    return json.loads((HERE / "data" / f"{name}.json").read_text())["data"]


def test_wrinkles_are_measured_on_a_rippled_circle():
    """r = 1 + ε cos kφ has the curvature 1 + ε (k² - 1) cos kφ, of which the rms is counted from k = 8 on."""
    k, size = 12, 1e-6
    phi = 2 * np.pi * np.arange(96) / 96
    r = 1 + size * np.cos(k * phi) + size * np.cos(3 * phi)
    rms, number = strong_fields.wrinkles(np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1), 8)
    assert rms == pytest.approx(size * (k**2 - 1) / np.sqrt(2), rel=1e-4)
    assert number == pytest.approx(k, rel=1e-4)


def test_a_vesicle_in_a_strong_field_is_run_and_drawn():
    found = strong_fields.run(**strong_fields.QUICK)
    (history,) = found.values()
    assert len(history["t"]) == 2 and np.all(np.isfinite(history["rms curvature"]))
    strong_fields.draw(found)


def test_stored_wrinkles_do_not_depend_on_the_numbers_of_nodes():
    for row in stored("strong_fields")["differences from the first"].values():
        assert row["deformation"] < 1e-5
        assert row["rms curvature"] < 1e-3 and row["wrinkles"] < 1e-3


def test_a_step_with_many_nodes_is_timed():
    (versions,) = strong_step.run(**strong_step.QUICK).values()
    assert versions["this"]["step / LU"] > 0 and versions["this"]["GB"] > 0


def test_stored_steps_fit_into_memory_and_cost_less_than_before():
    rows = stored("strong_step")
    assert rows["2048"]["this"]["GB"] < 1.5
    for N in ("256", "512"):
        assert rows[N]["this"]["step / LU"] < 0.75 * rows[N]["older"]["step / LU"]
