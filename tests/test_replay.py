"""Derivatives of adaptive runs: of the steps as they were made, in both modes, alone and in batches."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base import status
from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.observables.checks import Checks
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.physics.waveform import Pulse
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.loop import initial_state, stops_of
from jaxves.stepping.marching import simulate
from jaxves.stepping.record import advance, recorded

MARCH = Adaptive(1e-3, recorded=64)
T_END = 0.03
ONES = jnp.ones(5)


def scene(scales):
    """Five numbers: β, Λ, Ca, κ_B, and when the field is switched off."""
    history = Pulse(-1.0, 1.0 + 0.015 * scales[4], 5e-3)
    field = dc_field(6.4 * scales[0], conductivity_ratio=0.1 * scales[1], membrane_conductance=4.0, history=history)
    ellipse = shapes.ellipse(24, 0.9, angle=jnp.deg2rad(20.0))
    return make_scene(ellipse, bending=scales[3], field=field, flow=Shear(10.0 * scales[2]))


def outcome(scales, march=MARCH):
    """Something of every kind: diagnostics at two instants, a time average, the last state."""
    result = simulate(scene(scales), T_END, saves=2, march=march, average=jnp.array([0.01, T_END]))
    found = result.diagnostics
    each = (
        found["deformation"][-1, 0],
        found["inclination_unwrapped"][1, 0],
        0.1 * found["effective_viscosity"][-1],
        0.1 * found["max_V_m"][1, 0],
        0.1 * result.averages["effective_viscosity"],
        jnp.sum(result.state.y.x[0, 0]),
    )
    return sum(each), (result.status, result.state.steps)


@pytest.fixture(scope="module")
def gradient():
    return jax.jit(jax.grad(outcome, has_aux=True))(ONES)[0]


def test_forward_and_reverse_mode_agree(gradient):
    forward = jax.jit(jax.jacfwd(outcome, has_aux=True))(ONES)[0]
    np.testing.assert_allclose(forward, gradient, rtol=1e-8, atol=1e-10)


def test_following_recorded_steps_gives_the_derivative_of_the_loop_that_made_them(gradient):
    """Which JAX finds by itself, forwards."""
    forward = jax.jit(jax.jacfwd(lambda s: outcome(s, Adaptive(1e-3, recorded=None)), has_aux=True))(ONES)[0]
    np.testing.assert_allclose(forward, gradient, rtol=1e-8, atol=1e-10)


def test_derivatives_are_those_of_the_steps_made():
    """Richardson differences of the same steps made again: at the same instants, but for those that end at a stop."""

    def parts(scales):
        s = scene(scales)
        equation = equation_for(s)
        return equation, initial_state(equation, MARCH), stops_of(s, T_END)

    equation, state, stops = parts(ONES)
    times, checks = jnp.array([T_END]), Checks()
    _, _, tape, _ = eqx.filter_jit(recorded)(equation, MARCH, state, times, stops, checks)
    steps = int(tape.count)
    lengths, ends = np.diff(np.asarray(tape.t[: steps + 1])), tape.stop[:steps]
    assert np.sum(np.asarray(ends) >= 0) == 3  # both ends of the flank, and the last instant

    @jax.jit
    def again(scales):
        equation, state, stops = parts(scales)

        def step(carry, slot):
            t, y = carry
            length, stop = slot
            t_new = jnp.where(stop >= 0, jnp.append(stops, T_END)[stop], t + length)
            return (t_new, MARCH.step(equation, t, y, t_new)), None

        (_, y), _ = jax.lax.scan(step, (state.t, state.y), (lengths, ends))
        return jnp.sum(y.x[0, :3] ** 2) + jnp.sum(y.V_m[0, :3])

    def once(scales):
        equation, state, stops = parts(scales)
        y = advance(equation, MARCH, state, times, stops, checks)[0].y
        return jnp.sum(y.x[0, :3] ** 2) + jnp.sum(y.V_m[0, :3])

    value, gradient = jax.jit(jax.value_and_grad(once))(ONES)
    np.testing.assert_allclose(value, again(ONES), rtol=1e-12)
    h = 1e-3
    for i, e in enumerate(np.eye(len(ONES))):
        near, far = ((again(ONES + k * h * e) - again(ONES - k * h * e)) / (2 * k * h) for k in (1, 2))
        np.testing.assert_allclose(gradient[i], (4 * near - far) / 3, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("recorded", [64, None])
def test_what_is_saved_when_a_field_begins_to_fall_does_not_depend_on_when_that_is(recorded):
    """Though a step ends at the save, and one where the field begins to fall; what comes later does depend on it."""

    def deformations(end):
        field = dc_field(6.4, conductivity_ratio=0.1, history=Pulse(0.0, end, 5e-3))
        what = make_scene(shapes.ellipse(24, 0.9, angle=jnp.pi / 2), field=field)
        result = simulate(what, T_END, saves=2, march=Adaptive(1e-3, recorded=recorded))
        return result.diagnostics["deformation"][1:, 0]

    slopes = jax.jit(lambda end: jax.jvp(deformations, (end,), (1.0,))[1])
    at, just_after = slopes(T_END / 2), slopes(T_END / 2 + 1e-9)
    assert at[0] == just_after[0] == 0.0
    assert abs(at[1]) > 1e-3
    np.testing.assert_allclose(at[1], just_after[1], rtol=1e-4)


def test_lanes_of_a_batch_keep_to_themselves():
    """A quiet scene, a violent one of more steps, and one that is not a number: gradients as they are alone."""
    scales = jnp.array([[0.5, 1.0, 0.5, 1.0, 1.0], [1.0, 1.0, 6.0, 1.0, 1.0], [jnp.nan, 1.0, 1.0, 1.0, 1.0]])
    alone = jax.jit(jax.value_and_grad(outcome, has_aux=True))
    (values, (status, steps)), gradients = jax.jit(jax.vmap(jax.value_and_grad(outcome, has_aux=True)))(scales)
    assert steps[1] > steps[0] and not np.isfinite(values[2]) and status[2] > 0
    for i in range(2):
        (value, (code, count)), gradient = alone(scales[i])
        assert status[i] == code == 0 and steps[i] == count
        np.testing.assert_allclose(values[i], value, rtol=1e-10)
        np.testing.assert_allclose(gradients[i], gradient, rtol=1e-8, atol=1e-10)


def test_too_many_steps_for_the_record_are_named_as_such():
    def value(scales):
        result = simulate(scene(scales), T_END, saves=2, march=Adaptive(1e-3, recorded=5))
        return result.state.y.x[0, 0, 0], (result.status, result.t)

    _, (code, t) = jax.jit(value)(ONES)
    assert code == 0  # a run that is not differentiated records nothing
    _, (code, t) = jax.jit(jax.grad(value, has_aux=True))(ONES)
    assert status.WORDS[int(code)] == "too many steps" and np.isnan(t[-1])


@pytest.mark.slow
def test_second_derivatives_exist_and_are_symmetric():
    """Forward over reverse, along two directions."""

    def along(direction):
        return jax.jvp(lambda s: jax.grad(outcome, has_aux=True)(s)[0], (ONES,), (direction,))[1]

    u, v = jnp.eye(5)[0], jnp.array([0.0, 1.0, 0.5, -1.0, 0.5])
    second = jax.jit(along)
    H_u, H_v = second(u), second(v)
    assert np.all(np.isfinite(H_u)) and np.max(np.abs(H_u)) > 1e-3
    np.testing.assert_allclose(H_u @ v, H_v @ u, rtol=1e-8)
