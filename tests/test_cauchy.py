"""Cauchy integrals near and on the curve: holomorphic functions, jumps, sides, and derivatives at a node."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import circle, ellipse

from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.potentials.cauchy import CauchyRule, complex_of, real_of

DISTANCES = np.array([0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-3, 1e-2, 1e-1])


def five_star(N):
    t = 2 * np.pi * np.arange(N) / N
    return real_of(jnp.asarray((1 + 0.3 * np.cos(5 * t)) * np.exp(1j * t)))


CURVES = {"circle": (circle, 64), "ellipse": (lambda N: ellipse(N, 1.0, 0.25), 288), "star": (five_star, 240)}


@pytest.fixture(params=CURVES)
def curve(request):
    """Nodes of a curve, fine enough for the functions below."""
    make, N = CURVES[request.param]
    return make(N)


@partial(jax.jit, static_argnums=1)
def off_curve(x, side):
    """Points at every distance from some nodes, and from the curve half-way between nodes: (D·P, 2)."""
    fine = Curve.from_nodes(fourier.resample(x, 2 * x.shape[0], axis=0))
    return (fine.x[::7] + side * DISTANCES[:, None, None] * fine.normal[::7]).reshape(-1, 2)


@jax.jit
def holomorphic(z, inside):
    """Entire inside; one pole at 0.05, zero at infinity, outside. With its derivative."""
    pole = z - 0.05
    return jnp.where(inside, jnp.exp(z), 1 / pole), jnp.where(inside, jnp.exp(z), -1 / pole**2)


def test_boundary_values_continue_holomorphically_at_any_distance(curve):
    """Value and derivative, by continuation and as Cauchy integrals, from 0.1 down to the curve itself."""
    targets = jnp.concatenate([off_curve(curve, -1), off_curve(curve, 1)])
    inside = np.arange(len(targets)) < len(targets) // 2

    @jax.jit
    def found(x, targets):
        rule = CauchyRule.of(x, targets, inside=jnp.asarray(inside))
        matrix = rule.matrix()
        values = []
        for v in (holomorphic(complex_of(x), True)[0], -holomorphic(complex_of(x), False)[0]):
            dv = rule.d_dz(v)
            values.append([rule.continued(v), rule(v), matrix @ v, rule.continued(dv), rule(dv)])
        # C of exterior boundary values is minus the function
        return [jnp.where(inside, a, b * s) for a, b, s in zip(*values, (-1, 1, 1, -1, 1), strict=True)]

    value, slope = holomorphic(complex_of(targets), inside)
    got = found(curve, targets)
    for part in (inside, ~inside):
        for f in got[:3]:
            np.testing.assert_allclose(f[part], value[part], rtol=0, atol=1e-12 * np.max(np.abs(value[part])))
        for f in got[3:]:
            np.testing.assert_allclose(f[part], slope[part], rtol=0, atol=1e-11 * np.max(np.abs(slope[part])))


def test_the_integral_jumps_by_its_density(curve):
    """C inside minus C outside, both at the nodes, is τ; C[1] is 1 and 0."""

    @jax.jit
    def sides(x):
        density = jnp.exp(1j * complex_of(x)) / (complex_of(x) - 0.1)
        rules = [CauchyRule.of(x, x, inside=inside) for inside in (True, False)]
        return density, [rule(density) for rule in rules], [rule(density * 0 + 1) for rule in rules]

    density, (inner, outer), (one, zero) = sides(curve)
    np.testing.assert_allclose(inner - outer, density, atol=1e-11)
    np.testing.assert_allclose(one, 1, atol=1e-13)
    np.testing.assert_allclose(zero, 0, atol=1e-13)


def test_the_side_is_found_next_to_the_curve(curve):
    """Down to a distance of 1e-12; on a node the answer is outside."""
    sides = [off_curve(curve, side).reshape(len(DISTANCES), -1, 2)[1:].reshape(-1, 2) for side in (-1, 1)]
    found = jax.jit(lambda x, t: CauchyRule.of(x, t).inside)(curve, jnp.concatenate([*sides, curve]))
    assert np.all(found[: len(sides[0])]) and not np.any(found[len(sides[0]) :])


def test_derivatives_with_respect_to_targets_hold_down_to_a_node():
    """∂/∂x of the continuation of e^z is e^z, ∂/∂y is i e^z, forward and reverse."""
    x = ellipse(128)
    targets = jnp.stack([x[j] * (1 - d) for j in (5, 40) for d in (0.0, 1e-12, 1e-6, 1e-2)] + [0.5 * (x[7] + x[8])])

    def value(targets):
        rule = CauchyRule.of(x, targets, inside=True)
        return real_of(rule.continued(jnp.exp(complex_of(x)))), real_of(rule(jnp.exp(complex_of(x))))

    slope = jnp.exp(complex_of(targets))
    exact = jnp.stack([real_of(slope), real_of(1j * slope)], axis=-1)  # (target, component, direction)
    for jacobian in (jax.jacfwd, jax.jacrev):
        for found in jax.jit(jacobian(value))(targets):
            np.testing.assert_allclose(jnp.einsum("pcpd->pcd", found), exact, atol=1e-11)


def test_derivatives_with_respect_to_nodes_are_those_of_the_function():
    """Moving the nodes changes the integral as finite differences say, at distances 0.1 to 0."""
    x = ellipse(64)
    targets = jnp.concatenate([x[::16] * (1 - d) for d in (0.0, 1e-10, 1e-6, 1e-1)])

    @jax.jit
    def value(x):
        rule = CauchyRule.of(x, targets, inside=True)
        return real_of(rule(jnp.exp(1j * jnp.sin(2 * fourier.grid(64)))))

    direction = jnp.stack([jnp.sin(3 * x[:, 0]) + 0.01 * jnp.cos(31 * x[:, 1]), jnp.cos(2 * x[:, 1])], axis=-1)
    forward = jax.jit(lambda x: jax.jvp(value, (x,), (direction,))[1])(x)
    step = 1e-5 * direction
    np.testing.assert_allclose(forward, (value(x + step) - value(x - step)) / 2e-5, rtol=1e-6, atol=1e-8)
    weights = jnp.cos(jnp.arange(forward.size)).reshape(forward.shape)
    reverse = jax.jit(jax.grad(lambda x: jnp.sum(weights * value(x))))(x)
    np.testing.assert_allclose(jnp.sum(reverse * direction), jnp.sum(weights * forward), rtol=1e-12)
