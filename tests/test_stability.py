"""Growth rates of steady states, against closed forms near the circle and on it, and their derivatives."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import quasi_circular as q
from jaxves.analysis.disturbances import AXIS, CENTER
from jaxves.analysis.stability import stability
from jaxves.cli.stability_words import words
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.inputs.scene_files import parse, to_toml
from jaxves.observables.rotor import rotor_threshold
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.results.run_store import Record

CHI = 0.08


@eqx.filter_jit
def at_rest(area, ratio):
    """Without flow and field, 24 nodes."""
    x = shapes.ellipse(24, area)
    return stability(make_scene(x, viscosity_ratio=ratio), Unknowns.of(x[None]), count=6)


@pytest.mark.parametrize("ratio", [1.0, 4.0])
def test_a_nearly_round_vesicle_comes_to_rest_at_the_rates_of_the_circle(ratio):
    """-(k/4)(k² - 4)·2/(1+ν) for modes k = 3, 4, 5, with a deviation of the order 1 - Δ. Odd k break the half-turn."""
    k = np.array([3, 4, 5])
    exact = -0.25 * k * (k**2 - 4) * 2 / (1 + ratio)
    near, nearer = (at_rest(jnp.asarray(area), jnp.asarray(ratio)) for area in (0.98, 0.99))
    assert near.is_stable and nearer.is_stable
    deviation = [np.mean(found.rates.reshape(3, 2), axis=1) / exact - 1 for found in (near, nearer)]
    assert np.all(np.abs(deviation[1]) < 0.01)
    np.testing.assert_allclose(deviation[0] / deviation[1], 2.0, rtol=0.15)
    np.testing.assert_allclose(nearer.breaks[CENTER], np.repeat(k % 2, 2), atol=1e-6)
    shares = np.asarray(nearer.breaks[AXIS]).reshape(3, 2)
    np.testing.assert_allclose(np.sort(shares, axis=1), [[0.0, 1.0]] * 3, atol=1e-6)


def on_circle(beta, ratio, conductance, **more):
    """A circle of 16 nodes in a field along x, with what is left out of a scene None."""
    more = {name: jnp.asarray(value) for name, value in more.items()}
    return _on_circle(jnp.asarray(beta), jnp.asarray(ratio), jnp.asarray(conductance), more)


@eqx.filter_jit
def _on_circle(beta, ratio, conductance, more):
    def leading(beta):
        field = dc_field(
            beta, conductivity_ratio=ratio, membrane_conductance=conductance, chi=CHI, direction=(1.0, 0.0), **more
        )
        scene = make_scene(shapes.circle(16), field=field)
        names = ("Q", "W") if more else ("V_m",)
        found = stability(scene, Unknowns(scene.x, {name: jnp.zeros((1, 16)) for name in names}), count=6)
        return found.rates[0].real, found

    (_, found), slope = jax.value_and_grad(leading, has_aux=True)(beta)
    return found, slope


@pytest.mark.parametrize("beta", [0.5, 1.0, 3.0])
def test_a_charging_circle_has_the_rates_of_the_closed_form(beta):
    """With s = Λ/(1+Λ): s²β/χ(s+G) - (s+G)/χ for the charge across the field, which turns it; otherwise -(ks+G)/χ."""
    ratio, conductance = 0.4, 0.05
    s = ratio / (1 + ratio)
    found, slope = on_circle(beta, ratio, conductance)
    across = s**2 * beta / (CHI * (s + conductance)) - (s + conductance) / CHI
    exact = [across, *(-(k * s + conductance) / CHI for k in (1, 2, 2, 3, 3))]
    np.testing.assert_allclose(found.rates, np.sort(exact)[::-1], rtol=1e-9)
    assert bool(found.is_stable) == (across < 0)
    if across > 0:
        np.testing.assert_allclose(slope, s**2 / (CHI * (s + conductance)), rtol=1e-9)
        np.testing.assert_allclose([found.breaks[CENTER][0], found.breaks[AXIS][0]], [0.0, 1.0], atol=1e-9)
    assert np.all(np.abs(found.shapes) < 1e-9)  # a circle does not deform


@pytest.mark.parametrize(
    ("ratio", "conductance", "delta", "epsilon"), [(0.4, 0.2, 0.05, 1.0), (0.4, 0.2, 0.3, 0.5), (0.1, 3.0, 0.3, 2.0)]
)
def test_with_memory_of_charge_rest_is_neutral_at_the_threshold_of_rotation(ratio, conductance, delta, epsilon):
    """Other modes k have the roots of K_i K_e + (Y/k)(K_i + K_e), where these are Λ + sχδε, 1 + sχδ and G + sχ."""
    beta = rotor_threshold(ratio, conductance, delta=delta, permittivity_ratio=epsilon)
    found, _ = on_circle(beta, ratio, conductance, charge_relaxation=delta, permittivity_ratio=epsilon)
    memory = CHI * delta
    K_i, K_e, Y = (np.polynomial.Polynomial(c) for c in ((ratio, memory * epsilon), (1, memory), (conductance, CHI)))
    others = [(K_i * K_e + Y / k * (K_i + K_e)).roots().real for k in (1, *list(range(2, 8)) * 2)]
    exact = np.sort([0.0, *np.ravel(others)])[::-1][:6]
    np.testing.assert_allclose(found.rates.real, exact, rtol=1e-7, atol=1e-9)


def in_shear(numbers, area, start):
    """The leading rate, and all rates, of 32 nodes in shear and field. `numbers` are those of `quasi_circular`."""
    field = dc_field(
        numbers.beta,
        conductivity_ratio=numbers.ratio,
        membrane_conductance=numbers.conductance,
        chi=numbers.chi,
        direction=(jnp.cos(numbers.direction), jnp.sin(numbers.direction)),
    )
    scene = make_scene(shapes.ellipse(32, area), field=field, flow=Shear(numbers.shear))
    found = stability(scene, start, count=96)
    return found.rates[0].real, found


def steady_of_theory(numbers, area):
    """(ψ, V) of small-deformation theory, its growth rates, and a start near its state."""
    angle, V = q.solution(numbers, area, 0.7, 3.0)  # near the stable one of its steady states
    guess = jnp.stack([angle, V.real, V.imag])

    def rates(y):
        turning, charging = q.rates((y[0], y[1] + 1j * y[2]), numbers, area)
        return jnp.stack([turning, charging.real, charging.imag])

    slope = jax.jacfwd(rates)
    for _ in range(30):
        guess = guess - jnp.linalg.solve(slope(guess), rates(guess))
    x = shapes.ellipse(32, area, angle=guess[0])
    V = (guess[1] + 1j * guess[2]) * jnp.exp(1j * jnp.arctan2(x[:, 1], x[:, 0]))
    return np.linalg.eigvals(slope(guess)), Unknowns.of(x[None], 2 * V.real[None])


NUMBERS = q.Numbers(beta=2.0, ratio=0.3, conductance=0.2, shear=3.0, direction=1.2)
AREA = 0.9


@pytest.fixture(scope="module")
def analysed():
    """The analysis in shear and field with the gradient of the leading rate, compiled once."""
    return eqx.filter_jit(jax.value_and_grad(in_shear, argnums=(0, 1), has_aux=True))


def test_treading_in_shear_and_field_has_the_rates_of_small_deformation_theory(analysed):
    """The relative deviation falls like √(1-Δ), as that of steady values does."""
    deviation = []
    for area in (0.99, 0.995):
        exact, start = steady_of_theory(NUMBERS, area)
        (_, found), _ = analysed(as_arrays(NUMBERS), jnp.asarray(area), start)
        rates = np.asarray(found.rates)
        deviation.append([np.nanmin(np.abs(rates - rate)) / abs(rate) for rate in exact])
    assert np.max(deviation[1]) < 0.12, deviation
    ratio = np.linalg.norm(deviation[0]) / np.linalg.norm(deviation[1])
    assert 0.9 * np.sqrt(2) < ratio < 1.1 * np.sqrt(2), deviation


def as_arrays(numbers):
    return q.Numbers(*map(jnp.asarray, map(float, numbers)))


def test_derivatives_of_a_growth_rate_are_those_of_differences(analysed):
    """In all numbers and Δ at once, forward and reverse; the steady state changes with them."""
    pair = as_arrays(NUMBERS), jnp.asarray(AREA)
    _, start = steady_of_theory(NUMBERS, AREA)
    (_, found), gradient = analysed(*pair, start)
    start = found.steady.y
    way = jax.tree.map(jnp.asarray, (q.Numbers(1.0, 0.3, 0.1, -0.5, 0.2, 0.05), 0.02))
    parts = np.array(jax.tree.leaves(jax.tree.map(jnp.multiply, gradient, way)))
    size = np.sum(np.abs(parts))
    forward = jax.jit(lambda pair: jax.jvp(lambda pair: in_shear(*pair, start)[0], (pair,), (way,))[1])(pair)
    assert abs(np.sum(parts) - forward) < 1e-6 * size  # the pseudo-inverse amplifies round-off up to 1e9 times
    h = 1e-4
    ends = [jax.tree.map(lambda p, d, h=h: p + h * d, pair, way) for h in (h, -h)]
    high, low = (analysed(*end, start)[0][0] for end in ends)
    assert abs(forward - (high - low) / (2 * h)) < 1e-5 * size


def record_of(vesicle, state, **tables):
    """A result whose only saved time has this state."""
    tables = {"t_end": 1.0, "saves": 1, "vesicle": [vesicle], "numerics": {"nodes": 32}} | tables
    x, V_m = np.asarray(state.x)[None], np.asarray(state.scalars["V_m"])[None]
    zeros = np.zeros(x.shape[:3])
    scene = to_toml(parse(tables))
    return Record(np.ones(1), x, V_m, zeros, zeros[..., 0], None, {}, {}, None, {}, "complete", scene)


def test_a_run_is_shown_with_the_rate_at_which_its_last_state_is_left():
    """A circle in a field of three times its threshold, to the digits of the closed form; and what has no rate."""
    x = np.asarray(shapes.circle(32))
    charged = Unknowns.of(jnp.asarray(x[None]), jnp.asarray(2 * x[None, :, 0]))
    field = {"beta": 3.0, "conductivity_ratio": 0.4, "chi": CHI, "direction": [1.0, 0.0]}
    s = 0.4 / 1.4
    told = words(record_of({"shape": "circle"}, charged, field=field))
    rate = f"{2 * s / CHI:.3g}/t_kappa"  # G = 0: s (β - 1)/χ
    assert told == (
        f"steady state unstable: a disturbance grows at {rate}, in charge, breaking the symmetry in its axis (32 nodes)"
    )
    far = Unknowns.of(charged.x, -charged.scalars["V_m"])
    assert "not near a steady one" in words(record_of({"shape": "circle"}, far, field=field))
    sine = field | {"time": {"kind": "sine", "frequency": 2.0}}
    assert words(record_of({"shape": "circle"}, charged, field=sine)) == "stability: not known for a field that changes"
    pair = record_of({"shape": "circle"}, charged, field=field)
    vesicles = [{"reduced_area": 0.9, "center": [center, 0.0]} for center in (-3.0, 3.0)]
    two = to_toml(parse({"t_end": 1.0, "vesicle": vesicles, "field": field}))
    assert "several vesicles" in words(replace(pair, scene=two))
    assert words(replace(pair, t=np.zeros(0))) == "stability: not known without the last state of a run"


def test_a_state_that_is_not_steady_has_no_rates(analysed):
    numbers = as_arrays(NUMBERS._replace(beta=400.0, shear=0.0))
    x = shapes.ellipse(32, 0.3, angle=0.7)
    (_, found), _ = analysed(numbers, jnp.asarray(AREA), Unknowns.of(x[None], jnp.zeros((1, 32))))
    assert not found.steady.converged and not found.is_stable
    assert np.all(np.isnan(found.rates))
