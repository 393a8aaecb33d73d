"""The stored phase diagram over frequency and conductivity ratio, beside the critical frequencies of a circle."""

import copy
import json

import numpy as np

from experiments import ac_phases
from experiments._common import HERE
from jaxves.observables import classes

FOUND, DEFLATED = (
    json.loads((HERE / "data" / f"ac_phases{variant}.json").read_text())["data"] for variant in ("", "_deflated")
)


def test_tilted_vesicles_are_oblate_exactly_between_the_critical_frequencies_of_a_circle():
    agreement = ac_phases.agreement(FOUND)
    assert agreement == FOUND["agreement"]
    for name, (right, total) in agreement.items():
        assert total > 50 and (right == total if name.startswith("tilted") else right > 0.75 * total)
    turned = copy.deepcopy(FOUND)
    part = turned["averaged"]["tilted"]
    part["deformation"] = (-np.array(part["deformation"])).tolist()
    right, total = ac_phases.agreement(turned)["tilted, ε = 1"]
    assert right == 0 < total


def test_vesicles_along_the_field_stay_prolate_beyond_the_first_frequency_and_never_become_oblate_below_it():
    part = FOUND["averaged"]["along the field"]
    for k, permittivity in enumerate(FOUND["permittivity"]):
        for i, ratio in enumerate(FOUND["ratio"]):
            first, second = ac_phases.frequencies_of(ratio, permittivity)
            omega, D = np.array(FOUND["omega"]), np.array(part["deformation"])[k, i]
            accurate = np.array(part["status"])[k, i] != "inaccurate"
            outside = ~(omega > first) | (omega > second)
            assert np.all(D[accurate & outside] > 0)


def test_runs_that_resolve_the_field_breathe_about_the_first_frequency():
    words = {(case["ratio"], case["over first"]): case["class"] for case in FOUND["resolved"]}
    assert {words[0.4, share] for share in (0.5, 0.8, 1.25)} == {"breathing"}
    assert words[0.4, 3.0] == "O" and words[2.0, 1.0] == "P"


def test_deflated_vesicles_are_oblate_between_both_frequencies_if_the_load_is_strong_and_prolate_for_large_ratios():
    agreement = ac_phases.agreement(DEFLATED)
    assert agreement == DEFLATED["agreement"]
    right, total = agreement["tilted, ε = 1"]
    assert total == 48 and total - right == 2
    omega, D = np.array(DEFLATED["omega"]), np.array(DEFLATED["averaged"]["tilted"]["deformation"])[0]
    exceptions = set()
    for ratio, row in zip(DEFLATED["ratio"], D, strict=True):
        first, second = ac_phases.frequencies_of(ratio, 1.0)
        between = (omega > first) & ~(omega > second)
        exceptions |= {(ratio, round(float(found), 1)) for found in omega[between & (row > classes.THRESHOLD)]}
    assert exceptions == {(0.4, 5.0), (0.7, 13.9)}  # just above the first frequencies, 4.2 and 9.8
    for part in DEFLATED["averaged"].values():
        assert set(np.ravel(part["status"])) == {"complete", "steady"}
    for part in DEFLATED["averaged"].values():
        D, breathing = np.array(part["deformation"])[:, -1], np.array(part["breathing"])[:, -1]
        assert DEFLATED["ratio"][-1] == 2.0 and np.all(D[~breathing] > 0)
    (case,) = DEFLATED["resolved"]
    assert case["class"] == "O" and case["deformation_period_mean"] < -0.3
