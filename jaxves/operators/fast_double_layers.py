r"""The Stokes double layer between membranes by fast sums, in the plane and in periodic cells.

As in `fast_sums`, the smooth part of each membrane on itself is subtracted, and near pairs have matrices of close
evaluation less the smooth part. A preconditioner needs their whole interaction, but roughly. The smooth part is added
there on half of the nodes.

In a periodic cell with the area A, the sums have zero mean over the cell. The velocity of the fluid is w outside of the
membranes and w/ν inside, with w = v_∞ + S[f] + D[(1 - ν) v]. Its mean over the cell is that of v_∞ only with

    D[u] = (sums over all images) - (1/A) Σ ∮ (x - x_0) u·n ds

because the integral of v over the inside is ∮ (x - x_0) v·n ds, for any x_0. Then also D[rigid motion] is minus this
motion inside of a membrane and zero outside, as in the plane. x_0 is the centre of the nodes, so that the result does
not depend on the image of a vesicle.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..ewald.stresslets import StressletSums
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain
from ..numerics import fourier
from ..numerics.arrays import VesiclePoints
from ..numerics.batching import greatest
from ..potentials import far
from .direct_sums import summed
from .double_layers import AbstractDoubleLayers, close_matrix
from .fast_sums import FastSummation, smooth_of_near
from .near_pairs import NearPairs


class FastDoubleLayers(AbstractDoubleLayers):
    """Fast sums, the smooth part of each membrane on itself, and matrices for near pairs less the smooth part.

    `area` is that of a periodic cell, None in the plane.
    """

    curves: Curve
    sums: StressletSums
    own: Float[Array, "M n n"]
    near: NearPairs
    matrices: Float[Array, "K n n"]
    smooth: Float[Array, "K m m"]
    area: Float[Array, ""] | None

    @classmethod
    def of(cls, curves: Curve, interactions: FastSummation, domain: AbstractDomain) -> "FastDoubleLayers":
        """Builds the double layers of the membranes in `curves` with the lists of their `interactions`."""
        near = interactions.near
        sums = StressletSums.of(interactions.sums, curves.normal, domain)

        @jax.checkpoint
        def of_pair(row):
            target, valid, source = row[0], row[1], near.source_curve(row[2], curves, domain)

            def close():
                x = curves.x[target]
                blocks = close_matrix(source, x)
                whole = jnp.block([[blocks.xx, blocks.xy], [blocks.xy, blocks.yy]])
                fewer = Curve.from_nodes(fourier.resample(source.x, x.shape[0] // 2, axis=0))
                return whole - _smooth(sums, x, source), _smooth(sums, x[::2], fewer)

            nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(close))
            return lax.cond(valid, close, lambda: nothing)

        matrices, smooth = lax.map(of_pair, (near.target, near.valid, jnp.arange(near.valid.shape[0])))
        own = jax.vmap(lambda curve: _smooth(sums, curve.x, curve))(curves)
        area = None if interactions.cell is None else interactions.cell.area()
        return cls(curves, sums, own, near, matrices, lax.stop_gradient(smooth), area)

    def __call__(self, u: VesiclePoints) -> VesiclePoints:
        near = self._close(u)

        def fast(u):
            return self.sums(u) - _times(self.own, u)

        if self.area is not None:
            return fast(u) + near - self._mean(u)

        def direct(u):
            def product(x, source, u):
                return _times(_smooth(self.sums, x, source)[None], u[None])[0]

            return summed(far.stokes_dlp, self.curves, self.near, u) + smooth_of_near(
                self.curves, self.near, product, u
            )

        return lax.cond(greatest(jnp.int32(self.sums.sums.overflow)) > 0, direct, fast, u) + near

    def of_near(self, u: VesiclePoints) -> VesiclePoints:
        N = u.shape[1]
        smooth = self.near.summed(_times, self.smooth, fourier.resample(u, N // 2, axis=1))
        return self._close(u) + fourier.resample(smooth, N, axis=1)

    def _close(self, u: VesiclePoints) -> VesiclePoints:
        return self.near.summed(_times, self.matrices, u)

    def _mean(self, u: VesiclePoints) -> Float[Array, "2"]:
        curves = self.curves
        arm = curves.x - lax.stop_gradient(jnp.mean(curves.x, axis=1, keepdims=True))
        flux = curves.weights * jnp.sum(u * curves.normal, axis=-1)
        return jnp.sum(arm * flux[..., None], axis=(0, 1)) / self.area


def _smooth(sums: StressletSums, x: Float[Array, "P 2"], source: Curve) -> Float[Array, "p n"]:
    return sums.smooth_matrix(x, source.x, source.normal, source.weights)


def _times(matrices: Float[Array, "k n n"], u: Float[Array, "k N 2"]) -> Float[Array, "k N 2"]:
    k, N, _ = u.shape
    velocity = jnp.einsum("kij,kj->ki", matrices, jnp.swapaxes(u, 1, 2).reshape(k, 2 * N))
    return jnp.swapaxes(velocity.reshape(k, 2, N), 1, 2)
