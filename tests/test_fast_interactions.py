"""Interactions by fast sums are those by direct sums, with near pairs, and where lists are too short."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base import status
from jaxves.equation.state import verdict
from jaxves.ewald.plans import plan_for
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.geometry.domain import Free
from jaxves.operators.direct_sums import Summation
from jaxves.operators.fast_sums import FastSummation
from jaxves.operators.interactions import NEAR, SOLVED
from jaxves.operators.near_pairs import NearPairs
from jaxves.operators.sums import MatrixFree, accuracy_of_sums, coupling_for, coupling_in_cell, residual_of_systems

M, N = 16, 32
RNG = np.random.default_rng(5)


@jax.jit
def nodes():
    """Ellipses in four rows, turned at random; some neighbours are closer than a node spacing."""
    turns, ellipse = jnp.asarray(RNG.uniform(0, np.pi, M)), shapes.ellipse(N, 0.9)
    places = jnp.asarray(np.stack(np.divmod(np.arange(M), 4), axis=-1) * 2.45)
    return jax.vmap(shapes.rotated, in_axes=(None, 0))(ellipse, turns) + places[:, None]


X = nodes()
F, Q = jnp.asarray(RNG.normal(size=(M, N, 2))), jnp.asarray(RNG.normal(size=(M, N)))
PLAN = plan_for(M, N, 1e-12)


@eqx.filter_jit
def found(x, plan):
    """Velocities, gradients, near pairs and `crowded`: directly without a plan."""
    curves = jax.vmap(Curve.from_nodes)(x)
    near = NearPairs.of(curves, 8, NEAR, Free())
    if plan is None:
        across = Summation.of(curves, near, None, electric=True)
    else:
        across = FastSummation.of(curves, near, plan, Free(), electric=True)
    return across.stokes(F), across.slp_gradient(Q), jnp.sum(across.near.valid), across.crowded


@pytest.mark.parametrize("plan", [PLAN, PLAN._replace(room=4)], ids=["fast", "lists too short"])
def test_fast_interactions_are_the_direct_ones(plan):
    *wanted, near, _ = found(X, None)
    *values, also, crowded = found(X, plan)
    assert near == also > 20
    assert not crowded
    for value, exact in zip(values, wanted, strict=True):
        np.testing.assert_allclose(value, exact, atol=1e-12 * np.max(np.abs(exact)))


def test_the_derivative_of_fast_interactions_is_that_of_direct_ones():
    push = jnp.asarray(RNG.normal(size=X.shape))

    @eqx.filter_jit
    def slopes(plan):
        def work(x):
            velocity, gradient, *_ = found(x, plan)
            return jnp.sum(F * velocity) + jnp.sum(jnp.sin(gradient))

        return jax.jvp(work, (X,), (push,))[1], jnp.sum(jax.grad(work)(X) * push)

    forward, reverse = slopes(PLAN)
    np.testing.assert_allclose(forward, reverse, rtol=1e-11)
    np.testing.assert_allclose(forward, slopes(None)[0], rtol=1e-9)


def test_many_nodes_are_summed_fast():
    assert coupling_for(32, 64).accuracy is None
    assert coupling_for(64, 64).accuracy == 1e-10


def test_systems_are_solved_and_judged_as_the_steps_need_it():
    """A tolerance of 1e-4 asks for a residual of 1e-5, which would be too large where nothing asks for it."""
    assert MatrixFree(accuracy=1e-6).tolerance() == pytest.approx(1e-7)
    assert MatrixFree().tolerance() == SOLVED
    coupling = coupling_in_cell(accuracy=accuracy_of_sums(1e-4), solved=residual_of_systems(1e-4))
    assert coupling.tolerance() == pytest.approx(1e-5)
    residual = jnp.asarray(5e-5)
    assert verdict(residual, coupling) == status.RUNNING
    assert verdict(3 * residual, coupling) == verdict(residual, None) == status.SOLVE_FAILED
    assert verdict(jnp.asarray(jnp.inf), coupling) == status.CROWDED


def test_fast_sums_refuse_several_devices():
    mesh = jax.make_mesh((1,), ("targets",))
    with pytest.raises(ValueError, match="no mesh together with an accuracy"):
        MatrixFree(mesh=mesh, accuracy=1e-6)
