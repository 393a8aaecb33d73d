"""Fits to several runs that differ in a number of the scene, with unknowns that are no numbers of the scene."""

import json

import numpy as np
import pytest

from experiments import charge_fit
from experiments._common import HERE
from jaxves.analysis import boxes, fit, intervals
from jaxves.analysis.observations import Model, Observations, shown
from jaxves.base import status
from jaxves.inputs.checking import SceneError
from jaxves.inputs.scene_files import parse
from jaxves.stepping.fixed import Fixed

FILE = parse({"t_end": 0.1, "vesicle": [{"reduced_area": 0.9, "angle": 70.0}], "numerics": {"nodes": 24}})
AREAS, MARCH, NOISE = (0.85, 0.9), Fixed(2), 1e-4
BLANK = Observations(
    0.02, {"deformation": np.zeros((2, 4, 1))}, {"deformation": NOISE}, conditions={"vesicle.reduced_area": AREAS}
)


def in_zeptojoule(unknowns):
    """Returns the bending of the scene, which is relative to 100 zJ."""
    return {"vesicle.bending": unknowns["kappa"] / 100.0}


def test_unknowns_of_ones_own_are_found_from_runs_under_several_conditions(tmp_path):
    exact = shown(Model.of(FILE, BLANK, MARCH, in_zeptojoule), {"kappa": 70.0})["deformation"]
    alone = BLANK._replace(seen={"deformation": np.zeros((4, 1))}, conditions=None)
    model = Model.of(FILE, alone, MARCH)
    slopes = []
    for area, seen in zip(AREAS, exact, strict=True):
        at = {"vesicle.reduced_area": area}
        np.testing.assert_allclose(seen, shown(model, at | {"vesicle.bending": 0.7})["deformation"], atol=1e-12)
        ends = [shown(model, at | {"vesicle.bending": 0.7 * share})["deformation"] for share in (0.99, 1.01)]
        slopes.append((ends[1] - ends[0]) / np.log(1.01 / 0.99))
    assert np.max(np.abs(exact[0] - exact[1])) > 100 * NOISE  # so that runs that are exchanged are noticed

    kept = tmp_path / "starts.json"
    how = {"numbers": in_zeptojoule, "starts": 1, "march": MARCH, "checkpoint": kept}
    observations = BLANK._replace(seen={"deformation": exact})
    found = fit.fit(FILE, {"kappa": (10.0, 1000.0)}, observations, **how)
    assert found.starts[0].began == pytest.approx({"kappa": 100.0})  # the middle of the bounds
    assert found.values["kappa"] == pytest.approx(70.0, rel=1e-4) and found.observations == 8
    low, high = found.intervals["kappa"]
    assert np.log(high / low) / 2 == pytest.approx(1.96 * NOISE / np.linalg.norm(slopes), rel=1e-3)
    with pytest.raises(ValueError, match="of the same scene, bounds and observations"):
        how["numbers"] = lambda unknowns: {"vesicle.bending": unknowns["kappa"] / 101.0}
        fit.fit(FILE, {"kappa": (10.0, 1000.0)}, observations, **how)
    with pytest.raises(ValueError, match="of the same scene, bounds and observations"):
        others = observations._replace(conditions={"vesicle.reduced_area": (0.85, 0.95)})
        fit.fit(FILE, {"kappa": (10.0, 1000.0)}, others, **how | {"numbers": in_zeptojoule})


def test_what_the_translation_gives_has_to_be_a_number_that_the_scene_may_have():
    with pytest.raises(SceneError, match="bending"):
        fit.fit(FILE, {"kappa": (-10.0, 1000.0)}, BLANK, numbers=in_zeptojoule, march=MARCH)
    with pytest.raises(SceneError, match=r"field.beta = .*numbers of the scene"):
        fit.fit(
            FILE, {"E": (1.0, 2.0)}, BLANK, numbers=lambda unknowns: {"field.beta": unknowns["E"] ** 2}, march=MARCH
        )


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        (lambda unknowns: [unknowns["kappa"]], "numbers = a function that returns .*, expected a function in JAX"),
        (lambda unknowns: {"vesicle.bending": float(unknowns["kappa"])}, "numbers = .*makes a Python number"),
        (lambda unknowns: {"vesicle.bending": [unknowns["kappa"]]}, "numbers = a function that returns .*, expected"),
    ],
)
def test_a_translation_that_cannot_be_traced_is_refused_before_any_run(numbers, message):
    with pytest.raises(ValueError, match=message):
        fit.fit(FILE, {"kappa": (10.0, 1000.0)}, BLANK, numbers=numbers, march=MARCH)


@pytest.mark.parametrize("conditions", [None, {"vesicle.reduced_area": AREAS}])
def test_where_every_run_breaks_down_the_error_has_the_status_words(conditions):
    """With one step of this length the shape is lost at once."""
    seen = BLANK.seen["deformation"] if conditions else BLANK.seen["deformation"][0]
    broken = BLANK._replace(t_end=100.0, seen={"deformation": seen}, conditions=conditions)
    with pytest.raises(
        ValueError, match=r"^starts: every run ended as .*, expected at least one start whose"
    ) as caught:
        fit.fit(FILE, {"vesicle.bending": (0.5, 2.0)}, broken, starts=1, march=Fixed(1))
    words = str(caught.value).split(" as ")[1].split(",")[0].split(" or ")
    assert set(words) <= set(status.WORDS.values()) - {"complete"}


def test_a_part_of_an_open_combination_has_no_interval_however_short_its_own_is():
    """The combination is open by 1.06, of which its two numbers have 0.61 and 0.87."""
    inside = boxes.boxes({"a": (0.1, 10.0), "b": (0.1, 10.0), "c": (0.1, 10.0)})
    along, across = np.array([0.57, 0.82, 0.0]), np.array([-0.82, 0.57, 0.0])
    jacobian = np.stack([intervals.NORMAL_95 / 1.06 * along, 50 * across, [0.0, 0.0, 50.0]])
    found = intervals.judged(jacobian, inside)
    assert np.all(found.half_widths < intervals.LOOSE)
    np.testing.assert_array_equal(found.undetermined, [True, True, False])
    assert found.loose == ("+0.57 log a +0.82 log b",)
    (sentence,) = found.determined
    assert sentence.startswith("a/b is determined to ±")
    shorter = intervals.judged(1.1 * jacobian, inside)
    assert not np.any(shorter.undetermined) and shorter.loose == ()


FOUND = json.loads((HERE / "data" / "charge_fit.json").read_text())["data"]


def test_capacitance_and_conductivity_are_in_their_intervals_and_what_a_band_leaves_open_is_named():
    part = FOUND["all"]
    assert len(part["fits"]) == 20
    for name in charge_fit.TRUTH:
        assert sum(charge_fit.inside(row, name) for row in part["fits"]) >= 17
        over = charge_fit.widths(part, name)
        assert len(over) == 20 and max(over) < 1.5
        assert part["expected"][name] < 0.03
    (low,), (high,) = FOUND["low"]["fits"], FOUND["high"]["fits"]
    assert low["intervals"] == {"C_m": None, "sigma_i": None} and len(low["loose"]) == 1
    assert high["intervals"]["C_m"] is None and charge_fit.inside(high, "sigma_i")
    assert high["loose"] == ["+1.00 log C_m"]
