"""Experiments on viscous vesicles at toy size, and what their stored numbers promise."""

import json

import numpy as np
import pytest

from experiments import contrast_fields, contrast_pairs, contrast_steps, critical_ratio
from experiments._common import HERE


def stored(name):
    return json.loads((HERE / "data" / f"{name}.json").read_text())["data"]


def test_the_critical_ratio_is_that_which_is_stored():
    found = critical_ratio.run(**critical_ratio.QUICK)[10.0][0.95]
    np.testing.assert_allclose(found["ratio"], stored("critical_ratio")["10.0"]["0.95"]["ratio"], rtol=1e-5)


@pytest.mark.parametrize("shear", critical_ratio.SHEARS)
def test_stored_critical_ratios_have_four_digits_lie_above_the_theory_and_tend_to_it(shear):
    rows = stored("critical_ratio")[str(shear)]
    assert list(rows) == [str(area) for few in critical_ratio.AREAS.values() for area in few]
    for row in rows.values():
        assert row["error"] < 5e-5 * row["ratio"] and row["by area"] > 0
    deviation = [row["ratio"] / row["theory"] - 1 for row in rows.values()]
    assert 0 < deviation[0] < 0.05 and np.all(np.diff(deviation[:4]) > 0)


@pytest.mark.parametrize("shear", critical_ratio.SHEARS)
def test_differences_between_critical_ratios_lie_between_their_derivatives(shear):
    rows = stored("critical_ratio")[str(shear)]
    areas, ratios = [float(area) for area in rows], [row["ratio"] for row in rows.values()]
    slopes = [row["by area"] for row in rows.values()]
    for chord, *ends in zip(np.diff(ratios) / np.diff(areas), slopes[:-1], slopes[1:], strict=True):
        assert min(ends) < chord < max(ends)


def test_stored_steps_of_viscous_vesicles_have_order_four_and_errors_fall_with_the_tolerance():
    found = stored("contrast_steps")
    assert list(found["motions"]) == list(contrast_steps.MOTIONS)
    for rows in found["motions"].values():
        orders, errors = rows["orders"], rows["errors"]
        assert min(order for order, error in zip(orders, errors[1:], strict=True) if error > 1e-9) > 3.7
        adaptive = [row["error"] for row in rows["adaptive"].values()]
        assert np.all(np.diff(adaptive) < 0)
        assert all(row["error"] < float(tolerance) for tolerance, row in rows["adaptive"].items())


def test_equal_steps_of_a_viscous_vesicle_have_order_four():
    found = contrast_steps.accuracy("tumbling", (16, 32), 128, (), 64)
    assert 3.7 < found["orders"][0] < 4.3


def test_a_vesicle_in_a_field_leaves_its_class_where_the_stored_critical_field_says():
    """At β = 3.2; the histories and β₀ are found by different runs."""
    found = stored("contrast_fields")
    for ratio, row in found["histories"].items():
        assert row["status"] == "complete"
        if ratio in found["critical"]:
            assert (row["class"] == "POP") == (found["critical"][ratio]["beta"] < 3.2)


def test_the_derivatives_of_critical_fields_by_the_ratio_agree_with_differences():
    rows = stored("contrast_fields")["critical"]
    ratios, betas = np.array([float(ratio) for ratio in rows]), np.array([row["beta"] for row in rows.values()])
    slopes = np.array([row["by ratio"] for row in rows.values()])
    chords = np.diff(betas) / np.diff(ratios)
    np.testing.assert_allclose(0.5 * (slopes[1:] + slopes[:-1]), chords, rtol=0.03)
    known = stored("critical_field")["cases"]["ellipse"]["0.9"]["beta"]
    np.testing.assert_allclose(rows["1.0"]["beta"], known, rtol=1e-4)


def test_the_stored_vesicles_tread_in_shear_and_field():
    for rows in stored("contrast_fields")["sheared"].values():
        assert {row["motion"] for row in rows.values()} == {"treading"}
        assert list(rows) == [str(ratio) for ratio in contrast_fields.CONDUCTIVITIES]


def test_stored_pairs_circulate_up_to_a_ratio_of_three_and_as_without_contrast_at_one():
    found, known = stored("contrast_pairs"), stored("pairs")
    assert list(found) == [str(at) for at in contrast_pairs.CONDUCTIVITIES]
    for at, rows in found.items():
        assert list(rows) == [str(ratio) for ratio in contrast_pairs.RATIOS]
        assert {rows[ratio]["class"] for ratio in ("0.1", "1.0", "3.0")} == {"circulation"}
        one, plain = rows["1.0"], known[f"({at}, 0.0)"]
        assert (one["class"], one["turns"]) == (plain["class"], plain["turns"])
        np.testing.assert_allclose(one["angle"][-1], plain["angle"][-1], atol=1.0)
