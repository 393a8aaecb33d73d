"""Rotation of a circular vesicle by its own charge, against closed forms: steady turning, and when rest is unstable."""

import json

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from experiments._common import HERE
from experiments.rotor import growth
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.observables.of_suspension import stress
from jaxves.observables.rotor import rotor_threshold, threshold_of
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene

N, CHI = 16, 0.08
CIRCLE = np.asarray(shapes.circle(N))


def amplitudes(s, ratio, conductance, delta, epsilon):
    """c and b for charge that changes like e^{st}: E_n,i = c, E_n,e = 1 - b and V = 1 + b - c."""
    K_i, K_e, Y = ratio + s * CHI * delta * epsilon, 1 + s * CHI * delta, conductance + s * CHI
    # J = 2/(1/Y + 1/K_i + 1/K_e), without dividing by Y, which may be zero
    J = 2 * Y * K_i * K_e / (K_i * K_e + Y * (K_i + K_e))
    return J / K_i, 1 - J / K_e


def scalars(s, ratio, conductance, delta, epsilon):
    """The complex amplitudes of Q and W."""
    c, b = amplitudes(s, ratio, conductance, delta, epsilon)
    return 1 - b - epsilon * c, 1 + b - c - 0.5 * delta * (epsilon * c + 1 - b)


def speed(beta, Ca, ratio, conductance, delta, epsilon, low, high):
    """Ω from the balance of torques, 2(Ω + Ca/2) = -(β/χ) Im b(iΩ)."""

    def lacking(omega):
        return 2 * (omega + Ca / 2) + beta / CHI * amplitudes(1j * omega, ratio, conductance, delta, epsilon)[1].imag

    return brentq(lacking, low, high, xtol=1e-13)


def on_circle(*numbers):
    """Calls `_on_circle` with arrays, so that it is compiled once."""
    return _on_circle(*map(jnp.asarray, numbers))


@eqx.filter_jit
def _on_circle(beta, Ca, ratio, conductance, delta, epsilon, Q, W):
    """Angular velocity, rates of Q and W at fixed places, stress; Q and W are (N,) on a circle, the field along x."""
    field = dc_field(
        beta, conductivity_ratio=ratio, membrane_conductance=conductance, chi=CHI, charge_relaxation=delta,
        permittivity_ratio=epsilon, direction=(1.0, 0.0),
    )  # fmt: skip
    equation = equation_for(make_scene(jnp.asarray(CIRCLE), field=field, flow=Shear(Ca)), keep_symmetry=False)
    y = Unknowns(equation.scene.x, {"Q": Q[None], "W": W[None]})
    motion = equation.motion(jnp.zeros(()), y)
    turning = jnp.mean(jnp.sum(motion.velocity[0] * motion.surfaces.curves.tangent[0], axis=-1))
    rates = {name: motion.rates[name] - turning * motion.surfaces.d_ds(y.scalars[name]) for name in y.scalars}
    return turning, jnp.concatenate([rates["Q"][0], rates["W"][0]]), stress(motion, equation.scene)


def wave(amplitude):
    """Re[amplitude e^{iθ}]. At rest in the laboratory it changes like e^{iΩt} at material points that turn with Ω."""
    return jnp.asarray((amplitude * (CIRCLE[:, 0] + 1j * CIRCLE[:, 1])).real)


@pytest.mark.parametrize(
    ("delta", "omega", "viscosity"),
    [(0.01, -5.25502, 1.94900), (0.1, -9.05335, 1.18933), (0.3, -19.07932, -0.81586)],
)
def test_a_circle_in_shear_and_field_turns_steadily_and_memory_of_charge_lowers_the_viscosity(delta, omega, viscosity):
    numbers = dict(ratio=0.1, conductance=4.0, delta=delta, epsilon=1.0)
    exact = speed(6.4, 10.0, **numbers, low=-40.0, high=-5.0)
    assert abs(exact - omega) < 1e-5
    Q, W = (wave(amplitude) for amplitude in scalars(1j * exact, **numbers))
    turning, rates, tensor = on_circle(6.4, 10.0, *numbers.values(), Q, W)
    np.testing.assert_allclose(turning, exact, rtol=1e-10)
    np.testing.assert_allclose(rates, 0.0, atol=1e-8)
    np.testing.assert_allclose(tensor[0, 1] / 10.0, 3 + 2 * exact / 10.0, rtol=1e-9)
    assert abs(tensor[0, 1] / 10.0 - viscosity) < 1e-5


def threshold(ratio, conductance, delta, epsilon):
    return rotor_threshold(ratio, conductance, delta=delta, permittivity_ratio=epsilon)


