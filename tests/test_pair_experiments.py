"""The experiments with pairs at toy size: one compiled program, half a unit of time, what is known of it."""

import numpy as np
import pytest

from experiments import (
    _pairs,
    chain_gap,
    film,
    pair_accuracy,
    pair_circulation,
    pair_insensitivity,
    pair_transition,
    pairs,
)


def test_pairs_turn_towards_the_field_or_away_and_attract_in_line_and_repel_side_by_side():
    found = pairs.run(**pairs.QUICK)
    assert found[0.5, 0.0]["turns"] == 1
    assert found[2.0, 0.0]["turns"] == -1
    assert found["side by side"]["class"] == "repulsion"
    aligned = found["aligned"]
    np.testing.assert_allclose(aligned["angle"], 90, atol=1e-6)
    late = aligned["separation"][-2:]  # after the transient change of shape
    assert late[1] < late[0]
    pairs.draw(found)
    pairs.draw_table(found)
    assert "N =  32" in _pairs.summary(aligned)


def test_starts_and_areas_are_told_apart():
    found = pair_insensitivity.run(**pair_insensitivity.QUICK)
    assert set(found) == {("offset", 0.5, 40.0), ("area", 0.5, 0.99)}
    assert found["area", 0.5, 0.99]["deformation"].max() < found["offset", 0.5, 40.0]["deformation"].max()
    pair_insensitivity.draw(found)


def test_a_conducting_pair_turns_oblate():
    found = pair_transition.run(**pair_transition.QUICK)
    case = found[0.1, 4.0]
    assert np.all(case["deformation"][-1] < 0) and case["least_curvature"].shape == (4,)
    pair_transition.draw(found)


def test_a_circulating_pair_can_be_drawn_with_its_flow():
    found, grid = pair_circulation.run(**pair_circulation.QUICK)
    assert [round(t, 9) for t in found] == [0.25, 0.5]
    assert all(np.isfinite(case["velocity"]).all() for case in found.values())
    pair_circulation.draw(found, grid)


def test_neither_numbers_nor_directions_matter_and_the_finer_run_tells_the_error():
    found = pair_accuracy.run(**pair_accuracy.QUICK)
    worst = {name: max(found[name][what] for what in ("center", "inclination", "gap")) for name in found}
    assert worst["numbered anew"] < 1e-9
    assert worst["turned"] < 1e-3  # the tolerance, because the steps differ: the controller looks at components
    assert 1e-9 < found["circulating"]["center"] < 1e-3


@pytest.mark.slow
def test_the_film_is_watched_by_an_error_that_falls_with_the_nodes():
    found = film.run(**film.QUICK)
    (sizes,) = found.values()
    assert sizes[48]["error"] == 0 and sizes[32]["error"] < 1e-2
    film.draw(found)


@pytest.mark.parametrize("rate", [0.3, 2.0])
def test_an_exponential_law_is_recognised(rate):
    t = np.linspace(4, 8, 60)
    found = chain_gap.laws(t, 0.1 * np.exp(-rate * t))
    np.testing.assert_allclose(found["exponential"]["rate"], rate, rtol=1e-10)
    assert found["exponential"]["error"] < 1e-9 and found["exponential"]["misfit"] < 1e-10
    np.testing.assert_allclose(found["local rate"], rate, rtol=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 2.5])
def test_a_power_law_is_recognised(exponent):
    t = np.linspace(4, 8, 60)
    found = chain_gap.laws(t, 0.1 * (t - 2.5) ** -exponent)
    np.testing.assert_allclose(found["power"]["exponent"], exponent, rtol=1e-4)
    np.testing.assert_allclose(found["power"]["t_0"], 2.5, atol=1e-3)
    assert found["power"]["misfit"] < 1e-6 < 1e-2 < found["exponential"]["misfit"]
