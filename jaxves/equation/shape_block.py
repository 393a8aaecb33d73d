r"""The linear part A for the shape of one membrane.

    A_x = P G K,     K = -κ_B ∂_s⁴ + ∂_s σ ∂_s,     P = 1 - G T (Q G T)⁻¹ Q

G is the single layer S or, with two viscosities, A_ν⁻¹ S. The metric is taken as uniform, because the projection keeps
it so. `cut` modes are removed from x, `surface_cut` modes from tensions.

P G has only velocities that do not stretch the membrane, which are given by N numbers. A system for these N unknowns is
cheaper. It agrees with this one only for resolved modes. In the highest modes the difference is stiff, and derivatives
of a run grew by many orders of magnitude. The matrix is therefore formed from the discretised operators themselves.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix, Nodes, Scalar
from ..potentials.self_stokes import StokesBlocks
from .inextensible import Constraint
from .mobility import AbstractInside


def elastic_matrix(curve: Curve, sigma: Nodes, bending: Scalar, cut: int) -> NodeMatrix:
    """Returns the matrix of -κ_B ∂_s⁴ + ∂_s σ ∂_s for one component of x."""
    speed = jnp.mean(curve.speed)
    bend, slope = fourier.elastic_matrices(sigma.shape[0], cut)
    return (-bending / speed**4) * bend + fourier.derivative((sigma / speed**2)[:, None] * slope, axis=0)


def shape_block(
    curve: Curve,
    slp: StokesBlocks,
    sigma: Nodes,
    bending: Scalar,
    constraint: Constraint,
    inside: AbstractInside | None,
    *,
    cut: int,
    surface_cut: int,
) -> Float[Array, "n n"]:
    """Returns A_x of one membrane, with 2N unknowns ordered by component, node.

    `slp` is its single layer, and `inside` the effect of the inner fluid, or None for equal viscosities.
    """
    K = jnp.mean(curve.speed) * elastic_matrix(curve, sigma, bending, cut)
    xx, xy, yy = slp.xx @ K, slp.xy @ K, slp.yy @ K
    tx, ty = curve.tangent[:, :1], curve.tangent[:, 1:]
    if inside is None:
        d_xx, d_xy, d_yy = (fourier.derivative(part, axis=0) for part in (xx, xy, yy))
        stretch = jnp.concatenate([tx * d_xx + ty * d_xy, tx * d_xy + ty * d_yy], axis=1)
        velocity = jnp.concatenate([xx, xy], 1), jnp.concatenate([xy, yy], 1)
    else:
        rows = jnp.concatenate([xx, xy], 1), jnp.concatenate([xy, yy], 1)
        velocity = jnp.split(inside.solve_columns(jnp.concatenate(rows)), 2)
        stretch = tx * fourier.derivative(velocity[0], axis=0) + ty * fourier.derivative(velocity[1], axis=0)
    response = constraint.tension.solve_columns(fourier.low_pass_rows(stretch, surface_cut))
    rows = [row + part @ response for row, part in zip(velocity, constraint.spread, strict=True)]
    return jnp.concatenate([fourier.low_pass_rows(row, cut) for row in rows], axis=0)
