r"""The linear part A for the shape of one membrane.

    A_x = P G K,     K = -κ_B ∂_s⁴ + ∂_s σ ∂_s,     P = 1 - G T (Q G T)⁻¹ Q

G is the single layer S or, with two viscosities, A_ν⁻¹ S. The metric is taken as uniform, because the projection keeps
it so. `cut` modes are removed from x, `surface_cut` modes from tensions.

P G has only velocities that do not stretch the membrane, which are given by N + 1 numbers. From `_MANY` nodes on, and
for equal viscosities, the system for these numbers takes less time (`rotating_block`). Both forms use the discretised
operators themselves. Another discretisation of A would differ in the highest modes, where the difference is stiff:
derivatives of a run then grow by many orders of magnitude.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix, Nodes, PerVesicle, Scalar, VesicleNodes
from ..operators.surfaces import Surfaces
from ..potentials.self_stokes import StokesBlocks
from .inextensible import Constraint
from .mobility import AbstractInside
from .projection import Filter
from .rotating_block import RotatingBlock

_MANY = 128  # nodes; with fewer, compiling another 0.4 s costs more than most runs gain


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


def shape_blocks(
    surfaces: Surfaces,
    sigma: VesicleNodes,
    bending: PerVesicle,
    constraint: Constraint,
    inside: AbstractInside | None,
    filter: Filter,
) -> Float[Array, "M n n"] | RotatingBlock:
    """Returns A_x of every membrane in the form that is faster for this number of nodes."""
    cuts = dict(cut=filter.x, surface_cut=filter.surface)
    own = surfaces.curves, surfaces.stokes_slp
    if inside is None and sigma.shape[1] >= _MANY:
        parts = *own, surfaces.laplace_slp, sigma, bending, constraint
        return jax.vmap(lambda *parts: RotatingBlock.of(*parts, **cuts))(*parts)
    return jax.vmap(lambda *parts: shape_block(*parts, **cuts))(*own, sigma, bending, constraint, inside)
