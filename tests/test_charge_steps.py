"""The stored orders and costs of steps with charge that relaxes and with averaged AC fields."""

import json

import pytest

from experiments import charge_steps
from experiments._common import HERE

FOUND = json.loads((HERE / "data" / "charge_steps.json").read_text())["data"]


def test_slopes_are_observed_orders():
    assert [round(slope, 9) for slope in charge_steps.slopes([16.0, 1.0, 0.5], [1, 2, 4])] == [4.0, 1.0]


def test_slaved_charge_keeps_order_four_and_an_uncharged_start_needs_steps_that_see_it_relax():
    for delta in ("1e-05", "0.0001"):
        assert min(FOUND["orders"]["in equilibrium"][delta][:2]) > 3.5
        assert max(FOUND["orders"]["uncharged"][delta]) < 1.5
    assert min(FOUND["orders"]["uncharged"]["0.01"]) > 3.5


def test_a_step_with_charge_relaxation_costs_at_most_twice_one_without():
    seconds = FOUND["seconds"]["64"]
    assert seconds["relaxing"] < 2 * seconds["without"]


def test_an_averaged_run_is_cheaper_than_the_cheapest_resolved_run_with_its_error():
    for field, target in zip(FOUND["AC"], (10, 80), strict=True):
        assert charge_steps.ratios(field) == pytest.approx(field["ratios"], rel=1e-6)
        assert min(field["ratios"]) > target
        averaged, resolved = ([row["steps"] for row in field[kind]] for kind in ("averaged", "resolved"))
        assert min(resolved) > 3 * target * min(averaged)
        assert max(row["error"] for row in field["averaged"]) < 2 / field["omega"]


def test_resolved_runs_are_complete_and_state_more_than_their_error():
    for field in FOUND["AC"]:
        for row in field["resolved"]:
            assert row["status"] == "complete" and row["error"] < row["stated"] < 0.1


def test_only_resolved_runs_without_a_larger_error_count_as_equally_good():
    averaged = [{"error": 1.0, "seconds": 2.0}, {"error": 0.1, "seconds": 4.0}, {"error": 1e-3, "seconds": 4.0}]
    resolved = [{"error": 2.0, "seconds": 3.0}, {"error": 0.5, "seconds": 20.0}, {"error": 0.1, "seconds": 60.0}]
    assert charge_steps.ratios({"averaged": averaged, "resolved": resolved}) == [10.0, 15.0, None]
