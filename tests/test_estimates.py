"""The estimated error of all steps where a field has a period: signs count while the shape hardly moves."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import jaxves
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.inputs.scene_files import parse
from jaxves.runs.build import build
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.estimates import ErrorSum
from jaxves.stepping.loop import initial_state
from jaxves.stepping.marching import simulate

N, STEPS, SIZE = 16, 160, 1e-4
SCENE = jaxves.make_scene(
    shapes.ellipse(N, 0.9), field=jaxves.dc_field(1.0, conductivity_ratio=0.3, history=jaxves.AC(100.0))
)


def summed(sign, turn):
    """The sums after steps with an error along the normal; the vesicle turns by the angle `turn` in each."""
    start = Unknowns.of(SCENE.x, jnp.zeros((1, N)))
    outward = SCENE.x / jnp.max(jnp.abs(SCENE.x))

    def step(sums, k):
        c, s = jnp.cos(k * turn), jnp.sin(k * turn)
        rotation = jnp.array([[c, -s], [s, c]])
        error = Unknowns.of(SIZE * sign(k) * outward @ rotation.T, jnp.zeros((1, N)))
        return sums.after(error, Unknowns.of(SCENE.x @ rotation.T, start.V_m)), None

    sums, _ = jax.lax.scan(step, ErrorSum.of(SCENE, start), jnp.arange(STEPS))
    return float(sums.total()), float(sums.sizes)


def test_errors_that_change_their_sign_in_place_cancel_except_for_a_tenth():
    total, sizes = summed(lambda k: jnp.where(k % 8 < 4, 1.0, -1.0), 0.0)
    np.testing.assert_allclose(sizes, STEPS * SIZE, rtol=1e-9)
    np.testing.assert_allclose(total, 0.1 * sizes + 4 * SIZE, rtol=1e-9)  # and the largest partial sum


def test_errors_of_one_sign_are_not_made_smaller():
    total, sizes = summed(lambda k: 1.0, 0.0)
    np.testing.assert_allclose(total, sizes, rtol=1e-9)


def test_errors_that_turn_with_the_vesicle_do_not_cancel_over_its_turns():
    """Sixteen half turns: with signs over the whole run nothing would be left."""
    total, sizes = summed(lambda k: 1.0, 16 * np.pi / STEPS)
    assert 0.8 * sizes < total <= sizes


@eqx.filter_jit
def _run(tolerance, frequency, t_end):
    field = jaxves.dc_field(6.4, conductivity_ratio=0.3, history=jaxves.AC(frequency))
    scene = jaxves.make_scene(shapes.ellipse(24, 0.95, angle=1.0), field=field)
    result = simulate(scene, t_end, saves=1, march=Adaptive(tolerance, recorded=None))
    return result.x[-1], result.state


def test_the_estimate_of_a_resolved_run_covers_its_error_and_is_smaller_than_the_sum_of_sizes():
    for frequency, t_end, least in ((200.0, 0.05, 0.0), (4.0, 0.25, 0.5)):  # a slow field moves the shape in a period
        numbers = jnp.asarray(frequency), jnp.asarray(t_end)
        x, state = _run(jnp.asarray(1e-2), *numbers)
        right, _ = _run(jnp.asarray(1e-6), *numbers)
        true = float(jnp.max(jnp.abs(x - right)))
        sizes = float(state.errors.sizes)
        assert true < float(state.time_error) <= sizes
        assert float(state.time_error) > least * sizes
        if not least:
            assert float(state.time_error) < 0.4 * sizes


def test_a_resolved_run_with_few_nodes_is_still_inaccurate():
    """The scene of a short strong field, whose 40 nodes leave no correct digit, in a field of high frequency."""
    tables = {
        "t_end": 0.02,
        "saves": 4,
        "vesicle": [{"reduced_area": 0.576, "angle": 87.4566}],
        "field": {
            "beta": 14.2939, "conductivity_ratio": 669.6676, "chi": 0.0177, "permittivity_ratio": 2.0981,
            "time": {"kind": "ac", "frequency": 20.0},
        },
        "numerics": {"nodes": 40},
    }  # fmt: skip
    result = simulate(build(parse(tables)), 0.02, saves=4)
    assert result.word in ("inaccurate", "unresolved")


def test_a_scene_without_a_period_carries_no_signs():
    for history in (None, jaxves.AC(9.0, averaged=True)):
        field = jaxves.dc_field(1.0, conductivity_ratio=0.1, history=history)
        still = jaxves.make_scene(shapes.ellipse(N, 0.98), field=field)
        state = eqx.filter_eval_shape(lambda s=still: initial_state(equation_for(s), Adaptive(1e-3)))
        assert state.errors is None
