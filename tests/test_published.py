"""Published values: rings under pressure, discs, treading ellipses, charging cylinders; toy vesicles reach them."""

import jax.numpy as jnp
import numpy as np

from experiments import published, quasi_circular


def test_the_elastica_collapses_at_three_and_touches_at_the_published_pressure():
    """Lévy's 3 with tension -5/2, and 5.247 of Flaherty, Keller & Rubinow."""
    nearly = published.elastica(0.995)
    assert abs(nearly["pressure"] - 3) < 0.02
    assert abs(nearly["tension"] + 2.5) < 0.02
    assert round(published.elastica()["pressure"], 3) == 5.247


def test_a_vesicle_left_alone_ends_on_the_elastica():
    vesicle, ring = published.at_rest(0.9, N=48, tolerance=1e-6), published.elastica(0.9)
    for name in ("pressure", "tension", "energy"):
        np.testing.assert_allclose(vesicle[name], ring[name], rtol=1e-5, err_msg=name)
    assert vesicle["unevenness"] < 1e-4


def test_keller_and_skalak_give_the_aspect_ratio_and_meet_the_quasi_circular_theory():
    """tan θ = b/a; both theories differ by O(1-Δ) in θ."""
    axes = [2.0, 1.0]
    f0, f1 = 2 / (axes[0] / axes[1] + axes[1] / axes[0]), 0.5 * (axes[0] / axes[1] - axes[1] / axes[0])
    np.testing.assert_allclose(np.tan(0.5 * np.arccos(1 / (f0 * (f1 + 1 / f1)))), 0.5, rtol=1e-14)
    areas = (0.99, 0.999)
    gaps = [abs(published.keller_skalak(area) - published.quasi(area)) for area in areas]
    assert quasi_circular.orders(areas, gaps)[0] > 0.9


def test_a_circle_charges_like_a_cylinder_of_any_conductivity():
    assert max(float(published.charging(jnp.asarray(ratio))) for ratio in (0.1, 10.0)) < 1e-7


def test_the_toy_run_says_what_is_compared():
    found = published.run(**published.QUICK)
    row = found["shear"][0.9]
    assert abs(row["inclination"] - row["KS"]) < np.deg2rad(1.0)
    assert found["touching"]["area"] < 0.28
