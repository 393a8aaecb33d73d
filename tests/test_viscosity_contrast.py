"""The theory of Keller and Skalak in two dimensions, and what the stored numbers of the experiment promise."""

import json

import numpy as np
import pytest

from experiments import viscosity_contrast as v
from experiments._common import HERE


def test_the_theory_has_its_transition_and_its_limits():
    """B = 1 at ν_c with [μ] = (a+b)²/2a²; for ν → ∞ the rigid ellipse with the mean [μ] of 2 and Jeffery's period."""
    theory = v.KellerSkalak(1.3, 0.8, shear=7.0)
    a, b, critical = 1.3, 0.8, theory.critical
    below, above = theory.at(critical * (1 - 1e-10)), theory.at(critical * (1 + 1e-10))
    np.testing.assert_allclose(below["inclination"], 0.0, atol=1e-4)
    assert np.isnan(above["inclination"]) and above["period"] > 1e3 and np.isnan(below["period"])
    for near in (below, above):
        np.testing.assert_allclose(near["viscosity"], (a + b) ** 2 / (2 * a**2), rtol=1e-4)
    rigid = theory.at(1e9)
    np.testing.assert_allclose(rigid["viscosity"], 2.0, rtol=1e-8)
    np.testing.assert_allclose(rigid["period"], np.pi * (a**2 + b**2) / (a * b * 7.0), rtol=1e-8)


@pytest.mark.parametrize("ratio", [0.2, 1.0, 30.0, 3000.0])
def test_both_theories_agree_near_the_circle(ratio):
    """Their relative difference is of the order of ε₀ = 0.0082, for treading and for tumbling."""
    area = 0.9999
    ellipse, leading = v.KellerSkalak.of(area).at(ratio), v.quasi_circular(ratio, area)
    for name, value in leading.items():
        np.testing.assert_allclose(ellipse[name], value, rtol=0.03, equal_nan=True)
    assert np.isnan(leading["period"]) == (ratio < 1 / np.sqrt(2 * (1 - area) / 3) - 1)


def test_the_stored_vesicle_treads_then_tumbles_and_becomes_a_rigid_body():
    data = json.loads((HERE / "data" / "viscosity_contrast.json").read_text())["data"]
    rows = data["rows"]
    assert [row["ratio"] for row in rows] == list(v.RATIOS) and all(row["status"] == "complete" for row in rows)
    assert [row["motion"] for row in rows] == ["treading" if ratio < 5.5 else "tumbling" for ratio in v.RATIOS]
    viscosity = np.array([row["viscosity"] for row in rows])
    least = int(np.argmin(viscosity))
    assert (
        v.RATIOS[least] == 5.0
        and np.all(np.diff(viscosity[: least + 1]) < 0)
        and np.all(np.diff(viscosity[least:]) > 0)
    )
    theory = data["theory"]
    np.testing.assert_allclose(viscosity[-1], theory[-1]["viscosity"], rtol=1e-3)
    np.testing.assert_allclose(rows[-1]["period"], theory[-1]["period"], rtol=2e-3)
