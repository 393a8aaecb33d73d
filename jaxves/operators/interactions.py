r"""What membranes do to each other: velocities and fields at the nodes of one from densities on another.

Two operators serve everything, for each ordered pair (target i, source j):

    velocity   S_Stokes[f_j] at x_i                gradient   ∇S[q_j] at x_i
    S'_ij = n_i·∇S[q_j],   D'_ij V = t_i·∇S[∂_s V_j],   ∇D[V] = (∂_y, -∂_x) S[∂_s V]

the last since D[V] and S[∂_s V] are harmonic conjugates. Pairs nearer than five node spacings (the paper's 5h
rule; the trapezoidal error there is e^{-10π}) take close evaluation, the others the trapezoidal rule.

How the operators are held is a choice: here as matrices of all pairs, in `summation` without them. A branch
at run time decides: while no pair is near, nothing of closeness is paid for (under `vmap` a branch becomes a
choice between both, and all is paid for).
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..geometry.curve import Curve
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..potentials import close_laplace, close_stokes
from ..potentials.close_laplace import CloseGeometry
from ..potentials.self_stokes import StokesBlocks

NEAR = 5.0  # node spacings of the source
_BATCH = 64  # pairs of which something is computed at once


class AbstractInteractions(eqx.Module):
    """The two operators between all membranes at one instant.

    `crowded`: near pairs were more than there was room for, and the operators are wrong; None where this cannot be.
    """

    crowded: eqx.AbstractVar[Bool[Array, ""] | None]

    @abc.abstractmethod
    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Velocity at the nodes of each membrane from forces on the others."""

    @abc.abstractmethod
    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        """∇S[q] of the other membranes at the nodes of each."""

    def roughly(self) -> "AbstractInteractions | None":
        """The same to a few digits at a fraction of the cost, to precondition with; None where nothing is cheaper."""
        return None


class AbstractCoupling(eqx.Module):
    """How interactions are computed, and how the systems that couple all membranes are solved.

    `direct`: by one dense factorisation of all MN unknowns, not by GMRES. `together`: the frozen part of all shapes is
    one matrix while any are near (`jaxves.frozen`).
    """

    direct: eqx.AbstractVar[bool]
    together: eqx.AbstractVar[bool]

    @abc.abstractmethod
    def between(self, curves: Curve, *, electric: bool) -> AbstractInteractions:
        """The interactions of the M >= 2 membranes in `curves`; `electric` adds what only a field needs."""


class Pairwise(AbstractCoupling):
    """Matrices of all ordered pairs: the fastest for few membranes, with memory that grows like (MN)²."""

    direct: bool = eqx.field(static=True)
    together: bool = eqx.field(static=True, default=True)

    def between(self, curves: Curve, *, electric: bool) -> "PairMatrices":
        return PairMatrices.of(curves, electric=electric)


class PairMatrices(AbstractInteractions):
    """Matrices (pairs, N, N) from densities to values, for the ordered pairs `target`, `source`."""

    velocity: StokesBlocks
    gradient: Float[Array, "pairs 2 N N"] | None
    any_near: Bool[Array, ""]
    vesicles: int = eqx.field(static=True)
    crowded: None = None

    @classmethod
    def of(cls, curves: Curve, *, electric: bool) -> "PairMatrices":
        """All ordered pairs of the M membranes in `curves`."""
        targets, sources = pair_frames(curves)
        are_near = jax.vmap(is_near_curve)(sources, targets.x)
        far = jax.vmap(lambda source, x: _far(source, x, electric))(sources, targets.x)

        # One pair after the other: a near one then costs its own close evaluation, not that of all pairs.
        @jax.checkpoint
        def refined(pair):
            is_near, source, x, far = pair
            return jax.lax.cond(is_near, lambda: close_matrices(source, x, electric), lambda: far)

        velocity, gradient = jax.lax.map(refined, (are_near, sources, targets.x, far))
        return cls(velocity, gradient, jnp.any(are_near), curves.x.shape[0])

    def ordered(self) -> tuple[np.ndarray, np.ndarray]:
        """The target and the source of every pair."""
        return _pairs(self.vesicles)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        _, source = self.ordered()
        return self._gather(jax.vmap(StokesBlocks.__matmul__)(self.velocity, f[source]))

    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        _, source = self.ordered()
        return self._gather(times(self.gradient, q[source]))

    def scattered(self, blocks: Float[Array, "pairs N N"]) -> Float[Array, "n n"]:
        """The matrix of all membranes with these blocks off its diagonal."""
        target, source = self.ordered()
        M, N = self.vesicles, blocks.shape[-1]
        # advanced indices apart from each other put the pair axis first
        return jnp.zeros((M, N, M, N)).at[target, :, source, :].set(blocks).reshape(M * N, M * N)

    def _gather(self, values: Float[Array, "pairs N *rest"]) -> Float[Array, "M N *rest"]:
        target, _ = self.ordered()
        return jnp.zeros((self.vesicles, *values.shape[1:])).at[target].add(values)


def times(gradient: Float[Array, "pairs 2 N N"], q: Float[Array, "pairs N"]) -> Float[Array, "pairs N 2"]:
    """The gradients of densities `q`."""
    # Asked for components last, XLA's CPU compiler leaves the fast product: twenty times slower for many pairs.
    return jnp.swapaxes(jnp.einsum("paij,pj->pai", gradient, q), 1, 2)


def _pairs(M: int) -> tuple[np.ndarray, np.ndarray]:
    """Targets and sources of all ordered pairs."""
    target, source = np.divmod(np.arange(M * M), M)
    apart = target != source
    return target[apart], source[apart]


def over_pairs(function: Callable[[Curve, Curve], Array], curves: Curve) -> Array:
    """`function(target, source)` of every ordered pair, in batches that bound the memory."""

    def of_pair(pair):
        target, source = (jax.tree.map(lambda leaf, m=m: leaf[m], curves) for m in pair)
        return function(target, source)

    return jax.lax.map(of_pair, _pairs(curves.x.shape[0]), batch_size=_BATCH)


def pair_frames(curves: Curve) -> tuple[Curve, Curve]:
    """The target's and the source's curve of every ordered pair."""
    target, source = _pairs(curves.x.shape[0])
    return jax.tree.map(lambda leaf: leaf[target], curves), jax.tree.map(lambda leaf: leaf[source], curves)


def is_near_curve(source: Curve, x: Float[Array, "N 2"]) -> Bool[Array, ""]:
    """Whether any of the points `x` needs close evaluation from `source`."""
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


def close_matrices(source: Curve, x, electric: bool):
    """The velocity and gradient matrices by close evaluation; other vesicles lie outside."""
    close = CloseGeometry.of(source, x, inside=False)
    gradient = close_laplace.laplace_slp_gradient_matrix(close) if electric else None
    return close_stokes.stokes_slp_matrix(close), gradient
