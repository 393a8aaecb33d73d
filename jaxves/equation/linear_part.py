r"""The matrices of the linear part A for the shapes, at one instant.

    A_x = P G (-κ_B ∂_s⁴ + ∂_s σ ∂_s),  P = 1 - G T (Q G T)⁻¹ Q,  G = S or, with two viscosities, A_ν⁻¹ S

Geometry and tension are fixed. The metric is taken as uniform, because the projection keeps it so. `cut` modes are
removed from x, `surface_cut` modes from tensions.

With one block per membrane, the effect of a thin film on the bending of its two sides is explicit, and this is stiff.
With 64 nodes and a gap of 0.031 a the explicit part grows at up to 2190 per t_κ. Steps of 4e-3 are then unstable; 2e-3
is stable. With one matrix for all membranes it grows at up to 34. If no pair is near, the blocks are sufficient and
cost less.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier, linear
from ..numerics.arrays import PerVesicle, Scalar, VesicleNodes
from ..operators.surfaces import Surfaces
from ..potentials.self_stokes import StokesBlocks
from .inextensible import Constraint
from .mobility import AbstractInside


def _elastic_matrix(curve: Curve, sigma: Float[Array, " N"], bending: Scalar, cut: int) -> Float[Array, "N N"]:
    """Returns the matrix of -κ_B ∂_s⁴ + ∂_s σ ∂_s for one component of x."""
    N = sigma.shape[0]
    D = fourier.derivative_matrix(N)
    D_low = D @ fourier.low_pass_matrix(N, cut)
    speed = jnp.mean(curve.speed)
    return (-bending / speed**4) * (D @ D @ D @ D_low) + (D * (sigma / speed**2)) @ D_low


def shape_block(
    curve: Curve,
    slp: StokesBlocks,
    sigma: Float[Array, " N"],
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
    D = fourier.derivative_matrix(sigma.shape[0])
    K = jnp.mean(curve.speed) * _elastic_matrix(curve, sigma, bending, cut)
    xx, xy, yy = slp.xx @ K, slp.xy @ K, slp.yy @ K
    tx, ty = curve.tangent[:, :1], curve.tangent[:, 1:]
    if inside is None:
        d_xx, d_xy, d_yy = D @ xx, D @ xy, D @ yy
        stretch = jnp.concatenate([tx * d_xx + ty * d_xy, tx * d_xy + ty * d_yy], axis=1)
        velocity = jnp.concatenate([xx, xy], 1), jnp.concatenate([xy, yy], 1)
    else:
        rows = jnp.concatenate([xx, xy], 1), jnp.concatenate([xy, yy], 1)
        velocity = jnp.split(inside.solve_columns(jnp.concatenate(rows)), 2)
        stretch = tx * (D @ velocity[0]) + ty * (D @ velocity[1])
    response = constraint.tension.solve_columns(fourier.low_pass_rows(stretch, surface_cut))
    rows = [row + part @ response for row, part in zip(velocity, constraint.spread, strict=True)]
    return jnp.concatenate([fourier.low_pass_rows(row, cut) for row in rows], axis=0)


def shape_matrix(
    surfaces: Surfaces,
    tension: linear.AbstractFactoredDense,
    sigma: VesicleNodes,
    bending: PerVesicle,
    *,
    cut: int,
    surface_cut: int,
) -> Float[Array, "n n"]:
    """Returns A_x of all nodes, ordered by membrane, component, node.

    `tension` solves for the tensions of all membranes from |x_α| times their stretch rates.
    """
    M, N = sigma.shape
    curves = surfaces.curves
    D = fourier.derivative_matrix(N)
    S = _single_layer(surfaces)
    forces = jax.vmap(lambda *parts: _elastic_matrix(*parts, cut))(curves, sigma, bending)
    velocity = jnp.einsum("iankbm,kml->iankbl", S, forces)
    stretch = jnp.einsum("ina,np,iapkbl->inkbl", curves.tangent, D, velocity, optimize=[(1, 2), (0, 1)])
    stretch = fourier.low_pass(stretch, surface_cut, axis=1)
    response = tension.solve_columns(stretch.reshape(M * N, 2 * M * N))
    # the force of tensions, f_tension = ∂_s (σ t), and the velocity it causes
    pull = D[:, None, :] * jnp.swapaxes(curves.tangent, 1, 2)[:, None] / curves.speed[:, :, None, None]
    moved = jnp.einsum("iankbm,kmbl->iankl", S, pull).reshape(2 * M * N, M * N) @ response
    rows = velocity + moved.reshape(velocity.shape)
    return fourier.low_pass(rows, cut, axis=2).reshape(2 * M * N, 2 * M * N)


def _single_layer(surfaces: Surfaces) -> Float[Array, "M 2 N M 2 N"]:
    """Returns the matrix from forces per arc length at all nodes to velocities at all nodes."""

    def whole(blocks):
        rows = jnp.stack([blocks.xx, blocks.xy], axis=-2), jnp.stack([blocks.xy, blocks.yy], axis=-2)
        return jnp.stack(rows, axis=-4)

    pairs = surfaces.interactions.matrices()
    M, N = surfaces.curves.speed.shape
    m = np.arange(M)
    own = whole(surfaces.stokes_slp) * surfaces.curves.speed[:, None, None, None]
    target, source = pairs.ordered()
    # advanced indices apart from each other put the pair axis first
    S = jnp.zeros((M, 2, N, M, 2, N)).at[m, :, :, m].set(own)
    return S.at[target, :, :, source].set(whole(pairs.velocity))