def test_limits_of_the_threshold():
    """The paper's model, the rotor without membrane (Re_E = βδ), and a vesicle with a capacitance of its own."""
    np.testing.assert_allclose(rotor_threshold(0.5, 0.2), (1 + 0.2 * 1.5 / 0.5) ** 2)
    np.testing.assert_allclose(0.1 * threshold(0.5, 1e9, 0.1, 2.0), 1.5**2 / 1.5, rtol=1e-6)
    field = {"chi": 0.1, "conductivity_ratio": 0.5, "membrane_conductance": 0.2, "permittivity_ratio": 1.0}
    tables = {"field": field | {"charge_relaxation": 0.02}, "vesicle": [{"chi": 0.2}]}
    np.testing.assert_allclose(threshold_of(tables), 0.5 * threshold(0.5, 0.2, 0.01, 1.0))
    assert threshold_of({"vesicle": [{}]}) is None


def growth_matrix(*numbers):
    """Calls `_growth_matrix` with arrays, so that it is compiled once."""
    return _growth_matrix(*map(jnp.asarray, numbers))


@eqx.filter_jit
def _growth_matrix(beta, ratio, conductance, delta, epsilon, Q0, W0):
    """The linear map of disturbances of Q and W across the field to their rates, (2, 2)."""
    sine, cosine = jnp.asarray(CIRCLE[:, 1]), jnp.asarray(CIRCLE[:, 0])

    def rates(Q1, W1):
        Q, W = Q0 * cosine + Q1 * sine, W0 * cosine + W1 * sine
        found = on_circle(beta, 1e-9, ratio, conductance, delta, epsilon, Q, W)[1]
        return 2 * found.reshape(2, N) @ sine / N

    return jnp.stack(jax.jacfwd(rates, argnums=(0, 1))(0.0, 0.0), axis=1)


CASES = [  # Λ, G, δ, ε
    (0.1, 0.0, 0.01, 1.0), (0.5, 0.0, 0.3, 0.5), (3.0, 0.0, 0.07, 2.0),
    (0.1, 0.2, 0.007, 1.0), (0.5, 0.5, 0.01, 1.0), (2.0, 0.1, 0.05, 0.5),
    (0.5, 1e5, 0.07, 1.0), (0.1, 1e5, 0.3, 2.0), (0.3, 3.0, 0.5, 4.0),
    (1.5, 8.0, 0.2, 0.5), (0.5, 10.0, 0.3, 0.3), (2.0, 1e5, 0.07, 1.0),
]  # fmt: skip


def test_rest_becomes_unstable_to_rotation_at_the_threshold_and_only_there():
    thresholds = [threshold(*case) for case in CASES]
    assert sum(np.isinf(thresholds)) >= 3 and np.allclose(thresholds[:3], 1.0)
    for case, beta in zip(CASES, thresholds, strict=True):
        Q0, W0 = scalars(0.0, *case)
        for factor in (0.999, 1.001) if np.isfinite(beta) else (1.0, 100.0):
            field = factor * beta if np.isfinite(beta) else factor
            rates = np.linalg.eigvals(growth_matrix(field, *case, Q0, W0))
            unstable = np.isfinite(beta) and factor > 1
            assert (np.max(rates.real) > 0) == unstable, (case, beta, field, rates)


@pytest.mark.parametrize("case", CASES[:2] + CASES[6:8])
def test_beyond_the_threshold_a_circle_turns_by_itself_with_the_speed_of_the_closed_form(case):
    beta = 1.5 * threshold(*case)
    omega = speed(beta, 0.0, *case, low=1e-3, high=1e5)
    if case[1] == 0.0 and case[2] < 0.02:  # fast relaxation: ±√(β-1) Λ/((1+Λ)χ)
        np.testing.assert_allclose(omega, np.sqrt(beta - 1) * case[0] / ((1 + case[0]) * CHI), rtol=0.05)
    Q, W = (wave(amplitude) for amplitude in scalars(1j * omega, *case))
    turning, rates, _ = on_circle(beta, 1e-9, *case, Q, W)
    np.testing.assert_allclose(turning, omega, rtol=1e-7)
    np.testing.assert_allclose(rates, 0.0, atol=1e-6 * omega)


def test_the_growth_of_stored_runs_is_that_of_the_linear_theory():
    rows = json.loads((HERE / "data" / "rotor.json").read_text())["data"]["alone"]
    grown = {beta: (row["growth"], row["rates"][0][0]) for beta, row in rows.items() if row["rates"][0][0] > 0}
    assert len(grown) == 3 and rows["0.8"]["rates"][0][0] < 0
    for measured, rate in grown.values():
        np.testing.assert_allclose(measured, rate, rtol=1e-3)


def test_growth_is_read_from_the_times_at_which_a_value_is_small():
    t = np.linspace(0, 8, 400)
    np.testing.assert_allclose(growth(t, np.tanh(1e-6 * np.exp(3 * t))), 3.0, rtol=1e-4)
    assert np.isnan(growth(t, np.full(400, 1e-9)))
