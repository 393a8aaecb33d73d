r"""What membranes do to each other: velocities and fields at the nodes of one from densities on another.

Two operators serve everything, for each ordered pair (target i, source j):

    velocity   S_Stokes[f_j] at x_i                gradient   ∇S[q_j] at x_i
    S'_ij = n_i·∇S[q_j],   D'_ij V = t_i·∇S[∂_s V_j],   ∇D[V] = (∂_y, -∂_x) S[∂_s V]

the last since D[V] and S[∂_s V] are harmonic conjugates. Pairs nearer than five node spacings (the paper's 5h
rule; the trapezoidal error there is e^{-10π}) take close evaluation, the others the trapezoidal rule. A branch
at run time decides: while no pair is near, nothing of closeness is paid for (under `vmap` a branch becomes a
choice between both, and all is paid for).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .arrays import VesicleNodes, VesiclePoints
from .curve import Curve
from .potentials import near, near_stokes
from .potentials.near import CloseGeometry
from .potentials.stokes import StokesBlocks

NEAR = 5.0  # node spacings of the source


class Interactions(eqx.Module):
    """Matrices (pairs, N, N) from densities to values, for the ordered pairs `target`, `source`."""

    velocity: StokesBlocks
    gradient: Float[Array, "pairs 2 N N"] | None
    near: Bool[Array, "pairs"]
    vesicles: int = eqx.field(static=True)

    @classmethod
    def of(cls, curves: Curve, *, electric: bool) -> "Interactions":
        """All ordered pairs of the M membranes in `curves`."""
        M = curves.x.shape[0]
        targets, sources = pair_frames(curves)
        is_near = jax.vmap(_is_near)(sources, targets.x)
        far = jax.vmap(lambda source, x: _far(source, x, electric))(sources, targets.x)

        def refined():
            close = jax.vmap(lambda source, x: _close(source, x, electric))(sources, targets.x)
            return jax.tree.map(lambda a, b: jnp.where(is_near[(...,) + (None,) * (a.ndim - 1)], a, b), close, far)

        velocity, gradient = jax.lax.cond(jnp.any(is_near), refined, lambda: far)
        return cls(velocity, gradient, is_near, M)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Velocity at the nodes of each membrane from forces on the others."""
        _, source = _pairs(self.vesicles)
        return self._gather(jax.vmap(StokesBlocks.__matmul__)(self.velocity, f[source]))

    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        """∇S[q] of the other membranes at the nodes of each."""
        _, source = _pairs(self.vesicles)
        return self._gather(jnp.einsum("paij,pj->pia", self.gradient, q[source]))

    def scattered(self, blocks: Float[Array, "pairs N N"]) -> Float[Array, "n n"]:
        """The matrix of all membranes with these blocks off its diagonal."""
        target, source = _pairs(self.vesicles)
        M, N = self.vesicles, blocks.shape[-1]
        # advanced indices apart from each other put the pair axis first
        return jnp.zeros((M, N, M, N)).at[target, :, source, :].set(blocks).reshape(M * N, M * N)

    def _gather(self, values: Float[Array, "pairs N *rest"]) -> Float[Array, "M N *rest"]:
        target, _ = _pairs(self.vesicles)
        return jnp.zeros((self.vesicles, *values.shape[1:])).at[target].add(values)


def _pairs(M: int) -> tuple[np.ndarray, np.ndarray]:
    """Targets and sources of all ordered pairs."""
    target, source = np.divmod(np.arange(M * M), M)
    apart = target != source
    return target[apart], source[apart]


def pair_frames(curves: Curve) -> tuple[Curve, Curve]:
    """The target's and the source's curve of every ordered pair."""
    target, source = _pairs(curves.x.shape[0])
    return jax.tree.map(lambda leaf: leaf[target], curves), jax.tree.map(lambda leaf: leaf[source], curves)


def _is_near(source: Curve, x: Float[Array, "N 2"]) -> Bool[Array, ""]:
    r2 = jnp.sum((x[:, None] - source.x[None]) ** 2, axis=-1)
    spacing = jnp.max(source.weights)
    # The curve may pass between two nodes: half a spacing is allowed for.
    return jnp.min(r2) < ((NEAR + 0.5) * spacing) ** 2


def _far(source: Curve, x, electric: bool):
    """Trapezoidal rule. Vesicles in contact share nodes at worst; the branch then takes the other rule."""
    rx, ry = x[:, None, 0] - source.x[:, 0], x[:, None, 1] - source.x[:, 1]
    r2 = rx**2 + ry**2
    r2 = jnp.where(r2 > 0, r2, 1.0)
    weights = source.weights / (4 * np.pi)
    log = -0.5 * jnp.log(r2) * weights
    scaled = weights / r2
    xx, xy = rx**2 * scaled, rx * ry * scaled
    blocks = StokesBlocks(log + xx, xy, log + (weights - xx))
    gradient = jnp.stack([rx, ry]) * (-2 * scaled) if electric else None
    return blocks, gradient


def _close(source: Curve, x, electric: bool):
    """Close evaluation; other vesicles lie outside."""
    close = CloseGeometry.of(source, x, inside=False)
    gradient = near.laplace_slp_gradient_matrix(close) if electric else None
    return near_stokes.stokes_slp_matrix(close), gradient
