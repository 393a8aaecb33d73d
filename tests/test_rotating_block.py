"""The linear part for many nodes, on N + 2 unknowns, is that of the dense matrix, to round-off."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation import shape_block as choice
from jaxves.equation.equation import equation_for
from jaxves.equation.projection import Filter
from jaxves.equation.rotating_block import RotatingBlock
from jaxves.equation.shape_block import shape_block
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.physics.flow import Extension
from jaxves.physics.scene import dc_field, make_scene
from jaxves.potentials.self_refined import Refinement
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

N = 32


def solutions(equation, x, r, c):
    """Returns (1 - c A)⁻¹ r by the dense matrix and by rotations."""
    frozen = equation.freeze(jnp.zeros(()), Unknowns(x))
    motion, surfaces = frozen.motion, frozen.motion.surfaces

    def one(tree):
        return jax.tree.map(lambda leaf: leaf[0], tree)

    own, rest = (
        (one(surfaces.curves), one(surfaces.stokes_slp)),
        (motion.sigma[0], jnp.asarray(1.3), one(frozen.constraint)),
    )
    cuts = dict(cut=equation.filter.x, surface_cut=equation.filter.surface)
    A = shape_block(*own, *rest, None, **cuts)
    dense = jnp.linalg.solve(jnp.eye(2 * N) - c * A, r.T.reshape(-1)).reshape(2, N).T
    return dense, RotatingBlock.of(*own, surfaces.laplace_slp[0], *rest, **cuts).factored(c).solve(r)


def folded():
    """A peanut whose sides are less than four node spacings apart, so that the kernels are refined."""
    phi = 2 * np.pi * np.arange(512) / 512
    x = jnp.asarray(np.stack([1.6 * np.cos(phi), (0.12 + 0.5 * np.cos(phi) ** 2) * np.sin(phi)], axis=1))
    return shapes.equispaced(x, N)


CASES = {
    "compressed": (shapes.ellipse(N, 0.9, angle=0.4), Filter(2), Refinement((1,))),
    "circle": (shapes.circle(N), Filter(2), Refinement((1,))),
    "narrow": (folded(), Filter(2), Refinement((1, 8))),
    "more modes filtered": (shapes.ellipse(N, 0.7), Filter(5, 3), Refinement((1,))),
}


@pytest.mark.parametrize("name", CASES)
def test_rotations_give_the_solution_of_the_dense_matrix(name):
    x, filter, refinement = CASES[name]
    scene = make_scene(x, flow=Extension(200.0))
    equation = equation_for(scene, filter=filter, refinement=refinement)
    r = jnp.asarray(np.random.default_rng(0).normal(size=(N, 2)))

    def both(x, c):
        return solutions(equation, x, r, c)

    run = jax.jit(lambda x, dx, c: jax.jvp(both, (x, c), (dx, c)))
    dx = jnp.asarray(np.random.default_rng(1).normal(size=scene.x.shape))
    for c in (1e-6, 1e-3, 1.0):
        (dense, found), (d_dense, d_found) = run(scene.x, dx, jnp.asarray(c))
        scale = np.max(np.abs(dense - r))
        assert scale > 1e-4
        np.testing.assert_allclose(found, dense, atol=1e-10 * scale)
        np.testing.assert_allclose(d_found, d_dense, atol=1e-9 * np.max(np.abs(d_dense)))


def test_many_nodes_use_rotations_and_two_viscosities_do_not():
    def form(N, **more):
        scene = make_scene(shapes.ellipse(N, 0.9), field=dc_field(1.0, conductivity_ratio=0.1), **more)
        equation = equation_for(scene)
        y = Unknowns.of(scene.x, jnp.zeros((1, N)))
        return eqx.filter_eval_shape(equation.freeze, jnp.zeros(()), y).A_x

    assert isinstance(form(128), RotatingBlock) and form(128).response.shape == (1, 130, 130)
    assert form(64).shape == (1, 128, 128)
    assert form(128, viscosity_ratio=2.0).shape == (1, 256, 256)


def test_a_run_with_many_nodes_is_that_of_the_dense_matrix(monkeypatch):
    """The states of both forms agree to round-off, times what the stiffest mode amplifies, after some steps."""
    scene = make_scene(shapes.ellipse(N, 0.9, angle=0.4), flow=Extension(20.0))
    found = []
    for many in (N, 2 * N):
        monkeypatch.setattr(choice, "_MANY", many)
        found.append(simulate(scene, 0.02, saves=1, march=Fixed(4)))
    assert found[0].word == "complete" and np.max(np.abs(found[0].x[-1] - scene.x)) > 0.05
    np.testing.assert_allclose(found[0].x, found[1].x, atol=1e-11)
