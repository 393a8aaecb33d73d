r"""The linear part A for the shapes of all membranes as one matrix, for membranes that are near each other.

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

from ..numerics import fourier, linear
from ..numerics.arrays import PerVesicle, VesicleNodes
from ..operators.surfaces import Surfaces
from .shape_block import elastic_matrix


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
    forces = jax.vmap(lambda *parts: elastic_matrix(*parts, cut))(curves, sigma, bending)
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
