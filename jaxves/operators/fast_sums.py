r"""Interactions of many membranes by fast sums: time and memory grow almost like MN.

The sums of `ewald` contain every pair, near pairs and selves with their smooth part only. The smooth part of each
membrane on itself is subtracted, and near pairs have matrices of close evaluation less the smooth part. Both are
bounded for close nodes, so that no digits cancel.

In the plane, vesicles can be spread so unevenly that lists of fixed length are too short. Far pairs are then summed
directly, which takes longer and is right. In a periodic cell the result is wrong then, and `crowded` says so.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..ewald.lists import Excluded
from ..ewald.plans import Plan
from ..ewald.sums import EwaldSums
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Cell
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..numerics.batching import greatest
from ..potentials import far
from ..potentials.self_stokes import StokesBlocks
from .direct_sums import summed
from .interactions import SOLVED, AbstractInteractions
from .near_pairs import NearPairs
from .pairs import close_matrices, times


class FastSummation(AbstractInteractions):
    """Fast sums, the smooth part of each membrane on itself, and matrices for near pairs less the smooth part."""

    curves: Curve
    sums: EwaldSums
    own: StokesBlocks
    own_gradient: Float[Array, "M 2 N N"] | None
    near: NearPairs
    velocity: StokesBlocks
    gradient: Float[Array, "K 2 N N"] | None
    cell: Cell | None
    solved: float = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        curves: Curve,
        near: NearPairs,
        plan: Plan,
        domain: AbstractDomain,
        *,
        electric: bool,
        solved: float = SOLVED,
    ) -> "FastSummation":
        """Builds the interactions of the M membranes in `curves`, of which `near` are the near pairs.

        Coupled systems are solved to the relative residual `solved`.
        """
        excluded = Excluded(near.target, near.source, near.image, near.valid)
        sums = EwaldSums.of(curves.x, curves.weights, plan, domain, excluded)

        @jax.checkpoint
        def of_pair(row):
            target, valid, source = row[0], row[1], near.source_curve(row[2], curves, domain)

            def close():
                blocks, gradient = close_matrices(source, curves.x[target], electric)
                smooth = _blocks(sums, curves.x[target], source, electric)
                return jax.tree.map(jnp.subtract, (blocks, gradient), smooth)

            nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(close))
            return lax.cond(valid, close, lambda: nothing)

        velocity, gradient = lax.map(of_pair, (near.target, near.valid, jnp.arange(near.valid.shape[0])))
        own = jax.vmap(lambda curve: _blocks(sums, curve.x, curve, electric))(curves)
        cell = domain if isinstance(domain, Cell) else None
        return cls(curves, sums, *own, near, velocity, gradient, cell, solved)

    @property
    def crowded(self) -> Bool[Array, ""]:
        return self.near.overflow if self.cell is None else self.near.overflow | self.sums.overflow

    def mean_dipole(self, V_m: VesicleNodes) -> Float[Array, "2"] | None:
        if self.cell is None:
            return None
        weights = (self.curves.weights * V_m)[..., None]
        return jnp.sum(weights * self.curves.normal, axis=(0, 1)) / self.cell.area()

    def tolerance(self) -> float:
        return self.solved

    def any_near(self) -> Bool[Array, ""]:
        return jnp.any(self.near.valid)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        near = self.near.summed(jax.vmap(StokesBlocks.__matmul__), self.velocity, f)

        def fast(f):
            return self.sums.stokes(f) - jax.vmap(StokesBlocks.__matmul__)(self.own, f)

        def direct(f):
            def product(x, source, f):
                return _blocks(self.sums, x, source, True)[0] @ f

            others = smooth_of_near(self.curves, self.near, product, f)
            return summed(far.stokes_slp, self.curves, self.near, f) + others

        return self._chosen(fast, direct, f) + near

    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        near = self.near.summed(times, self.gradient, q)

        def fast(q):
            return self.sums.slp_gradient(q) - times(self.own_gradient, q)

        def direct(q):
            def product(x, source, q):
                return jnp.einsum("aij,j->ia", _blocks(self.sums, x, source, True)[1], q)

            others = smooth_of_near(self.curves, self.near, product, q)
            return summed(far.laplace_slp_gradient, self.curves, self.near, q) + others

        return self._chosen(fast, direct, q) + near

    def _chosen(self, fast, direct, density):
        if self.cell is not None:
            return fast(density)
        return lax.cond(greatest(jnp.int32(self.sums.overflow)) > 0, direct, fast, density)


def smooth_of_near(curves: Curve, near: NearPairs, product, density) -> VesiclePoints:
    """Returns the sum of `product(x, source, density)` over the near pairs in the plane, which fast sums contain."""

    @jax.checkpoint
    def of_pair(row):
        target, source, valid = row
        curve = jax.tree.map(lambda leaf: leaf[source], curves)
        return jnp.where(valid, product(curves.x[target], curve, density[source]), 0.0)

    found = lax.map(of_pair, (near.target, near.source, near.valid))
    return jnp.zeros_like(curves.x).at[near.target].add(found)


def _separations(x: Float[Array, "P 2"], y: Float[Array, "N 2"]) -> list[Float[Array, "P N"]]:
    return [x[:, None, k] - y[:, k] for k in (0, 1)]


def _blocks(sums: EwaldSums, x: Float[Array, "P 2"], source: Curve, electric: bool):
    """Returns the velocity and gradient matrices of the smooth part, with quadrature weights."""
    rx, ry = _separations(x, source.x)
    A, B = (part * source.weights for part in sums.smooth(rx**2 + ry**2))
    gradient = jnp.stack([-2 * B * rx, -2 * B * ry]) if electric else None
    return StokesBlocks(A + B * rx**2, B * rx * ry, A + B * ry**2), gradient
