r"""The frozen linear part of all shapes as one matrix, for steps while membranes are near each other.

    A_x = P G (-κ_B ∂_s⁴ + ∂_s σ ∂_s),   P = 1 - G T (Q G T)⁻¹ Q

as on a lone membrane, but with G the single layer of all membranes at all nodes. One block per membrane leaves to the
explicit part what a film does to the bending of its two sides, and that is stiff: with 64 nodes and a gap of 0.031 a
the explicit part grows at up to 2190 per t_κ, which forbids steps of 4e-3 (2e-3 holds), and with more nodes less;
what this matrix leaves grows at up to 34. While no pair is near, the blocks do, for less.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from . import fourier, linear
from .arrays import PerVesicle, Scalar, VesicleNodes
from .surface import Surfaces


def frozen_shapes(
    surfaces: Surfaces,
    tension: linear.AbstractFactored,
    sigma: VesicleNodes,
    bending: PerVesicle,
    *,
    cut: int,
    surface_cut: int,
) -> Float[Array, "n n"]:
    """A_x of all nodes, ordered by membrane, component, node.

    `tension` solves for the tensions of all membranes from |x_α| times their stretch; `cut` modes are removed from x,
    `surface_cut` from tensions. The metric is taken uniform, which the projection keeps it.
    """
    M, N = sigma.shape
    curves = surfaces.curves
    D = fourier.derivative_matrix(N)
    D_low = D @ fourier.low_pass_matrix(N, cut)
    D4_low = D @ D @ D @ D_low
    S = _single_layer(surfaces)

    def forces(speed, sigma, bending):
        speed = jnp.mean(speed)
        return (-bending / speed**4) * D4_low + (D * (sigma / speed**2)) @ D_low

    velocity = jnp.einsum("iankbm,kml->iankbl", S, jax.vmap(forces)(curves.speed, sigma, bending))
    stretch = jnp.einsum("ina,np,iapkbl->inkbl", curves.tangent, D, velocity, optimize=[(1, 2), (0, 1)])
    stretch = fourier.low_pass(stretch, surface_cut, axis=1)
    response = tension.solve_columns(stretch.reshape(M * N, 2 * M * N))
    # f_tension = ∂_s (σ t): what tensions move
    pull = D[:, None, :] * jnp.swapaxes(curves.tangent, 1, 2)[:, None] / curves.speed[:, :, None, None]
    moved = jnp.einsum("iankbm,kmbl->iankl", S, pull).reshape(2 * M * N, M * N) @ response
    rows = velocity + moved.reshape(velocity.shape)
    return fourier.low_pass(rows, cut, axis=2).reshape(2 * M * N, 2 * M * N)


def _single_layer(surfaces: Surfaces) -> Float[Array, "M 2 N M 2 N"]:
    """Velocities at all nodes from forces per arc length at all nodes."""

    def whole(blocks):
        rows = jnp.stack([blocks.xx, blocks.xy], axis=-2), jnp.stack([blocks.xy, blocks.yy], axis=-2)
        return jnp.stack(rows, axis=-4)

    across = surfaces.interactions
    M, N = surfaces.curves.speed.shape
    m = np.arange(M)
    own = whole(surfaces.stokes_slp) * surfaces.curves.speed[:, None, None, None]
    target, source = across.ordered()
    # advanced indices apart from each other put the pair axis first
    S = jnp.zeros((M, 2, N, M, 2, N)).at[m, :, :, m].set(own)
    return S.at[target, :, :, source].set(whole(across.velocity))


class Shifted(eqx.Module):
    """1 - c A of the shapes, factored: as one matrix while `near`, by blocks otherwise."""

    near: Bool[Array, ""]
    blocks: linear.AbstractFactoredDense
    whole: linear.FactoredLU

    @classmethod
    def of(cls, near: Bool[Array, ""], blocks: linear.AbstractFactoredDense, A: Float[Array, "n n"], c: Scalar):
        """`A` is zero while nothing is near; its factors are then those of 1, found by nobody."""
        one = jnp.eye(A.shape[0])
        shifted = linear.LinearOperator(one - c * A)
        trivial = linear.FactoredLU(shifted, one, jnp.arange(A.shape[0], dtype=jnp.int32))
        return cls(near, blocks, lax.cond(near, lambda: linear.Dense().factor(shifted), lambda: trivial))

    def solve(self, b: Float[Array, "M n"]) -> Float[Array, "M n"]:
        """(1 - c A)⁻¹ b."""
        return lax.cond(
            self.near,
            lambda: self.whole.solve_columns(b.reshape(-1, 1)).reshape(b.shape),
            lambda: linear.solve_blocks(self.blocks, b),
        )
