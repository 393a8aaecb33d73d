"""The frozen part of near membranes as one matrix: what it leaves to explicit stages, when it is used, derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

from jaxves.equation.equation import equation_for
from jaxves.equation.implicit import Shifted
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.numerics import fourier, linear
from jaxves.physics.scene import dc_field, make_scene

N = 48


def pair(gap):
    """Two ellipses along the field, tip to tip."""
    ellipse = shapes.ellipse(N, 0.9, angle=jnp.pi / 2)
    reach = 2 * jnp.max(ellipse[:, 1]) + gap
    centers = jnp.stack([jnp.zeros(2), jnp.array([0.0, 1.0]) * reach])
    scene = make_scene([ellipse] * 2, centers=centers, field=dc_field(3.2, conductivity_ratio=0.1, vesicles=2))
    return equation_for(scene), Unknowns.of(scene.x, jnp.zeros((2, N)))


@eqx.filter_jit
def frozen_of(equation, y):
    return equation.freeze(jnp.zeros(()), y)


def columns(x):
    return jnp.swapaxes(x, 1, 2).reshape(-1)


def test_a_film_is_not_left_to_explicit_stages():
    """What blocks leave of dF/dx grows with the bending of the film; what one matrix leaves, a tenth as fast."""
    equation, y = pair(0.05)

    @jax.jit
    def jacobian(c):
        def rate(c):
            x = jnp.swapaxes(c.reshape(2, 2, N), 1, 2)
            return columns(equation.rate(jnp.zeros(()), Unknowns.of(x, y.V_m)).x)

        return jax.jacfwd(rate)(c)

    J = jacobian(columns(y.x)) @ np.kron(np.eye(4), fourier.low_pass_matrix(N, equation.filter.x))
    frozen = frozen_of(equation, y)

    def fastest(left):
        return np.max(np.linalg.eigvals(left).real)

    assert fastest(J - frozen.A_all) < 0.1 * fastest(J - scipy.linalg.block_diag(*frozen.A_x))


def test_far_membranes_take_a_block_each():
    """No matrix of all is formed, and each block is solved with alone."""
    frozen = frozen_of(*pair(2.0))
    assert not np.any(frozen.A_all)
    b = jnp.sin(jnp.arange(4.0 * N)).reshape(2, N, 2)
    c = jnp.asarray(0.01)
    charge_free = eqx.tree_at(lambda f: (f.A_scalars, f.below), frozen, (None, None))
    x = eqx.filter_jit(lambda frozen: frozen.implicit(c).solve(Unknowns.of(b)).x)(charge_free)
    parts = zip(frozen.A_x, columns(x).reshape(2, -1), columns(b).reshape(2, -1), strict=True)
    for A, x, b in parts:
        np.testing.assert_allclose(x - c * A @ x, b, atol=1e-10)


def test_derivatives_hold_on_both_sides_of_the_branch():
    """Under vmap, where both sides are computed: implicit derivatives, and no NaN of the side not taken."""
    rng = np.random.default_rng(0)
    A, b = -jnp.asarray(rng.random((8, 8))), jnp.asarray(rng.random((2, 2, 2)))
    blocks = linear.factor_blocks(jnp.eye(4) + jnp.asarray(rng.random((2, 4, 4))))

    def solved(near, c):
        # as `freeze` makes it: zero while nothing is near
        all_ = jnp.where(near, A, jnp.zeros((8, 8)))
        return jnp.sum(Shifted.of(blocks, all_, c, near).solve(b) ** 2)

    near, c = jnp.array([True, False]), jnp.array([0.3, 0.3])
    slope = jax.jit(jax.grad(lambda c: jnp.sum(jax.vmap(solved)(near, c))))(c)
    h = 1e-6
    value = jax.jit(jax.vmap(solved))
    np.testing.assert_allclose(slope, (value(near, c + h) - value(near, c - h)) / (2 * h), rtol=1e-6, atol=1e-8)
    assert slope[0] != 0 and slope[1] == 0
    exact = np.linalg.solve(np.eye(8) - 0.3 * A, columns(b))
    np.testing.assert_allclose(value(near, c)[0], np.sum(exact**2), rtol=1e-12)


def test_scalars_are_solved_after_the_shapes_which_may_drive_them():
    """Two scalars, and rates of them that depend on the shapes: (1 - c A) times what `solve` returns is r."""
    frozen = frozen_of(*pair(2.0))
    rng = np.random.default_rng(0)
    M, c = 2, jnp.asarray(0.01)
    A = jnp.asarray(rng.normal(size=(M, 2 * N, 2 * N)))
    drive = jnp.asarray(rng.normal(size=(2, N, 2)))

    def below(drive, surfaces, dx, c):
        return {"charge": c * jnp.sum(drive[0] * dx, axis=-1), "V_m": c * jnp.sum(drive[1] * dx, axis=-1)}

    frozen = eqx.tree_at(
        lambda f: (f.A_scalars, f.below), frozen, (A, jax.tree_util.Partial(below, drive)), is_leaf=lambda f: f is None
    )
    r = Unknowns(
        jnp.asarray(rng.normal(size=(M, N, 2))),
        {name: jnp.asarray(rng.normal(size=(M, N))) for name in ("V_m", "charge")},
    )
    found = eqx.filter_jit(lambda frozen: frozen.implicit(c).solve(r))(frozen)
    np.testing.assert_allclose(found.x, frozen_solve_x(frozen, c, r), atol=1e-12)
    for m in range(M):
        s = jnp.concatenate([found.scalars[name][m] for name in sorted(r.scalars)])
        driven = below(drive, None, found.x, c)
        wanted = jnp.concatenate([(r.scalars[name] + driven[name])[m] for name in sorted(r.scalars)])
        np.testing.assert_allclose(s - c * A[m] @ s, wanted, atol=1e-10)


def frozen_solve_x(frozen, c, r):
    """The shapes alone, without scalars."""
    alone = eqx.tree_at(lambda f: (f.A_scalars, f.below), frozen, (None, None), is_leaf=lambda f: f is None)
    return eqx.filter_jit(lambda frozen: frozen.implicit(c).solve(Unknowns.of(r.x)).x)(alone)
