"""Several vesicles with viscosities of their own: exact properties of their coupled motion, close and apart."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import diagnosed, motion_of

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.operators.pairs import Pairwise
from jaxves.operators.sums import MatrixFree
from jaxves.physics.flow import LinearFlow, Shear
from jaxves.physics.scene import make_scene

N = 64
RATIOS = jnp.array([0.05, 40.0])


def pair(ratio, separation=2.05, flow=None):
    """Two unlike vesicles; at the given separation they are closer than two node spacings."""
    x = [shapes.ellipse(N, 0.95, angle=0.4), shapes.ellipse(N, 0.9, angle=1.4)]
    centers = [[-0.5 * separation, 0.1], [0.5 * separation, -0.1]]
    return make_scene(x, centers=centers, flow=flow, viscosity_ratio=ratio)


@eqx.filter_jit
def moved(scene, force, imposed):
    equation = equation_for(scene)
    surfaces = equation.motion(jnp.zeros(()), Unknowns.of(scene.x)).surfaces
    return equation.mobility.at(surfaces).velocity(force, imposed), surfaces


def test_the_mobility_of_a_close_pair_is_self_adjoint_and_a_rigid_flow_passes_through():
    """Σ ∮ g·S_ν[f] ds is symmetric in f and g for different ν, which tests the cross terms and their factors."""
    scene = pair(RATIOS)
    alpha = 2 * np.pi * np.arange(N) / N
    f = jnp.moveaxis(jnp.array([[jnp.cos(2 * alpha), jnp.sin(alpha)], [jnp.sin(3 * alpha), 0 * alpha]]), 1, 2)
    g = jnp.moveaxis(jnp.array([[jnp.sin(alpha), jnp.cos(alpha)], [jnp.cos(alpha), jnp.sin(2 * alpha)]]), 1, 2)
    nothing = jnp.zeros_like(scene.x)
    of_f, surfaces = moved(scene, f, nothing)
    of_g, _ = moved(scene, g, nothing)
    assert bool(surfaces.interactions.any_near())
    weights = surfaces.curves.weights[..., None]
    forwards, backwards = jnp.sum(weights * g * of_f), jnp.sum(weights * f * of_g)
    np.testing.assert_allclose(forwards, backwards, rtol=1e-7)
    rigid = jnp.stack([0.3 - 0.7 * scene.x[..., 1], 0.2 + 0.7 * scene.x[..., 0]], axis=-1)
    np.testing.assert_allclose(moved(scene, nothing, rigid)[0], rigid, atol=1e-9)


def test_the_energy_balance_of_a_close_pair_closes():
    scene = pair(RATIOS, flow=LinearFlow([[1.0, 9.0], [-2.0, -1.0]]))
    found = diagnosed(scene, Unknowns.of(scene.x))
    assert found["residual"] < 1e-10 and found["dissipation"] > 0
    assert abs(found["power_balance"] / found["dissipation"]) < 1e-4


def test_ratios_of_one_are_one_viscosity():
    flow = Shear(3.0)
    one, none = pair(1.0, flow=flow), pair(None, flow=flow)
    y = Unknowns.of(one.x)
    velocity = motion_of(none, y).velocity
    np.testing.assert_allclose(motion_of(one, y).velocity, velocity, atol=1e-8 * jnp.max(jnp.abs(velocity)))


@pytest.mark.parametrize("separation", [2.05, 4.0])
def test_matrices_and_sums_give_the_same_motion(separation):
    scene = pair(RATIOS, separation, Shear(3.0))

    @jax.jit
    def velocity(scene):
        y, methods = Unknowns.of(scene.x), (Pairwise(direct=False), MatrixFree(1))
        return [equation_for(scene, coupling=how).motion(jnp.zeros(()), y).velocity for how in methods]

    one, other = velocity(scene)
    np.testing.assert_allclose(one, other, atol=1e-9 * jnp.max(jnp.abs(one)))


def test_the_motion_of_a_pair_has_equal_forward_and_reverse_derivatives_that_are_those_of_differences():
    scene = pair(RATIOS, 3.0, Shear(3.0))

    @jax.jit
    def found(ratio):
        def motion(ratio):
            s = eqx.tree_at(lambda s: s.viscosity_ratio, scene, RATIOS.at[1].set(ratio))
            velocity = equation_for(s).motion(jnp.zeros(()), Unknowns.of(s.x)).velocity
            return jnp.sum(velocity * s.x[::-1] ** 2)

        return *jax.jvp(motion, (ratio,), (jnp.ones(()),)), jax.grad(motion)(ratio)

    h = 1e-2
    (_, forward, reverse), (high, *_), (low, *_) = (found(RATIOS[1] + d) for d in (0.0, h, -h))
    np.testing.assert_allclose(forward, reverse, rtol=1e-7)
    np.testing.assert_allclose(forward, (high - low) / (2 * h), rtol=1e-5)
