"""Experiments by sweep at toy size: they run, and say what they are for."""

import numpy as np
import pytest

from experiments import phase_diagrams, rheology, sweep_throughput


def test_the_critical_field_is_bracketed_by_the_cases_that_have_a_class():
    strengths = np.linspace(1, 5, 5)
    assert phase_diagrams.bracket(strengths, ["P", "", "P", "POP", "POP"]) == [3.0, 4.0]
    assert phase_diagrams.bracket(strengths, ["P", "P", "", "", "O"]) == [2.0, 5.0]
    assert phase_diagrams.bracket(strengths, ["P"] * 5) is None


@pytest.mark.slow
def test_a_phase_diagram_has_prolates_in_weak_fields(tmp_path):
    found = phase_diagrams.run(**phase_diagrams.QUICK | {"folder": tmp_path})
    classes = found["by area"][0.9]["classes"]
    assert classes[0][0] == "P" and classes[-1][-1] == "O"
    phase_diagrams.draw(found)


@pytest.mark.slow
def test_throughput_times_every_way_to_compute_the_same_cases():
    found = sweep_throughput.run(**sweep_throughput.QUICK)
    assert set(found["seconds per case"]) == {"one by one", "1 × 2"}
    assert all(ratio > 0 for ratio in found["ratios"].values())
    on_gpu = sweep_throughput.on_gpu(cases=2, nodes=32, t_end=0.02, batches=(1, 2))
    assert all(rate > 0 for rate in on_gpu["cases per second"].values())


def test_verdicts_are_those_of_the_numbers():
    rising = {"steady": 2, "least rise of inclination": 0.1, "backwards up to": 0.1}
    found = {"ratios": [0.1, 1.0], "against Λ": {0.5: rising, 0.9: rising | {"backwards up to": np.nan}}}
    assert all(rheology.verdicts(found).values())
    for key, value in (("steady", 1), ("least rise of inclination", -0.1), ("backwards up to", np.nan)):
        spoilt = found | {"against Λ": {0.5: rising | {key: value}}}
        assert sum(rheology.verdicts(spoilt).values()) == 2
