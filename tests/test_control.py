"""Optimal control: gradients, the search on plateaus, a bound that is active and held, refusals."""

from math import inf

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves import Fixed, steer
from jaxves.analysis import steering
from jaxves.analysis.control import Controlled, Goal, Outcome, with_gradient
from jaxves.analysis.line_search import Trial, step_along
from jaxves.inputs.checking import SceneError

N, KNOTS, SAVES, T_END = 32, 4, 6, 0.06
TABLES = {
    "t_end": T_END,
    "vesicle": [{"reduced_area": 0.9, "angle": 90.0}],
    "field": {"beta": 3.2, "conductivity_ratio": 0.1},
    "numerics": {"nodes": N, "time_step": 0.01},
}
MARCH = Fixed(1)


@pytest.fixture(scope="module")
def scene():
    return jaxves.make_scene(
        jaxves.ellipse(N, 0.9, angle=jnp.pi / 2), field=jaxves.dc_field(3.2, conductivity_ratio=0.1)
    )


def at(scene, values, wanted=0.2, limit=inf):
    controlled = Controlled(scene, jnp.linspace(0.0, T_END, KNOTS), MARCH, "deformation", None, None)
    goal = Goal(jnp.asarray(wanted), jnp.asarray(wanted), jnp.asarray(limit))
    return with_gradient(controlled, goal, jnp.asarray(values), SAVES)


def test_the_gradient_agrees_with_differences_also_where_the_bound_counts(scene):
    """Central differences of fourth order."""
    values, along = np.array([1.0, 1.2, 0.8, 1.1]), np.array([0.3, -0.5, 1.0, 0.7])
    for limit in (inf, 0.05):
        _, gradient = at(scene, values, limit=limit)
        costs = [float(at(scene, values + h * along, limit=limit)[0].cost) for h in (-2e-3, -1e-3, 1e-3, 2e-3)]
        difference = (8 * (costs[2] - costs[1]) - (costs[3] - costs[0])) / 12e-3
        assert float(gradient @ along) == pytest.approx(difference, rel=1e-6)
    # without the bound the two gradients would be the same
    assert float(at(scene, values, limit=0.05)[0].cost) > 1.01 * float(at(scene, values)[0].cost)


@pytest.fixture(scope="module")
def free(scene):
    """A search without a bound, for a deformation that another field gives."""
    outcome, _ = at(scene, [1.6, 1.2, 0.4, 0.4])
    assert outcome.status == jaxves.status.COMPLETE
    told = []
    found = steer(
        scene, "deformation", float(outcome.quantity), t_end=T_END, knots=KNOTS, saves=SAVES, march=MARCH,
        tolerance=1e-4, progress=lambda *call: told.append(call),
    )  # fmt: skip
    assert told == [(i + 1, 50, str(evaluation)) for i, evaluation in enumerate(found.history)]
    assert told[0][2].startswith("quantity 0.") and "the run ended" not in told[0][2]
    return found


def test_the_goal_is_met_and_the_field_gives_it_again(scene, free):
    assert free.word == "met" and len(free.history) <= 20
    assert abs(free.quantity / free.wanted - 1) <= 1e-4
    assert abs(free.history[0].quantity / free.wanted - 1) > 2e-3  # the start does not meet it
    tables = TABLES | {"field": TABLES["field"] | {"time": free.table()}}
    again = jaxves.simulate(jaxves.scene_of(jaxves.read_scene(tables), {}), T_END, saves=SAVES, march=MARCH)
    assert float(again.diagnostics["deformation"][-1, 0]) == pytest.approx(free.quantity, abs=1e-10)
    assert repr(free).startswith("<Steering: met after") and "4 knots" in repr(free)


def test_a_bound_that_the_free_field_exceeds_is_held(free):
    bound = 0.97 * free.max_V_m
    held = steer(
        TABLES, "deformation", free.wanted, knots=KNOTS, saves=SAVES, tolerance=1e-4, max_V_m=bound, start=free.values
    )
    assert held.word == "met" and held.max_V_m <= bound
    assert abs(held.quantity / held.wanted - 1) <= 1e-4
    assert held.max_V_m > 0.9 * bound  # otherwise the bound would not matter


