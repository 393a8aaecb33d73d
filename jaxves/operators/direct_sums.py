r"""Interactions of many membranes without matrices of all pairs. Memory grows like MN.

Far pairs are summed directly by the trapezoidal rule, for the nodes of one target at a time. Derivatives recompute the
kernels instead of storing them. Near pairs come from a list of fixed length and have stored matrices of close
evaluation, (pairs, N, N). Unused rows of the list cost nothing.

With several devices, each computes some of the targets and has all sources.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import Mesh, PartitionSpec
from jaxtyping import Array, Bool, Float

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..potentials import far
from ..potentials.self_stokes import StokesBlocks
from .interactions import AbstractInteractions
from .near_pairs import NearPairs
from .pairs import close_matrices, times

_FEWEST = 16  # least number of nodes in sums for the preconditioner
_ON_ACCELERATOR = 32  # targets that are summed at once on a GPU, where many small kernels are slow


class Summation(AbstractInteractions):
    """The curves for far sums, and the matrices of near pairs. More nodes of the curves make far sums more accurate."""

    curves: Curve
    near: NearPairs
    velocity: StokesBlocks
    gradient: Float[Array, "K 2 N N"] | None
    mesh: Mesh | None = eqx.field(static=True)

    @classmethod
    def of(cls, curves: Curve, near: NearPairs, mesh: Mesh | None, *, electric: bool) -> "Summation":
        """Builds the interactions of the M membranes in `curves`, of which `near` are the near pairs."""

        @jax.checkpoint
        def matrices(row):
            target, source, valid = row

            def close():
                return close_matrices(jax.tree.map(lambda leaf: leaf[source], curves), curves.x[target], electric)

            nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(close))
            return jax.lax.cond(valid, close, lambda: nothing)

        found = jax.lax.map(matrices, (near.target, near.source, near.valid))
        return cls(curves, near, *found, mesh)

    @property
    def crowded(self) -> Bool[Array, ""]:
        return self.near.overflow

    def any_near(self) -> Bool[Array, ""]:
        return jnp.any(self.near.valid)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        return self._summed(far.stokes_slp, f) + self.near.summed(jax.vmap(StokesBlocks.__matmul__), self.velocity, f)

    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        return self._summed(far.laplace_slp_gradient, q) + self.near.summed(times, self.gradient, q)

    def roughly(self) -> "Summation":
        """Returns the same with fewer nodes in far sums."""
        nodes = max(_FEWEST, self.curves.x.shape[1] // 4)
        x = fourier.resample(self.curves.x, nodes, axis=1)
        return eqx.tree_at(lambda s: s.curves, self, jax.vmap(Curve.from_nodes)(x))

    def _summed(self, potential, density: Float[Array, "M N *rest"]) -> VesiclePoints:
        return summed(potential, self.curves, self.near, density, self.mesh)


def summed(
    potential, curves: Curve, near: NearPairs, density: Float[Array, "M N *rest"], mesh: Mesh | None = None
) -> VesiclePoints:
    """Returns, at the nodes of each membrane, the sum of `potential` over all membranes that are far from it."""
    M, N = density.shape[:2]
    density = fourier.resample(density, curves.x.shape[1], axis=1)

    @jax.checkpoint
    def at(curves, near, density, target):
        left_out = near.sources_of(target, M) | (jnp.arange(M) == target)
        left_out = left_out.reshape(M, *[1] * (density.ndim - 1))
        return potential(curves, jnp.where(left_out, 0.0, density), curves.x[target])

    at_once = None if jax.default_backend() == "cpu" else _ON_ACCELERATOR

    def of_targets(targets, *shared):
        return jax.lax.map(lambda target: at(*shared, target), targets, batch_size=at_once)

    shared = curves, near, density
    if mesh is None:
        return fourier.resample(of_targets(jnp.arange(M), *shared), N, axis=1)
    devices = mesh.size
    along = PartitionSpec(mesh.axis_names[0])
    dealt = jax.shard_map(of_targets, mesh=mesh, in_specs=(along, *[PartitionSpec()] * len(shared)), out_specs=along)
    padded = -(-M // devices) * devices
    return fourier.resample(dealt(jnp.arange(padded) % M, *shared)[:M], N, axis=1)
