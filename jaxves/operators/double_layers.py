r"""The Stokes double layer between membranes: velocities at the nodes of each from velocity densities on the others.

Far pairs are summed directly by the trapezoidal rule, and near pairs have stored matrices of close evaluation, as in
`direct_sums`. The potential jumps by the density across its membrane, so without close evaluation its error between
close membranes would not become small.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp

from ..geometry.curve import Curve
from ..numerics.arrays import VesiclePoints
from ..potentials import close_stokes, far
from ..potentials.close_laplace import CloseGeometry
from ..potentials.self_stokes import StokesBlocks
from .direct_sums import summed
from .near_pairs import NearPairs


class AbstractDoubleLayers(eqx.Module):
    """The Stokes double layers of all membranes at the nodes of the others."""

    @abc.abstractmethod
    def __call__(self, u: VesiclePoints) -> VesiclePoints:
        """Returns the velocities D[u] of the other membranes at the nodes of each membrane."""

    @abc.abstractmethod
    def of_near(self, u: VesiclePoints) -> VesiclePoints:
        """Returns the part of the near pairs, which is cheap: an approximation for a preconditioner."""


class DoubleLayers(AbstractDoubleLayers):
    """The curves for far sums, and the matrices of near pairs."""

    curves: Curve
    near: NearPairs
    matrices: StokesBlocks

    @classmethod
    def of(cls, curves: Curve, near: NearPairs) -> "DoubleLayers":
        """Builds the double layers between the M >= 2 membranes in `curves`, of which `near` are the near pairs."""

        @jax.checkpoint
        def of_pair(row):
            target, source, valid = row

            def close():
                return close_matrix(jax.tree.map(lambda leaf: leaf[source], curves), curves.x[target])

            nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(close))
            return jax.lax.cond(valid, close, lambda: nothing)

        return cls(curves, near, jax.lax.map(of_pair, (near.target, near.source, near.valid)))

    def __call__(self, u: VesiclePoints) -> VesiclePoints:
        return summed(far.stokes_dlp, self.curves, self.near, u) + self.of_near(u)

    def of_near(self, u: VesiclePoints) -> VesiclePoints:
        return self.near.summed(jax.vmap(StokesBlocks.__matmul__), self.matrices, u)


def close_matrix(source: Curve, x) -> StokesBlocks:
    """Returns the matrix of D by close evaluation, for targets outside of `source`."""
    return close_stokes.stokes_dlp_matrix(CloseGeometry.of(source, x, inside=False))
