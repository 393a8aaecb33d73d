"""Extremes over a membrane are those of the interpolant, wherever its nodes lie, and differentiable."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from jaxves.geometry import extremes, shapes
from jaxves.geometry.curve import Curve
from jaxves.inputs.scene_files import parse
from jaxves.numerics import fourier
from jaxves.runs.build import build
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

SHIFTS = (0.0, 0.13, 0.37, 0.5, 0.81)  # of the first node, in spacings


def sampled(curve, N, shift=0.0):
    """The nodes of curve(alpha), the first of them `shift` spacings on."""
    return jnp.asarray(curve(2 * np.pi * (np.arange(N) + shift) / N))


def ellipse(a, b):
    return lambda t: np.stack([a * np.cos(t), b * np.sin(t)], axis=-1)


def cassini(waist):
    """A dumbbell whose neck is 2·`waist` wide: r² = cos 2t + √(cos² 2t + waist⁴ + 2 waist²)."""

    def curve(t):
        c = np.cos(2 * t)
        r = np.sqrt(c + np.sqrt(c**2 + waist**4 + 2 * waist**2))
        return r[:, None] * np.stack([np.cos(t), np.sin(t)], axis=-1)

    return curve


@jax.jit
def greatest(f):
    return extremes.greatest(fourier.resample(f, 4 * f.shape[0]))


def band_limited(seed, modes):
    """A random function with this many modes, which fall off."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, modes + 1)) * 0.85 ** np.arange(modes + 1)
    k = np.arange(modes + 1)
    return lambda t: np.cos(np.outer(t, k)) @ a + np.sin(np.outer(t, k)) @ b


@pytest.mark.parametrize("seed", range(10))
def test_the_maximum_is_that_of_the_function_wherever_the_nodes_lie(seed):
    """Against 200,000 samples, whose largest is within (dt)²/8 of the curvature there."""
    f = band_limited(seed, 6 + seed)
    t = np.linspace(0, 2 * np.pi, 200_001)
    for N in (48, 64):
        for shift in SHIFTS:
            assert abs(float(greatest(sampled(f, N, shift))) - f(t).max()) < 1e-7 * np.ptp(f(t))


@pytest.mark.parametrize("N", [32, 48, 64])
@pytest.mark.parametrize("degrees", [0.0, 5.625, 17.0, 41.3, 90.0])
def test_the_potential_of_a_charging_circle_is_largest_along_the_field(N, degrees):
    """2Λ/(1+Λ)/r (1 - e^{-rt/χ}) with r = G + Λ/(1+Λ), also where no node lies along the field."""
    ratio, conductance, chi, t = 0.3, 0.7, 0.08, 0.5
    field = {"beta": 1e-6, "conductivity_ratio": ratio, "membrane_conductance": conductance, "chi": chi}
    field["direction"] = [np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))]
    tables = {"t_end": t, "vesicle": [{"shape": "circle"}], "field": field, "numerics": {"nodes": N}}
    result = simulate(build(parse(tables)), t, saves=1, march=Adaptive(1e-10))
    rate = conductance + ratio / (1 + ratio)
    expected = 2 * ratio / (1 + ratio) / rate * (1 - np.exp(-rate * t / chi))
    assert abs(result.diagnostics["max_V_m"][-1, 0] / expected - 1) < 1e-9


@pytest.mark.parametrize("shift", SHIFTS)
def test_curvature_and_tension_are_extreme_where_an_ellipse_is(shift):
    """|κ| up to a/b² at the tips; λ = σ + 3/2 κ_B κ² with σ = -3 between 3/2 κ_B b²/a⁴ - 3 and 3/2 κ_B a²/b⁴ - 3."""
    a, b, N = 1.3, 0.8, 96
    curve = Curve.from_nodes(sampled(ellipse(a, b), N, shift))
    found = jax.jit(extremes.over_membrane)(curve, jnp.full(N, -3.0), jnp.asarray(2.0), None)
    assert set(found) == {"tension_min", "tension_max", "max_curvature"}
    assert abs(found["max_curvature"] - a / b**2) < 1e-9
    assert abs(found["tension_max"] - (3 * (a / b**2) ** 2 - 3)) < 1e-9
    assert abs(found["tension_min"] - (3 * (b / a**2) ** 2 - 3)) < 1e-9


