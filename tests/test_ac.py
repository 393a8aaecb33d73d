"""AC fields: the averaged model on a circle in closed form, and its error against a run that resolves the field."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.inputs.checking import SceneError
from jaxves.inputs.scene_files import parse
from jaxves.physics.critical_frequency import critical_frequencies
from jaxves.physics.scene import dc_field, make_scene
from jaxves.physics.waveform import AC, Sine
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.loop import whole_periods
from jaxves.stepping.marching import simulate

N, CHI, BETA = 16, 0.08, 2.0


def amplitudes(omega, ratio, conductance, delta, epsilon):
    """c and b of the periodic state of a circle: E_n,i = c, E_n,e = 1 - b and V = 1 + b - c, times e^{iωt}."""
    s = 1j * omega
    K_i, K_e, Y = ratio + s * CHI * delta * epsilon, 1 + s * CHI * delta, conductance + s * CHI
    J = 2 / (1 / Y + 1 / K_i + 1 / K_e)
    return J / K_i, 1 - J / K_e


def elongating(b, c, epsilon):
    """P, the mean load of mode 2 that turns a vesicle along the field, with the share of the tangential traction."""
    return BETA / (16 * CHI) * (3 + abs(b) ** 2 - 3 * epsilon * abs(c) ** 2)


def of_circle(*numbers):
    """Calls `_of_circle` with arrays, so that it is compiled once."""
    return _of_circle(*map(jnp.asarray, numbers))


@eqx.filter_jit
def _of_circle(omega, ratio, conductance, epsilon, delta=None):
    """V_m's envelope at the start, and the modes N and τ of the mean traction of the force on the fluid."""
    field = dc_field(
        BETA, conductivity_ratio=ratio, membrane_conductance=conductance, chi=CHI, permittivity_ratio=epsilon,
        charge_relaxation=delta, direction=(1.0, 0.0), history=AC(omega / (2 * np.pi), averaged=True),
    )  # fmt: skip
    equation = equation_for(make_scene(shapes.circle(N), field=field))
    y = equation.start()
    motion = equation.motion(jnp.zeros(()), y)
    pure = {name: jnp.where(name.endswith(("_real", "_imag")), scalar, 0.0) for name, scalar in y.scalars.items()}
    motion = equation.motion(jnp.zeros(()), eqx.tree_at(lambda y: y.scalars, y, pure))
    curve = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
    force, theta = -motion.electric.traction[0], 2 * np.pi * jnp.arange(N) / N
    normal = jnp.sum(force * curve.normal, axis=-1) @ jnp.cos(2 * theta) / N
    tangential = 2 * jnp.sum(force * curve.tangent, axis=-1) @ jnp.sin(2 * theta) / N
    envelope = [rate for name, rate in motion.rates.items() if name.endswith(("_real", "_imag"))]
    at_rest = jnp.max(jnp.abs(jnp.stack(envelope)))
    return motion.electric.V_m_square[0], normal, tangential, at_rest


CASES = [(3.0, 0.3, 0.2, 0.6, 0.05), (40.0, 2.0, 0.0, 1.0, 0.3), (0.5, 0.1, 1.0, 2.0, 1e-3)]


