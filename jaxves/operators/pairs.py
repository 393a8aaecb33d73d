"""Interactions as matrices of all ordered pairs, which is the fastest method for few membranes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..potentials import close_laplace, close_stokes
from ..potentials.close_laplace import CloseGeometry
from ..potentials.self_stokes import StokesBlocks
from .interactions import (
    NEAR,
    AbstractCoupling,
    AbstractPairMatrices,
    is_near_curve,
    ordered_pairs,
    pair_frames,
)


class Pairwise(AbstractCoupling):
    """Stores matrices of all ordered pairs: the fastest method for few membranes. Memory grows like (MN)²."""

    direct: bool = eqx.field(static=True)
    together: bool = eqx.field(static=True, default=True)
    near: float = eqx.field(static=True, default=NEAR)

    def room(self, M: int) -> int:
        return M - 1

    def between(
        self, curves: Curve, domain: AbstractDomain, *, electric: bool, contrast: bool = False
    ) -> "PairMatrices":
        return PairMatrices.of(curves, self.near, electric=electric)


class PairMatrices(AbstractPairMatrices):
    """Matrices (pairs, N, N) from densities to values, for the ordered pairs `target`, `source`."""

    velocity: StokesBlocks
    gradient: Float[Array, "pairs 2 N N"] | None
    some_near: Bool[Array, ""]
    vesicles: int = eqx.field(static=True)
    crowded: None = None

    @classmethod
    def of(cls, curves: Curve, near: float, *, electric: bool) -> "PairMatrices":
        """Builds the matrices of all pairs of the M membranes; pairs closer than `near` use close evaluation."""
        targets, sources = pair_frames(curves)
        are_near = jax.vmap(lambda source, x: is_near_curve(source, x, near))(sources, targets.x)
        far = jax.vmap(lambda source, x: far_matrices(source, x, electric))(sources, targets.x)

        # One pair after the other, so that close evaluation is computed only for near pairs.
        @jax.checkpoint
        def refined(pair):
            is_near, source, x, far = pair
            return jax.lax.cond(is_near, lambda: close_matrices(source, x, electric), lambda: far)

        velocity, gradient = jax.lax.map(refined, (are_near, sources, targets.x, far))
        return cls(velocity, gradient, jnp.any(are_near), curves.x.shape[0])

    def ordered(self) -> tuple[np.ndarray, np.ndarray]:
        return ordered_pairs(self.vesicles)

    def any_near(self) -> Bool[Array, ""]:
        return self.some_near

    def matrices(self) -> "PairMatrices":
        return self

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        _, source = self.ordered()
        return self._gather(jax.vmap(StokesBlocks.__matmul__)(self.velocity, f[source]))

    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        _, source = self.ordered()
        return self._gather(times(self.gradient, q[source]))

    def scattered(self, blocks: Float[Array, "pairs N N"]) -> Float[Array, "n n"]:
        target, source = self.ordered()
        M, N = self.vesicles, blocks.shape[-1]
        # advanced indices apart from each other put the pair axis first
        return jnp.zeros((M, N, M, N)).at[target, :, source, :].set(blocks).reshape(M * N, M * N)

    def _gather(self, values: Float[Array, "pairs N *rest"]) -> Float[Array, "M N *rest"]:
        target, _ = self.ordered()
        return jnp.zeros((self.vesicles, *values.shape[1:])).at[target].add(values)


def times(gradient: Float[Array, "pairs 2 N N"], q: Float[Array, "pairs N"]) -> Float[Array, "pairs N 2"]:
    """Returns the gradients for densities `q`."""
    # With the components as last axis, XLA on CPUs does not use its fast product: twenty times slower for many pairs.
    return jnp.swapaxes(jnp.einsum("paij,pj->pai", gradient, q), 1, 2)


def far_matrices(source: Curve, x, electric: bool):
    """Returns the velocity and gradient matrices by the trapezoidal rule.

    If two vesicles touch and nodes coincide, the values are finite but not used, because the other rule is chosen.
    """
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


def close_matrices(source: Curve, x, electric: bool):
    """Returns the velocity and gradient matrices by close evaluation. The targets are outside of `source`."""
    close = CloseGeometry.of(source, x, inside=False)
    gradient = close_laplace.laplace_slp_gradient_matrix(close) if electric else None
    return close_stokes.stokes_slp_matrix(close), gradient