def test_the_search_goes_on_where_the_cost_is_concave(scene, monkeypatch):
    """For Q = 1/(1 + 5 m²) with the mean m of the values; the cost becomes steeper from m = 1.5 to 0.75."""

    def with_gradient(controlled, goal, values, saves):
        def cost(values):
            Q = 1 / (1 + 5 * jnp.mean(values) ** 2)
            return goal.cost(Q, jnp.zeros(2)), Q

        (J, Q), gradient = jax.value_and_grad(cost, has_aux=True)(values)
        return Outcome(J, Q, jnp.asarray(0.0), jnp.asarray(jaxves.status.COMPLETE)), gradient

    monkeypatch.setattr(steering, "with_gradient", with_gradient)
    found = steer(scene, "deformation", 0.9, t_end=T_END, knots=KNOTS, saves=SAVES, march=MARCH, start=1.5)
    assert found.word == "met" and len(found.history) < 15
    assert abs(found.history[-1].quantity / 0.9 - 1) <= 1e-3


def test_too_few_evaluations_are_said(free):
    found = steer(TABLES, "deformation", free.wanted, knots=KNOTS, saves=SAVES, tolerance=1e-9, evaluations=2)
    assert found.word == "evaluations used up" and len(found.history) == 2


def line(residual):
    """Trials of ½ r² along a line, and how many there were."""
    count = []

    def try_at(share):
        count.append(share)
        r = residual(share)
        return Trial(0.5 * r**2 if np.isfinite(r) else inf, r)

    return try_at, count


def test_a_step_between_two_plateaus_finds_the_value_between_them():
    """The residual is almost 1 or -1 but for a narrow range: neither the slope nor halving leads there."""
    try_at, count = line(lambda share: np.tanh(30 * (0.37 - share)))
    share, trial = step_along(try_at(0.0), 1e-9, 1.0, try_at)
    assert abs(share - 0.37) < 0.02 and abs(trial.residual) <= 0.3 and len(count) <= 13


def test_a_step_into_a_breakdown_is_shortened_and_one_without_decrease_is_refused():
    try_at, _ = line(lambda share: 1 - share if share < 0.3 else np.nan)
    share, _ = step_along(try_at(0.0), 1.0, 1.0, try_at)
    assert share == 0.25
    try_at, _ = line(lambda share: 1 + share)
    assert step_along(try_at(0.0), 1.0, 1.0, try_at) is None
    assert step_along(try_at(0.0), 1.0, 1.0, lambda share: None) is None


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"quantity": "colour"}, r"quantity = colour, expected one of area, "),
        ({"quantity": "center"}, r"quantity = center with shape .*expected one number"),
        (
            {"quantity": lambda result: result.x},
            r"quantity = a function that returns an array of shape .*, expected one number",
        ),
        ({"wanted": np.nan}, r"wanted = nan, expected"),
        ({"knots": 1}, r"knots = 1, expected a whole number >= 2"),
        ({"max_V_m": 0.0}, r"max_V_m = 0.0, expected"),
        ({"tolerance": -1.0}, r"tolerance = -1.0, expected"),
        ({"evaluations": 0}, r"evaluations = 0, expected a whole number >= 1"),
        ({"start": [1.0, 2.0]}, r"start = .*expected one number, or 24, one for each knot"),
        ({"t_end": None}, r"t_end = None, expected the end of the run"),
        ({"march": jaxves.Adaptive(recorded=None)}, r"march = .*expected a march that reverse mode can follow"),
    ],
)
def test_what_cannot_be_steered_is_refused_in_one_line(scene, changed, message):
    given = {"quantity": "deformation", "wanted": 0.1, "t_end": 0.1} | changed
    with pytest.raises(ValueError, match=message) as caught:
        steer(scene, given.pop("quantity"), given.pop("wanted"), **given)
    assert "\n" not in str(caught.value)


def test_scenes_without_a_field_or_with_an_averaged_one_are_refused():
    ellipse = jaxves.ellipse(N, 0.9)
    with pytest.raises(ValueError, match=r"scene.field = None, expected a field"):
        steer(jaxves.make_scene(ellipse), "deformation", 0.1, t_end=0.1)
    field = jaxves.dc_field(3.2, conductivity_ratio=0.1, history=jaxves.AC(10.0, averaged=True))
    with pytest.raises(ValueError, match=r"averaged = True, expected a field that is not averaged"):
        steer(jaxves.make_scene(ellipse, field=field), "deformation", 0.1, t_end=0.1)
    with pytest.raises(SceneError, match=r"stop, .*a control"):
        steer(TABLES | {"stop": {"steady": 1e-3}}, r"deformation", 0.1)
