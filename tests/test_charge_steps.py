"""The stored orders and costs of steps with charge that relaxes and with averaged AC fields."""

import json

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


def test_costs_are_within_their_targets():
    seconds, run = FOUND["seconds"]["64"], FOUND["AC"]
    assert seconds["relaxing"] < 2 * seconds["without"]
    assert 10 * run["averaged"]["seconds"] < run["resolved"]["seconds"]
    assert max(run["apart"]) < run["averaged"]["swing"]
