r"""Nodes to a regular grid and back, by windows of a few grid cells.

    φ(z) = e^{-β} cosh(β √(1 - (2z/w)²)),  β = 2.3 w,  zero for |z| > w/2,         z in grid cells

The hyperbolic cosine is smooth up to the edge, where it is e^{-β}, so that second derivatives are accurate too.

A cluster of consecutive nodes touches one patch of P × P grid points, so the windows of its nodes are two matrices, and
spreading is a product of them. Patches are added to a grid with a rim, which is folded over for a periodic grid. The
window is divided out in Fourier space.
"""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

_STEEPNESS = 2.3


class Windows(eqx.Module):
    """The windows of C clusters of n nodes along both axes, and the corners of their patches in the grid."""

    along: Float[Array, "2 C n P"]
    corner: Int[Array, "C 2"]
    fits: Bool[Array, ""]
    grid: tuple[int, int] = eqx.field(static=True)

    @classmethod
    def of(cls, z: Float[Array, "C n 2"], grid: tuple[int, int], patch: int, width: int) -> "Windows":
        """Builds the windows at positions z in grid cells, which may be outside of the periodic grid."""
        fixed = lax.stop_gradient(z)
        first = jnp.floor(jnp.min(fixed, axis=1) - width / 2).astype(jnp.int32) + 1
        last = jnp.floor(jnp.max(fixed, axis=1) + width / 2).astype(jnp.int32)
        places = first[:, None, :, None] + np.arange(patch, dtype=np.int32)
        along = _window(places - z[..., None], width)
        fits = jnp.all(last - first < patch)
        return cls(jnp.moveaxis(along, 2, 0), jnp.mod(first, np.array(grid, np.int32)), fits, grid)

    def spread(self, density: Float[Array, "C n k"]) -> Float[Array, "k n1 n2"]:
        """Returns the densities on the periodic grid."""
        P = self.along.shape[-1]
        wx, wy = self.along
        weighted = density[..., None] * wy[:, :, None]  # (C, n, k, P)
        patches = jnp.einsum("cni,cnkj->ckij", wx, weighted)
        n1, n2 = self.grid
        k = density.shape[-1]
        numbers = lax.ScatterDimensionNumbers((1, 2, 3), (), (1, 2))
        whole = lax.scatter_add(jnp.zeros((k, n1 + P, n2 + P)), self.corner, patches, numbers)
        for axis, n in ((1, n1), (2, n2)):
            whole = _folded(whole, axis, n)
        return whole

    def interpolated(self, values: Float[Array, "k n1 n2"]) -> Float[Array, "C n k"]:
        """Returns the values of a periodic grid at the nodes."""
        P = self.along.shape[-1]
        wx, wy = self.along
        rimmed = jnp.pad(values, ((0, 0), (0, P), (0, P)), mode="wrap")
        k = values.shape[0]
        numbers = lax.GatherDimensionNumbers((1, 2, 3), (), (1, 2))
        patches = lax.gather(rimmed, self.corner, numbers, (k, P, P))
        return jnp.sum(jnp.einsum("cni,ckij->cnkj", wx, patches) * wy[:, :, None], axis=-1)


def _folded(whole: Float[Array, "..."], axis: int, n: int) -> Float[Array, "..."]:
    """Adds what lies beyond n along an axis to the beginning, as often as needed."""
    rim = whole.shape[axis] - n
    inner = lax.slice_in_dim(whole, 0, n, axis=axis)
    for start in range(0, rim, n):
        part = lax.slice_in_dim(whole, n + start, n + min(start + n, rim), axis=axis)
        widths = [(0, 0)] * whole.ndim
        widths[axis] = (0, n - part.shape[axis])
        inner = inner + jnp.pad(part, widths)
    return inner


def _window(z: Float[Array, "*points"], width: int) -> Float[Array, "*points"]:
    square, steepness = 1 - (z * (2 / width)) ** 2, _STEEPNESS * width
    inside = square > 0
    grown = jnp.exp(steepness * (jnp.sqrt(jnp.where(inside, square, 1.0)) - 1))
    return jnp.where(inside, 0.5 * (grown + np.exp(-2 * steepness) / grown), 0.0)


@functools.cache
def window_transform(n: int, width: int) -> np.ndarray:
    """Returns the Fourier transform of the window at the modes of a grid of n points, in the order of an FFT."""
    node, weight = np.polynomial.legendre.leggauss(20 + 4 * width)
    # z = ½ w sin θ removes the roots at the ends
    theta = 0.5 * np.pi * node
    z = 0.5 * width * np.sin(theta)
    steepness = _STEEPNESS * width
    value = 0.5 * (np.exp(steepness * (np.cos(theta) - 1)) + np.exp(-steepness * (np.cos(theta) + 1)))
    value = value * weight * 0.5 * np.pi * 0.5 * width * np.cos(theta)
    modes = 2 * np.pi * np.fft.fftfreq(n)
    return np.cos(np.multiply.outer(modes, z)) @ value


def as_clusters(values: Float[Array, "M N *rest"], cluster: int) -> Float[Array, "C n *rest"]:
    """Returns arrays over all nodes as clusters of consecutive nodes."""
    return values.reshape(-1, cluster, *values.shape[2:])