@pytest.mark.parametrize(("omega", "ratio", "conductance", "epsilon", "delta"), CASES)
def test_the_periodic_state_and_the_mean_force_on_a_circle_are_those_of_the_closed_form(
    omega, ratio, conductance, epsilon, delta
):
    c, b = amplitudes(omega, ratio, conductance, delta, epsilon)
    square, normal, tangential, rate = of_circle(omega, ratio, conductance, epsilon, jnp.asarray(delta))
    cosine = np.cos(2 * np.pi * np.arange(N) / N)
    assert rate < 1e-8 * max(omega, 1 / (CHI * delta))
    np.testing.assert_allclose(square, 0.5 * abs(1 + b - c) ** 2 * cosine**2, atol=1e-10)
    np.testing.assert_allclose(normal, BETA / (8 * CHI) * (1 + abs(b) ** 2 - epsilon * abs(c) ** 2), rtol=1e-9)
    expected = BETA / (4 * CHI) * (abs(b) ** 2 - 1 + epsilon * abs(c) ** 2)
    np.testing.assert_allclose(tangential, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(normal - tangential / 4, elongating(b, c, epsilon), rtol=1e-8)


@pytest.mark.parametrize(("ratio", "epsilon"), [(0.1, 1.0), (0.5, 1.0), (0.3, 1.5)])
def test_the_load_changes_its_sign_at_the_first_critical_frequency(ratio, epsilon):
    """ω₁ = (Λ/χ)/√(3ε - 1 - Λ - Λ²) without charge relaxation and conductance."""
    omega = ratio / CHI / np.sqrt(3 * epsilon - 1 - ratio - ratio**2)
    loads = []
    for factor in (0.9, 1.0, 1.1):
        _, normal, tangential, _ = of_circle(factor * omega, ratio, 0.0, epsilon)
        loads.append(float(normal - tangential / 4))
    assert loads[0] > 0 > loads[2] and abs(loads[1]) < 1e-8 * loads[0]


def test_critical_frequencies_are_those_of_the_closed_forms():
    def first(ratio, epsilon):
        return ratio / CHI / np.sqrt(3 * epsilon - 1 - ratio - ratio**2)

    for ratio, epsilon in ((0.1, 1.0), (0.5, 1.0), (0.1, 0.6), (0.3, 1.5)):
        found = critical_frequencies(ratio, chi=CHI, permittivity_ratio=epsilon)
        np.testing.assert_allclose(found, [first(ratio, epsilon), np.inf], rtol=1e-12)
    assert np.all(np.isnan(critical_frequencies(2.0, chi=CHI)))
    delta, (ratio, epsilon) = 1e-5, (0.1, 0.6)
    second = np.sqrt(3 * epsilon - 1 - ratio - ratio**2) / (abs(1 - epsilon) * CHI * delta)
    found = critical_frequencies(ratio, chi=CHI, permittivity_ratio=epsilon, delta=delta)
    np.testing.assert_allclose(found, [first(ratio, epsilon), second], rtol=1e-3)


def test_both_critical_frequencies_and_their_derivatives_are_those_of_the_computed_load():
    """The load of the code vanishes there, and the zero moves with all numbers as the implicit function says."""
    numbers = jnp.array([0.3, 0.05, 0.6, 0.01])

    def zeros(numbers):
        ratio, conductance, epsilon, delta = numbers
        given = dict(chi=CHI, membrane_conductance=conductance, permittivity_ratio=epsilon, delta=delta)
        return critical_frequencies(ratio, **given)

    def load(numbers, omega):
        _, normal, tangential, _ = _of_circle(omega, *numbers[:3], numbers[3])
        return normal - tangential / 4

    slopes = jax.jit(jax.value_and_grad(load, argnums=(0, 1)))
    for omega, own in zip(zeros(numbers), jax.jacfwd(zeros)(numbers), strict=True):
        value, (along, across) = slopes(numbers, omega)
        assert abs(value) < 1e-9 * BETA / CHI
        np.testing.assert_allclose(own, -along / across, rtol=1e-6)


def test_the_load_changes_its_sign_again_at_the_second_critical_frequency():
    """ω₂ = √(3ε - 1 - Λ - Λ²)/(|1 - ε| χδ) for δ ≪ 1, where displacement currents shorten the membrane."""
    ratio, epsilon = 0.1, 0.6
    errors = []
    for delta in (1e-3, 1e-4):
        omega = np.sqrt(3 * epsilon - 1 - ratio - ratio**2) / (abs(1 - epsilon) * CHI * delta)
        loads = []
        for factor in (0.9, 1.0, 1.1):
            _, normal, tangential, _ = of_circle(factor * omega, ratio, 0.0, epsilon, jnp.asarray(delta))
            loads.append(float(normal - tangential / 4))
        assert loads[0] < 0 < loads[2]
        errors.append(abs(loads[1]) / loads[2])
    assert errors[1] < 0.2 * errors[0] < 0.02


def test_the_averaged_run_agrees_with_the_resolved_one_up_to_the_inverse_frequency():
    x = shapes.ellipse(32, 0.98, angle=1.0)
    march, t_end = Fixed(1), 0.05

    @eqx.filter_jit
    def end(frequency, averaged, steps):
        field = dc_field(8.0, conductivity_ratio=0.5, history=AC(frequency, averaged=averaged))
        equation = equation_for(make_scene(x, field=field))
        h = t_end / steps
        step = lambda i, y: march.step(equation, i * h, y, (i + 1) * h)  # noqa: E731
        return jax.lax.fori_loop(0, steps, step, equation.start()).x

    errors = []
    for frequency in (20.0, 40.0, 80.0):  # whole numbers of periods
        steps = jnp.asarray(int(16 * frequency * t_end))
        resolved, averaged = (end(jnp.asarray(frequency), flag, steps) for flag in (False, True))
        errors.append(float(jnp.max(jnp.abs(resolved - averaged))))
    slopes = np.diff(np.log2(errors))
    assert np.all(slopes < -0.8), (errors, slopes)


def test_steps_resolve_the_period_and_averages_take_whole_periods():
    field = dc_field(1.0, conductivity_ratio=0.5, history=AC(50.0))
    scene = make_scene(shapes.circle(N), field=field)
    np.testing.assert_allclose(whole_periods(scene, jnp.array([0.01, 0.1])), [0.01, 0.09])
    np.testing.assert_allclose(whole_periods(scene, jnp.array([0.01, 0.03])), [0.01, 0.03])
    run = eqx.filter_jit(lambda: simulate(scene, 0.1, saves=1, march=Adaptive(0.1, recorded=None)))
    assert int(run().state.steps) >= 40
    np.testing.assert_allclose(AC(3.0, 2.0, 0.5, 0.1)(0.2), Sine(3.0, 2.0, 0.5, 0.1 + np.pi / 2)(0.2), rtol=1e-12)


def test_files_have_the_kind_ac_and_refuse_steps_that_do_not_see_it():
    field = {"beta": 1.0, "conductivity_ratio": 0.1, "time": {"kind": "ac", "frequency": 10.0, "phase": 90.0}}
    tables = {"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}], "field": field}
    history = jaxves.scene_of(parse(tables), {}).field.history
    assert isinstance(history, AC) and not history.averaged
    np.testing.assert_allclose(history(0.01), -np.sin(0.2 * np.pi), rtol=1e-12)
    with pytest.raises(SceneError, match=re.escape("numerics.time_step = 0.013, expected at most 0.0125")):
        parse(tables | {"numerics": {"time_step": 0.013}})
    field["time"]["averaged"] = True
    assert jaxves.scene_of(parse(tables | {"numerics": {"time_step": 0.013}}), {}).field.history.averaged
    with pytest.raises(SceneError, match=re.escape("numerics.method")):
        parse(tables | {"numerics": {"time_step": 0.01, "method": "euler"}})


@eqx.filter_jit
def _periodic(ratio):
    """Returns the complex envelope of V_m at the start of an ellipse."""
    history = AC(jnp.asarray(100.0), averaged=True)
    field = dc_field(BETA, conductivity_ratio=ratio, history=history)
    y = equation_for(make_scene(shapes.ellipse(32, 0.9, angle=1.0), field=field)).start()
    return y.scalars["V_m_real"] + 1j * y.scalars["V_m_imag"]


def test_no_net_potential_arises_on_a_perfect_conductor():
    """The equation for the field leaves it open there, so that round-off once grew to V_m = 0.04."""
    perfect, good = _periodic(jnp.asarray(jnp.inf)), _periodic(jnp.asarray(1e7))
    size = float(jnp.max(jnp.abs(perfect)))
    assert abs(complex(jnp.mean(perfect))) < 1e-12 < 1e-2 < size
    np.testing.assert_allclose(perfect, good, atol=1e-6 * size)
