"""The critical viscosity ratio, where tank-treading ends: the fold, its derivatives, its limit, and what is refused."""

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.viscosity_contrast import KellerSkalak
from jaxves.analysis import continuation, fold
from jaxves.analysis.critical import NoCriticalValue
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.inputs.scene_files import parse

N, RATIO = 32, "fluid.viscosity_ratio"


def scene(area=0.95, Ca=10.0, ratio=2.0, **more):
    vesicle = {"reduced_area": area, "angle": 25.0} | more
    tables = {"t_end": 0.6, "saves": 1, "vesicle": [vesicle], "fluid": {"viscosity_ratio": ratio}}
    flow = {"kind": "shear", "capillary_number": Ca}
    return parse(tables | {"flow": flow, "numerics": {"nodes": N, "time_step": 0.02, "method": "euler"}})


@pytest.fixture(scope="module")
def found():
    return fold.critical_value(scene(), RATIO)


def ellipse(area):
    return Unknowns.of(shapes.ellipse(N, area, angle=0.4)[None])


def again(**changed):
    """The critical ratio of a changed scene, from an ellipse instead of the end of a run."""
    return fold.critical_value(scene(**changed), RATIO, near=ellipse(changed.get("area", 0.95)))


def test_treading_ends_at_the_critical_ratio(found):
    """Below it Newton's method finds two steady states at different angles, above it none, from the same starts."""
    family = fold.family_of(scene(), RATIO).with_unit(found.unit)
    point = continuation.Point(found.y, found.value, continuation.tangent_at(family, found.y, found.value))
    sides = [continuation.ahead(family, point, arc) for arc in (-0.01, 0.01)]
    angles = [float(continuation.diagnosed(family, p.y, jnp.asarray(p.value))["inclination"][0]) for p in sides]
    assert min(angles) < found.diagnostics["inclination"][0] < max(angles)
    short_of = [found.value - p.value for p in sides]
    assert min(short_of) > 1e-3 and max(short_of) < 0.1 * found.value, short_of
    for side in sides:
        _, steady = continuation.beginning(family, side.value, side.y)
        np.testing.assert_allclose(steady.y.x, side.y.x, atol=1e-5)
        with pytest.raises(NoCriticalValue, match="no steady state near"):
            continuation.beginning(family, 2 * found.value - side.value, side.y)


def test_a_steady_state_solves_all_its_equations_on_few_nodes(found):
    """Equations that hold up to the discretisation error only would leave 1e-7 here, where Newton's method stalls."""
    R, _ = continuation.linearised(fold.family_of(scene(), RATIO), found.y, jnp.asarray(found.value), found.y)
    assert np.linalg.norm(R) < 1e-9


def test_the_critical_ratio_does_not_depend_on_where_it_is_sought_from(found):
    np.testing.assert_allclose(again(ratio=1.0).value, found.value, rtol=1e-6)


def test_the_derivatives_are_those_of_differences_and_of_the_units(found):
    """ν_c depends on Ca a³/κ_B and Δ alone, so that the slopes in size and stiffness follow from that in Ca."""
    slopes = fold.slopes(scene(), RATIO, found)
    for name, key, value, h in (
        ("vesicle.reduced_area", "area", 0.95, 1e-3),
        ("flow.capillary_number", "Ca", 10.0, 0.3),
    ):
        high, low = (again(**{key: value + d}).value for d in (h, -h))
        np.testing.assert_allclose(slopes[name], (high - low) / (2 * h), rtol=5e-3, err_msg=name)
    by_shear = 10.0 * slopes["flow.capillary_number"]
    # The discrete equations have these symmetries up to the modes that are filtered, which 32 nodes resolve to 1e-4.
    np.testing.assert_allclose(slopes["vesicle.length"], 3 * by_shear, rtol=1e-4)
    np.testing.assert_allclose(slopes["vesicle.bending"], -by_shear, rtol=1e-4)
    np.testing.assert_allclose([slopes["vesicle.angle"], slopes["vesicle.center[1]"]], 0.0, atol=1e-9)
    assert RATIO not in slopes


def test_more_nodes_change_the_critical_ratio_little(found):
    error = fold.discretisation_error(scene(), RATIO, found)
    assert 0 < error.nodes < 1e-4 * found.value


def test_a_nearly_round_vesicle_has_the_ratio_of_the_theory():
    """Keller and Skalak's 2a/(a - b), which is exact for Δ → 1: the relative deviation falls about like 1 - Δ."""
    deviation = [again(area=area).value / KellerSkalak.of(area).critical - 1 for area in (0.96, 0.99)]
    assert 0 < deviation[1] < 0.3 * deviation[0] < 0.02, deviation


def test_what_has_no_fold_is_refused():
    with pytest.raises(NoCriticalValue, match=r"no fold of steady states between 2 and 4\.\d"):
        fold.critical_value(scene(), RATIO, near=ellipse(0.95), most=2)
    (one,) = scene().vesicle
    pair = scene().model_copy(update={"vesicle": (one, one.model_copy(update={"center": (6.0, 0.0)}))})
    with pytest.raises(NoCriticalValue, match="one vesicle"):
        fold.critical_value(pair, RATIO)
