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
from ..geometry.domain import AbstractDomain
from ..numerics import fourier
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..potentials import far
from ..potentials.self_stokes import StokesBlocks
from .interactions import NEAR, AbstractCoupling, AbstractInteractions
from .near_pairs import NearPairs
from .pairs import Pairwise, close_matrices, times

_FEWEST = 16  # least number of nodes in sums for the preconditioner
_ON_ACCELERATOR = 32  # targets that are summed at once on a GPU, where many small kernels are slow
_TOGETHER = 512  # up to so many nodes in all, one matrix is used for the linear part of all shapes


class MatrixFree(AbstractCoupling):
    """Computes sums instead of storing matrices. Coupled systems are solved by GMRES.

    `neighbours` is the room for near pairs, per vesicle on average. `mesh` has devices along one axis that share the
    work.
    """

    neighbours: int = eqx.field(static=True, default=8)
    mesh: Mesh | None = eqx.field(static=True, default=None)
    near: float = eqx.field(static=True, default=NEAR)
    direct = False
    together = False

    def between(self, curves: Curve, domain: AbstractDomain, *, electric: bool) -> "Summation":
        return Summation.of(curves, self, domain, electric=electric)


class Summation(AbstractInteractions):
    """The curves for far sums, and the matrices of near pairs. More nodes of the curves make far sums more accurate."""

    curves: Curve
    near: NearPairs
    velocity: StokesBlocks
    gradient: Float[Array, "K 2 N N"] | None
    mesh: Mesh | None = eqx.field(static=True)

    @classmethod
    def of(cls, curves: Curve, coupling: MatrixFree, domain: AbstractDomain, *, electric: bool) -> "Summation":
        """Builds the interactions of the M membranes in `curves`."""
        near = NearPairs.of(curves, coupling.neighbours, coupling.near, domain)

        @jax.checkpoint
        def matrices(row):
            target, source, valid = row

            def close():
                return close_matrices(jax.tree.map(lambda leaf: leaf[source], curves), curves.x[target], electric)

            nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(close))
            return jax.lax.cond(valid, close, lambda: nothing)

        found = jax.lax.map(matrices, (near.target, near.source, near.valid))
        return cls(curves, near, *found, coupling.mesh)

    @property
    def crowded(self) -> Bool[Array, ""]:
        return self.near.overflow

    def any_near(self) -> Bool[Array, ""]:
        return jnp.any(self.near.valid)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        near = jax.vmap(StokesBlocks.__matmul__)(self.velocity, f[self.near.source])
        return self._summed(far.stokes_slp, f).at[self.near.target].add(near)

    def slp_gradient(self, q: VesicleNodes) -> VesiclePoints:
        near = times(self.gradient, q[self.near.source])
        return self._summed(far.laplace_slp_gradient, q).at[self.near.target].add(near)

    def roughly(self) -> "Summation":
        """Returns the same with fewer nodes in far sums."""
        nodes = max(_FEWEST, self.curves.x.shape[1] // 4)
        x = fourier.resample(self.curves.x, nodes, axis=1)
        return eqx.tree_at(lambda s: s.curves, self, jax.vmap(Curve.from_nodes)(x))

    def _summed(self, potential, density: Float[Array, "M N *rest"]) -> VesiclePoints:
        """Returns, at the nodes of each membrane, the sum of `potential` over all membranes that are far from it."""
        M, N = density.shape[:2]
        density = fourier.resample(density, self.curves.x.shape[1], axis=1)

        @jax.checkpoint
        def at(curves, near, density, target):
            left_out = near.sources_of(target, M) | (jnp.arange(M) == target)
            left_out = left_out.reshape(M, *[1] * (density.ndim - 1))
            return potential(curves, jnp.where(left_out, 0.0, density), curves.x[target])

        at_once = None if jax.default_backend() == "cpu" else _ON_ACCELERATOR

        def of_targets(targets, *shared):
            return jax.lax.map(lambda target: at(*shared, target), targets, batch_size=at_once)

        shared = self.curves, self.near, density
        if self.mesh is None:
            return fourier.resample(of_targets(jnp.arange(M), *shared), N, axis=1)
        devices = self.mesh.size
        along = PartitionSpec(self.mesh.axis_names[0])
        dealt = jax.shard_map(
            of_targets, mesh=self.mesh, in_specs=(along, *[PartitionSpec()] * len(shared)), out_specs=along
        )
        padded = -(-M // devices) * devices
        return fourier.resample(dealt(jnp.arange(padded) % M, *shared)[:M], N, axis=1)


def coupling_for(M: int, N: int, neighbours: int = 8) -> AbstractCoupling | None:
    """Returns the fastest method for M membranes of N nodes; None for one membrane.

    By the measurements of `experiments/scale.py`, GMRES is faster than the factorisation from 3 to 4 membranes on. Sums
    are faster than matrices from about 1024 unknowns on, where the matrices take 42 MB.
    """
    if M == 1:
        return None
    if M * N > 1024:
        return MatrixFree(neighbours)
    return Pairwise(direct=M * N <= 192, together=M * N <= _TOGETHER)
