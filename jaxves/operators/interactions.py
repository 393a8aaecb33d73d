r"""What membranes do to each other: velocities and fields at the nodes of one from densities on the others.

Two operators serve everything, for each ordered pair (target i, source j):

    velocity   S_Stokes[f_j] at x_i                gradient   ∇S[q_j] at x_i
    S'_ij = n_i·∇S[q_j],   D'_ij V = t_i·∇S[∂_s V_j],   ∇D[V] = (∂_y, -∂_x) S[∂_s V]

The last holds since D[V] and S[∂_s V] are harmonic conjugates. Pairs nearer than five node spacings use close
evaluation, the others the trapezoidal rule, whose error at that distance is e^{-10π} (the paper's 5h rule).

How the operators are stored is a choice: `pairs` holds matrices of all pairs, `sums` none. A branch at run time
decides: while no pair is near, close evaluation costs nothing. Under `vmap` a branch becomes a selection between both
results, and both are computed.
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
from ..potentials.self_stokes import StokesBlocks

NEAR = 5.0  # node spacings of the source: the default of every coupling
_BATCH = 64  # pairs for which something is computed at once


class AbstractInteractions(eqx.Module):
    """The two operators between all membranes at one instant.

    `crowded`: near pairs were more than there was room for, and the operators are wrong; None where this cannot be.
    """

    crowded: eqx.AbstractVar[Bool[Array, ""] | None]

    @abc.abstractmethod
    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Velocity at the nodes of each membrane from forces per arc length on the others."""

    @abc.abstractmethod
    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        """∇S[q] of the other membranes at the nodes of each."""

    @abc.abstractmethod
    def any_near(self) -> Bool[Array, ""]:
        """Whether any pair needs close evaluation."""

    def matrices(self) -> "AbstractPairMatrices | None":
        """The same operators as matrices of all pairs; None where those are never formed."""
        return None

    def roughly(self) -> "AbstractInteractions | None":
        """The same to a few digits at a fraction of the cost, as a preconditioner; None where nothing is cheaper."""
        return None


class AbstractPairMatrices(AbstractInteractions):
    """Interactions whose operators are matrices (pairs, N, N) from densities to values, pairs as in `ordered`."""

    velocity: eqx.AbstractVar[StokesBlocks]
    gradient: eqx.AbstractVar[Float[Array, "pairs 2 N N"] | None]

    @abc.abstractmethod
    def ordered(self) -> tuple[np.ndarray, np.ndarray]:
        """The target and the source of every pair."""

    @abc.abstractmethod
    def scattered(self, blocks: Float[Array, "pairs N N"]) -> Float[Array, "n n"]:
        """The matrix of all membranes with these blocks off its diagonal."""


class AbstractCoupling(eqx.Module):
    """How interactions are computed, and how the systems that couple all membranes are solved.

    `near`: pairs closer than this many node spacings of the source use close evaluation. `direct`: coupled systems are
    solved by one dense factorisation of all MN unknowns, not by GMRES. `together`: the implicit part of all shapes is
    one matrix while any pair is near. The last two need interactions that have `matrices()`.
    """

    near: eqx.AbstractVar[float]
    direct: eqx.AbstractVar[bool]
    together: eqx.AbstractVar[bool]

    @abc.abstractmethod
    def between(self, curves: Curve, *, electric: bool) -> AbstractInteractions:
        """The interactions of the M >= 2 membranes in `curves`; `electric` adds what only a field needs."""


def ordered_pairs(M: int) -> tuple[np.ndarray, np.ndarray]:
    """Targets and sources of all ordered pairs."""
    target, source = np.divmod(np.arange(M * M), M)
    apart = target != source
    return target[apart], source[apart]


def over_pairs(function: Callable[[Curve, Curve], Array], curves: Curve) -> Array:
    """`function(target, source)` of every ordered pair, in batches that bound the memory."""

    def of_pair(pair):
        target, source = (jax.tree.map(lambda leaf, m=m: leaf[m], curves) for m in pair)
        return function(target, source)

    return jax.lax.map(of_pair, ordered_pairs(curves.x.shape[0]), batch_size=_BATCH)


def pair_frames(curves: Curve) -> tuple[Curve, Curve]:
    """The target's and the source's curve of every ordered pair."""
    target, source = ordered_pairs(curves.x.shape[0])
    return jax.tree.map(lambda leaf: leaf[target], curves), jax.tree.map(lambda leaf: leaf[source], curves)


def is_near_curve(source: Curve, x: Float[Array, "N 2"], near: float) -> Bool[Array, ""]:
    """Whether any of the points `x` is closer than `near` node spacings to `source`."""
    r2 = jnp.sum((x[:, None] - source.x[None]) ** 2, axis=-1)
    spacing = jnp.max(source.weights)
    # The curve may pass between two nodes: half a spacing is allowed for.
    return jnp.min(r2) < ((near + 0.5) * spacing) ** 2