@pytest.mark.parametrize("shift", SHIFTS)
@pytest.mark.parametrize("turn", [0.0, 0.4, np.pi / 2])
def test_the_gap_of_two_ellipses_is_known_wherever_their_nodes_lie(shift, turn):
    """Side by side on the x axis, and both turned about the middle; tips are 0.05 apart."""
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array([[c, s], [-s, c]])
    first = sampled(ellipse(1.2, 0.7), 64, shift) - jnp.array([1.225, 0.0])
    second = sampled(ellipse(0.9, 0.9), 64, 0.3) + jnp.array([0.925, 0.0])
    found = jax.jit(extremes.gap)(Curve.from_nodes(first @ turned), Curve.from_nodes(second @ turned))
    assert abs(found - 0.05) < 1e-10


@pytest.mark.parametrize("waist", [0.1, 0.2, 0.4])
@pytest.mark.parametrize("shift", SHIFTS)
def test_the_neck_of_a_dumbbell_is_as_wide_as_it_is(waist, shift):
    N = {0.1: 256, 0.2: 128, 0.4: 96}[waist]
    x = shapes.equispaced(sampled(cassini(waist), 512, shift * 512 / N), N)
    width = 2 * float(cassini(waist)(np.array([np.pi / 2]))[0, 1])
    assert abs(jax.jit(extremes.self_gap)(Curve.from_nodes(x)) / width - 1) < 1e-4


def test_a_round_curve_has_no_neck():
    assert jnp.isinf(extremes.self_gap(Curve.from_nodes(shapes.circle(64))))


def lobed(c):
    """A curve whose lobes and place depend smoothly on c."""
    t = fourier.grid(64) + 0.02
    r = 1 + 0.2 * c[0] * jnp.cos(3 * t + 0.4) + 0.05 * c[1] * jnp.sin(2 * t)
    return r[:, None] * jnp.stack([1.2 * jnp.cos(t), 0.8 * jnp.sin(t)], axis=-1)


@pytest.mark.parametrize("quantity", ["tension_min", "tension_max", "max_curvature", "max_V_m"])
def test_extremes_are_differentiable_in_both_modes(quantity):
    @jax.jit
    def found(c):
        t = fourier.grid(64)
        curve, sigma = Curve.from_nodes(lobed(c)), 2 + c[2] * jnp.cos(t + 1.0)
        return extremes.over_membrane(curve, sigma, jnp.asarray(1.0), c[3] * jnp.sin(t - 0.3 * c[0]))[quantity]

    check_grads(found, (jnp.array([1.0, 0.7, 0.4, 1.3]),), order=2, modes=("fwd", "rev"), atol=1e-5, rtol=1e-5)


def test_gaps_are_differentiable_in_both_modes():
    @jax.jit
    def gap(c):
        return extremes.gap(
            Curve.from_nodes(lobed(c)),
            Curve.from_nodes(lobed(c[::-1]) + jnp.array([2.9, 0.0]) + c[2] * jnp.array([0.0, 1.0])),
        )

    check_grads(gap, (jnp.array([1.0, 0.7, 0.4, 1.3]),), order=1, modes=("fwd", "rev"), atol=1e-5, rtol=1e-5)

    @jax.jit
    def neck(c):
        t = fourier.grid(96) + 0.01
        r = 1 + 0.6 * c[0] * jnp.cos(2 * t) + 0.02 * c[1] * jnp.sin(3 * t)
        return extremes.self_gap(Curve.from_nodes(r[:, None] * jnp.stack([jnp.cos(t), jnp.sin(t)], axis=-1)))

    check_grads(neck, (jnp.array([1.0, 0.7]),), order=1, modes=("fwd", "rev"), atol=1e-5, rtol=1e-5)


def test_at_a_tie_the_derivative_is_finite():
    """cos 2α has two maxima, and a constant nothing but them."""
    for f in (sampled(lambda t: np.cos(2 * t), 64), jnp.ones(64), jnp.zeros(64)):
        slope = jax.grad(greatest)(f)
        assert bool(jnp.all(jnp.isfinite(slope))) and abs(jnp.sum(slope) - 1) < 1e-9
    circle = Curve.from_nodes(shapes.circle(32))
    slopes = jax.grad(lambda V: extremes.over_membrane(circle, V, jnp.asarray(1.0), V)["max_V_m"])(jnp.zeros(32))
    assert bool(jnp.all(jnp.isfinite(slopes)))
