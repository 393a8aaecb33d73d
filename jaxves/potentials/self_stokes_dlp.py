r"""The Stokes double layer on one curve: from a velocity density at the nodes to the velocity at the nodes.

    D[u](x) = ∮ r (r·u) (r·n_y) ds_y / π|r|⁴,     r = x - y;  principal value: interior limit D - ½, exterior D + ½

As in `self_stokes`, the kernel acts on |x_α| u. It is smooth, so the trapezoidal rule is spectrally accurate; the limit
on the diagonal is -κ t_a t_b/2π. Its trace is twice the kernel of the Laplace double layer.

On every curve the rigid motions have the eigenvalue -½ of D, and the flux is a left eigenvector with the eigenvalue ½:
∮ n·D[u] ds = ½ ∮ n·u ds. All other eigenvalues are between them. `deflated_dlp` has zero in the place of these four.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from .chords import Chords
from .self_stokes import StokesBlocks


def dlp(curve: Curve, chords: Chords) -> StokesBlocks:
    """Returns the blocks of the kernel of D (principal value)."""
    scale = 2.0 / chords.rx.shape[0]  # 2π/N · 1/π
    tangent, limit = curve.tangent, -0.5 * scale * curve.curvature
    dipole = (chords.rx * curve.normal[:, 0] + chords.ry * curve.normal[:, 1]) * chords.inverse_r2 * scale
    along = dipole * chords.inverse_r2
    xx = along * chords.rx**2 + jnp.diag(limit * tangent[:, 0] ** 2)
    xy = along * chords.rx * chords.ry + jnp.diag(limit * tangent[:, 0] * tangent[:, 1])
    return StokesBlocks(xx, xy, dipole + jnp.diag(limit) - xx)


class RigidPart(eqx.Module):
    """The projection P of velocities (2N, k) on the rigid motions of one curve, orthogonal in ds: P = R R⁺."""

    motions: Float[Array, "*batch n 3"]
    weights: Float[Array, "*batch n"]

    @classmethod
    def of(cls, curve: Curve) -> "RigidPart":
        """Returns the projection for the nodes of a curve, ordered by component, node."""
        weights = curve.weights
        length = jnp.sum(weights)
        arm = curve.x - weights @ curve.x / length
        one, zero = jnp.ones_like(weights) / jnp.sqrt(length), jnp.zeros_like(weights)
        turning = jnp.concatenate([-arm[:, 1], arm[:, 0]]) / jnp.sqrt(weights @ jnp.sum(arm**2, axis=-1))
        translations = jnp.concatenate([one, zero]), jnp.concatenate([zero, one])
        return cls(jnp.stack([*translations, turning], axis=1), jnp.tile(weights, 2))

    def __call__(self, v: Float[Array, "n k"]) -> Float[Array, "n k"]:
        return self.motions @ (self.motions.T @ (self.weights[:, None] * v))

    def without(self, matrix: Float[Array, "p n"]) -> Float[Array, "p n"]:
        """Returns the matrix times 1 - P."""
        return matrix - (matrix @ self.motions) @ (self.motions.T * self.weights)


def deflated_dlp(curve: Curve, kernel: StokesBlocks, rigid: RigidPart) -> Float[Array, "n n"]:
    """Returns D (1 - P) - ½ n ∮ n·(.) ds/L, (2N, 2N) ordered by component, node; `kernel` is that of `dlp`.

    It is zero on rigid motions, and maps a velocity to one without flux, as far as the quadrature is exact.
    """
    rows = [jnp.concatenate([kernel.xx, kernel.xy], 1), jnp.concatenate([kernel.xy, kernel.yy], 1)]
    normal = curve.normal.T.reshape(-1)
    outflow = normal * (rigid.weights / jnp.sum(curve.weights))
    return rigid.without(jnp.concatenate(rows) * jnp.tile(curve.speed, 2)) - 0.5 * normal[:, None] * outflow
