r"""The Stokes double layer between membranes: velocities at the nodes of each from velocity densities on the others.

Far pairs are summed directly by the trapezoidal rule, and near pairs have stored matrices of close evaluation, as in
`direct_sums`. The potential jumps by the density across its membrane, so without close evaluation its error between
close membranes would not become small.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..base.arguments import refusal
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Free
from ..numerics.arrays import VesiclePoints
from ..potentials import close_stokes, far
from ..potentials.close_laplace import CloseGeometry
from ..potentials.self_stokes import StokesBlocks
from .direct_sums import summed
from .interactions import AbstractCoupling
from .near_pairs import NearPairs


class DoubleLayers(eqx.Module):
    """The curves for far sums, and the matrices of near pairs."""

    curves: Curve
    near: NearPairs
    matrices: StokesBlocks

    @classmethod
    def of(cls, curves: Curve, coupling: AbstractCoupling, domain: AbstractDomain) -> "DoubleLayers":
        """Builds the double layers between the M >= 2 membranes in `curves`.

        Raises:
            ValueError: the domain is periodic.
        """
        if not isinstance(domain, Free):
            raise refusal("domain", domain, "free space, where viscosities differ")
        near = NearPairs.of(curves, coupling.room(curves.x.shape[0]), coupling.near, domain)

        @jax.checkpoint
        def of_pair(row):
            target, source, valid = row

            def close():
                source_curve = jax.tree.map(lambda leaf: leaf[source], curves)
                return close_stokes.stokes_dlp_matrix(CloseGeometry.of(source_curve, curves.x[target], inside=False))

            nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(close))
            return jax.lax.cond(valid, close, lambda: nothing)

        return cls(curves, near, jax.lax.map(of_pair, (near.target, near.source, near.valid)))

    def __call__(self, u: VesiclePoints) -> VesiclePoints:
        near = self.near.summed(jax.vmap(StokesBlocks.__matmul__), self.matrices, u)
        return summed(far.stokes_dlp, self.curves, self.near, u) + near
