"""Experiments by sweep at toy size: they run, and say what they are for."""

import h5py
import numpy as np
import pytest

from experiments import broken_symmetry, kills, phase_diagrams, rheology, sweep_throughput
from experiments._treading import Setting, at, start


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
def test_a_disturbed_start_is_told_beside_the_symmetric_one(tmp_path):
    found = broken_symmetry.run(**broken_symmetry.QUICK | {"folder": tmp_path})
    assert found["by area"][0.9][0.0] == {"classes": [["POP"]], "status": [["class reached"]], "changed": 0}
    assert found["by area"][0.9][1e-3]["classes"] == [["POP"]]
    broken_symmetry.draw(found)


@pytest.mark.slow
def test_throughput_times_every_way_to_compute_the_same_cases():
    found = sweep_throughput.run(**sweep_throughput.QUICK)
    assert set(found["seconds per case"]) == {"one by one", "1 × 2"}
    assert all(ratio > 0 for ratio in found["ratios"].values())
    on_gpu = sweep_throughput.on_gpu(cases=2, nodes=32, t_end=0.02, batches=(2,), differentiated=2)
    assert all(rate > 0 for rate in on_gpu["cases per second"].values())
    assert on_gpu["cases per second on the host"] > 0
    # Without a GPU both are the host, and the sums of a batch in another order are the only difference.
    assert all(apart["other status"] == 0 for apart in on_gpu["apart from the host"].values())
    assert all(apart["deformation_final"] < 1e-9 for apart in on_gpu["apart from the host"].values())
    assert on_gpu["gradients apart"]["most"] < 1e-9


def test_verdicts_are_those_of_the_numbers():
    rising = {"settled": [True] * 3, "inclination": [0.1, 0.2, 0.3], "speed": [0.1, -0.1, -0.2]}
    found = {"ratios": [0.1, 1.0, 2.0], "against Λ": {0.5: rising, 0.9: rising}}
    assert all(rheology.verdicts(found).values())
    spoilt_by = (("settled", [True, True, False]), ("inclination", [0.2, 0.1, 0.3]), ("speed", [-0.1, -0.1, -0.2]))
    for (key, value), failing in zip(spoilt_by, (2, 1, 1), strict=True):
        spoilt = found | {"against Λ": {0.5: rising | {key: value}, 0.9: rising}}
        assert list(rheology.verdicts(spoilt).values()).count(False) == failing
    restless = rising | {"settled": [False, True, True]}
    assert rheology.settles_from(found, restless) == 1.0 and rheology.settles_from(found, rising) == 0.1


@pytest.mark.slow
def test_the_growth_of_a_bend_does_not_depend_on_the_nodes():
    """12.396 with 96 nodes."""
    setting = Setting(0.6, 0.1, 6.4, 10.0)
    found = at(setting, start(setting, 64))
    assert found.last_step < 1e-6
    assert abs(found.growth / 12.396 - 1) < 1e-3


def test_what_a_killed_sweep_acknowledged_must_have_the_bits_of_a_whole_one(tmp_path):
    whole, broken = tmp_path / "whole.h5", tmp_path / "broken.h5"

    def write(path, words, values):
        with h5py.File(path, "w") as file:
            file["status"], file["tension_max"] = np.array(words, "S16"), values
            for name in file:
                file[name].attrs["per_case"] = True

    assert kills.kept(broken, whole) == (0, True)
    write(whole, ["steady", "complete"], [1.0, 2.0])
    write(broken, ["steady", "pending"], [1.0, np.nan])
    assert kills.kept(broken, whole) == (1, True)
    write(broken, ["steady", "pending"], [1.0 + 1e-15, np.nan])
    assert kills.kept(broken, whole) == (1, False)
    write(broken, ["complete", "pending"], [1.0, 2.0])
    assert kills.kept(broken, whole) == (1, False)
