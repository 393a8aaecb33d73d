r"""The Stokes single layer on one curve: from a force density at the nodes to the velocity at the nodes.

    S[f]_a(x) = ∮ (-log|r| δ_ab + r_a r_b/|r|²) f_b(y) ds_y / 4π,     r = x - y, viscosity 1

As in `self_laplace`, the kernel acts on |x_α| f and is symmetric. Its logarithmic part is half the Laplace single
layer. r_a r_b/|r|² is smooth, with the limit t_a t_b on the diagonal. The off-diagonal blocks are equal, so three
blocks are stored.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics.arrays import NodeMatrix, NodePoints, Points
from .chords import Chords


class StokesBlocks(eqx.Module):
    """The block matrix [[xx, xy], [xy, yy]] from densities at N nodes to velocities at P points."""

    xx: Float[Array, "*batch P N"]
    xy: Float[Array, "*batch P N"]
    yy: Float[Array, "*batch P N"]

    def __matmul__(self, f: NodePoints) -> Points:
        fx, fy = f[:, 0], f[:, 1]
        return jnp.stack([self.xx @ fx + self.xy @ fy, self.xy @ fx + self.yy @ fy], axis=-1)


def slp(curve: Curve, chords: Chords, laplace_slp: NodeMatrix) -> StokesBlocks:
    """Returns the blocks of S, from the kernel `laplace_slp` of the Laplace single layer on the same curve."""
    scale = 0.5 / chords.rx.shape[0]  # 2π/N · 1/4π
    tangent = curve.tangent
    xx = (chords.rx**2 * chords.inverse_r2 + jnp.diag(tangent[:, 0] ** 2)) * scale
    xy = (chords.rx * chords.ry * chords.inverse_r2 + jnp.diag(tangent[:, 0] * tangent[:, 1])) * scale
    half = 0.5 * laplace_slp
    return StokesBlocks(half + xx, xy, half + (scale - xx))
