"""The Stokes double layer away from its curve, and velocity and pressure around a vesicle with another viscosity."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ellipse

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.observables.fields import fields_at
from jaxves.physics.flow import LinearFlow
from jaxves.physics.scene import make_scene
from jaxves.potentials import close_stokes, far, kernels
from jaxves.potentials.close_laplace import CloseGeometry

N = 96
SOURCE, FORCE = jnp.array([2.5, 1.0]), jnp.array([0.7, -0.4])  # a point force outside of the ellipse


def near_and_far(c, distances=(1e-10, 1e-3, 0.05, 0.4)):
    """Points at these distances inside and outside of some nodes."""
    x, n = c.x[::12], c.normal[::12]
    return [jnp.concatenate([x + side * d * n for d in distances]) for side in (-1, 1)]


@jax.jit
def outside_force(points):
    """Velocity and pressure of the point force: a Stokes flow inside of the ellipse."""
    r = points - SOURCE
    return kernels.stokeslet(r) @ FORCE, kernels.stokeslet_pressure(r) @ FORCE


@jax.jit
def green(c, points):
    """S[t] - D[u] and its pressure, for the velocity u and the traction t of that flow on the curve."""
    (u, p), gradient = outside_force(c.x), jax.vmap(jax.jacfwd(lambda x: outside_force(x[None])[0][0]))(c.x)
    strain = gradient + jnp.swapaxes(gradient, 1, 2)
    t = jnp.einsum("nab,nb->na", strain, c.normal) - p[:, None] * c.normal
    close = CloseGeometry.of(c, points)
    velocity = close_stokes.stokes_slp(close, t) - close_stokes.stokes_dlp(close, u)
    return velocity, close_stokes.stokes_slp_pressure(close, t) - close_stokes.stokes_dlp_pressure(close, u)


def test_greens_identity_gives_velocity_and_pressure_inside_and_zero_outside():
    c = Curve.from_nodes(ellipse(N))
    inside, outside = near_and_far(c)
    velocity, pressure = green(c, inside)
    u, p = outside_force(inside)
    np.testing.assert_allclose(velocity, u, atol=1e-11)
    np.testing.assert_allclose(pressure, p, atol=1e-9)
    velocity, pressure = green(c, outside)
    np.testing.assert_allclose(velocity, 0.0, atol=1e-11)
    np.testing.assert_allclose(pressure, 0.0, atol=1e-9)


def test_the_trapezoidal_rule_and_the_matrix_give_the_same_as_close_evaluation():
    c = Curve.from_nodes(ellipse(N))
    alpha = 2 * np.pi * np.arange(N) / N
    u = jnp.stack([jnp.exp(jnp.sin(alpha)), jnp.cos(2 * alpha)], axis=-1)
    away = jnp.array([[3.0, 0.5], [-1.0, 2.5], [0.0, 4.0]])

    @jax.jit
    def all_ways(points):
        close, curves = CloseGeometry.of(c, points), jax.tree.map(lambda leaf: leaf[None], c)
        closely = close_stokes.stokes_dlp(close, u), close_stokes.stokes_dlp_pressure(close, u)
        widely = far.stokes_dlp(curves, u[None], points), far.stokes_dlp_pressure(curves, u[None], points)
        return closely, widely, close_stokes.stokes_dlp_matrix(close) @ u

    closely, widely, _ = all_ways(away)
    for one, other in zip(closely, widely, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-13)
    for points in near_and_far(c):
        closely, _, product = all_ways(points)
        np.testing.assert_allclose(product, closely[0], atol=1e-12)


@pytest.mark.parametrize("ratio", [1e-3, 5.0, 1e6])
def test_velocity_and_pressure_next_to_the_membrane_are_those_of_its_motion_and_its_force(ratio):
    """The velocity is continuous and that of the nodes, up to their filter; f·n is the jump of the pressure.

    On a membrane that does not stretch ∂_n v_n = -t·∂_s v = 0 on both sides, so the pressure is the normal stress.
    """
    flow = LinearFlow([[1.0, 9.0], [-2.0, -1.0]])
    s = make_scene(shapes.ellipse(N, 0.9, angle=0.4), flow=flow, viscosity_ratio=ratio)
    motion, (inner, outer) = both(equation_for(s), Unknowns.of(s.x))
    velocity = motion.velocity[0, ::12]
    size = float(jnp.max(jnp.abs(velocity)))
    np.testing.assert_allclose(inner.velocity[:8], outer.velocity[:8], atol=1e-7 * size)
    np.testing.assert_allclose(inner.velocity[:8], velocity, atol=1e-3 * size)
    assert np.all(inner.inside == 0) and np.all(outer.inside == -1)
    n = motion.surfaces.curves.normal[0, ::12]
    jump = outer.pressure[:8] - inner.pressure[:8]
    force = jnp.sum(motion.f_hd[0, ::12] * n, axis=-1)
    np.testing.assert_allclose(jump, force, atol=1e-5 * float(jnp.max(jnp.abs(force))))


@jax.jit
def both(equation, y):
    c = jax.tree.map(lambda leaf: leaf[0], equation.motion(jnp.zeros(()), y).surfaces.curves)
    return equation.motion(jnp.zeros(()), y), [fields_at(equation, 0.0, y, p) for p in near_and_far(c)]
