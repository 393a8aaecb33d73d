"""Half-turns of a tumbling vesicle as functions of its numbers: exact series, a run, and derivatives of both."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_shear_motion import CA, T, rigid

from jaxves.analysis import half_turns, sensitivity
from jaxves.inputs.scene_files import parse
from jaxves.observables import shear_motion
from jaxves.runs.case import Case

N = 24


@jax.jit
def of_orbit(B):
    """Half a turn and ⟨cos 2θ⟩ of θ' = -(Ca/2)(1 - B cos 2θ)."""
    root = jnp.sqrt(1 - B**2)
    phase = -0.5 * CA * root * T
    whole = jnp.round(phase / np.pi)
    theta = jnp.arctan(jnp.sqrt((1 - B) / (1 + B)) * jnp.tan(phase - np.pi * whole)) + np.pi * whole
    window = half_turns.last_window(T, theta, 3)
    return jnp.stack([window.period, half_turns.over(T, window, jnp.cos(2 * theta), 3)])


def test_half_turns_and_averages_of_an_orbit_have_their_values_and_derivatives():
    """Both modes; an average over fixed times has another derivative, because the window does not move."""
    B, exact = 0.6, lambda B: jnp.stack([2 * np.pi / (CA * jnp.sqrt(1 - B**2)), (1 - jnp.sqrt(1 - B**2)) / B])
    np.testing.assert_allclose(of_orbit(B), exact(B), rtol=1e-5)
    for derivative in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(derivative(of_orbit)(B), jax.jacfwd(exact)(B), rtol=2e-4)


def test_the_windows_are_those_of_shear_motion():
    theta = rigid(T)
    window = half_turns.last_window(T, jnp.asarray(theta), 3)
    np.testing.assert_allclose(
        window.period, np.mean(np.diff(shear_motion.half_turns(T, theta).times)[-3:]), rtol=1e-12
    )
    values = np.stack([np.cos(2 * theta), np.sin(theta) ** 2], axis=1)
    np.testing.assert_allclose(
        half_turns.over(T, window, jnp.asarray(values), 3), shear_motion.average(T, theta, values, 3), rtol=1e-12
    )
    few = half_turns.last_window(T[:50], jnp.asarray(theta[:50]), 1)
    assert np.isnan(few.period) and np.isnan(half_turns.over(T[:50], few, jnp.asarray(values[:50]), 1)).all()


def scene(**flow):
    flow = {"kind": "shear", "capillary_number": 10.0} | flow
    tables = {"t_end": 1.0, "saves": 50, "vesicle": [{"reduced_area": 0.95}], "fluid": {"viscosity_ratio": 30.0}}
    return parse(tables | {"flow": flow, "numerics": {"nodes": N, "time_step": 0.01}})


def test_a_run_has_the_derivatives_of_differences():
    """Of half a turn and of [μ] in Ca, ν and Δ, where the end of the run cuts the turn at another angle each time."""
    outcome = half_turns.OverHalfTurns(scene())
    values = {"flow.capillary_number": 10.0, "fluid.viscosity_ratio": 30.0, "vesicle.reduced_area": 0.95}
    found, slopes = sensitivity.jacobian(outcome, values)
    result = jax.jit(lambda values: Case(scene()).simulate(values, saves=50, march=outcome._march()))(
        {name: jnp.asarray(value) for name, value in values.items()}
    )
    t, angle = np.asarray(result.t), np.asarray(result.diagnostics["inclination_unwrapped"][:, 0])
    viscosity = shear_motion.average(t, angle, np.asarray(result.diagnostics["effective_viscosity"]))
    np.testing.assert_allclose(found["effective_viscosity"], viscosity, rtol=1e-10)
    assert shear_motion.half_turns(t, angle).times.size > 1
    compiled = jax.jit(outcome)
    for name, value in values.items():
        h = 1e-3 * value if name != "vesicle.reduced_area" else 1e-4
        high, low = (compiled(values | {name: jnp.asarray(value + d)}) for d in (h, -h))
        for key in ("half_turn", "effective_viscosity"):
            difference = (high[key] - low[key]) / (2 * h)
            np.testing.assert_allclose(slopes[key][name], difference, rtol=2e-3, err_msg=f"{key} {name}")


def test_what_does_not_turn_in_shear_is_refused():
    constant = scene().model_copy(update={"flow": None})
    changing = scene(time={"kind": "sine", "frequency": 2.0})
    for file in (constant, changing):
        with pytest.raises(ValueError, match="expected one vesicle, not a circle, in a constant shear flow"):
            half_turns.OverHalfTurns(file)
    with pytest.raises(ValueError, match="turns = 0"):
        half_turns.OverHalfTurns(scene(), turns=0)
