r"""Interactions between membranes: velocities and fields at the nodes of one membrane from densities on the others.

Two operators are sufficient, for each ordered pair (target i, source j):

    velocity   S_Stokes[f_j] at x_i                gradient   ∇S[q_j] at x_i
    S'_ij = n_i·∇S[q_j],   D'_ij V = t_i·∇S[∂_s V_j],   ∇D[V] = (∂_y, -∂_x) S[∂_s V]

The last equation holds because D[V] and S[∂_s V] are harmonic conjugates. Pairs that are closer than five node spacings
use close evaluation. The others use the trapezoidal rule, whose error at that distance is e^{-10π} (the paper's 5h
rule).

`pairs` stores matrices of all pairs, and `sums` stores none. A branch at run time chooses the rule, so that close
evaluation costs nothing if no pair is near. Under `vmap` both rules are computed.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..potentials.self_stokes import StokesBlocks

NEAR = 5.0  # default limit for close evaluation, in node spacings of the source
SOLVED = 1e-11  # relative residual of coupled systems, where the operators are exact to round-off
_BATCH = 64  # number of pairs that are computed at once


class AbstractInteractions(eqx.Module):
    """The two operators between all membranes at one instant.

    `crowded` says that there was no room for all near pairs, so that the operators are wrong. It is None if this cannot
    happen.
    """

    crowded: eqx.AbstractVar[Bool[Array, ""] | None]

    @abc.abstractmethod
    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Returns the velocity at the nodes of each membrane from forces per arc length on the others."""

    @abc.abstractmethod
    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        """Returns ∇S[q] of the other membranes at the nodes of each membrane."""

    def mean_dipole(self, V_m: VesicleNodes) -> Float[Array, "2"] | None:
        """Returns Σ ∮ V_m n ds over the area of a periodic cell, or None in the plane.

        ∇D[V] in a cell is the rotated ∇S[∂_s V] less this vector, because the kernels have zero mean over the cell.
        """
        return None

    def tolerance(self) -> float:
        """Returns the relative residual to which systems that couple all membranes are solved."""
        return SOLVED

    @abc.abstractmethod
    def any_near(self) -> Bool[Array, ""]:
        """Returns whether any pair needs close evaluation."""

    def matrices(self) -> "AbstractPairMatrices | None":
        """Returns the same operators as matrices of all pairs, or None if these are not formed."""
        return None

    def roughly(self) -> "AbstractInteractions | None":
        """Returns a cheaper approximation for a preconditioner, or None if there is none."""
        return None


class AbstractPairMatrices(AbstractInteractions):
    """Interactions as matrices (pairs, N, N) from densities to values; `ordered` has the order of the pairs."""

    velocity: eqx.AbstractVar[StokesBlocks]
    gradient: eqx.AbstractVar[Float[Array, "pairs 2 N N"] | None]

    @abc.abstractmethod
    def ordered(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the target and the source of every pair."""

    @abc.abstractmethod
    def scattered(self, blocks: Float[Array, "pairs N N"]) -> Float[Array, "n n"]:
        """Returns the matrix of all membranes with these off-diagonal blocks."""


class AbstractCoupling(eqx.Module):
    """A method for the interactions, and for the systems that couple all membranes.

    `near`: pairs that are closer than this many node spacings of the source use close evaluation. `direct`: coupled
    systems are solved by one dense factorisation of all MN unknowns and not by GMRES. `together`: the linear part of
    all shapes is one matrix while any pair is near. The last two need interactions with `matrices()`.
    """

    near: eqx.AbstractVar[float]
    direct: eqx.AbstractVar[bool]
    together: eqx.AbstractVar[bool]

    def tolerance(self) -> float:
        """Returns the relative residual to which systems that couple all membranes are solved."""
        return SOLVED

    @abc.abstractmethod
    def room(self, M: int) -> int:
        """Returns for how many near sources per target, on average, lists of near pairs of M membranes have room."""

    @abc.abstractmethod
    def between(
        self, curves: Curve, domain: AbstractDomain, *, electric: bool, contrast: bool = False
    ) -> AbstractInteractions:
        """Returns the interactions of the M >= 2 membranes in `curves`; `electric` adds the operators for a field.

        `contrast` states that the Stokes double layer will be summed too (`sums.double_layers_of`).
        """


def ordered_pairs(M: int) -> tuple[np.ndarray, np.ndarray]:
    """Returns the targets and the sources of all ordered pairs of M membranes."""
    target, source = np.divmod(np.arange(M * M), M)
    apart = target != source
    return target[apart], source[apart]


def over_pairs(function: Callable[[Curve, Curve], Array], curves: Curve) -> Array:
    """Returns `function(target, source)` for every ordered pair, computed in batches to limit the memory."""

    def of_pair(pair):
        target, source = (jax.tree.map(lambda leaf, m=m: leaf[m], curves) for m in pair)
        return function(target, source)

    return jax.lax.map(of_pair, ordered_pairs(curves.x.shape[0]), batch_size=_BATCH)


def pair_frames(curves: Curve) -> tuple[Curve, Curve]:
    """Returns the target curve and the source curve of every ordered pair."""
    target, source = ordered_pairs(curves.x.shape[0])
    return jax.tree.map(lambda leaf: leaf[target], curves), jax.tree.map(lambda leaf: leaf[source], curves)


def is_near_curve(source: Curve, x: Float[Array, "N 2"], near: float) -> Bool[Array, ""]:
    """Returns whether any of the points `x` is closer than `near` node spacings to `source`."""
    r2 = (x[:, None, 0] - source.x[:, 0]) ** 2 + (x[:, None, 1] - source.x[:, 1]) ** 2
    spacing = jnp.max(source.weights)
    # Half a spacing is added, because the curve may pass between two nodes.
    return jnp.min(r2) < ((near + 0.5) * spacing) ** 2
