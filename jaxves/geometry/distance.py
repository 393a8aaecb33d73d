"""Distances of points from a curve, which do not depend on where its nodes are."""

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..numerics import fourier
from ..numerics.arrays import NodePoints

_FINER = 4  # points per node among which the nearest one is looked for
_STEPS = 4  # of Newton's method from there


def depths(x: NodePoints, points: Float[Array, "K 2"]) -> Float[Array, "K"]:
    """Returns the distances (K,) of points from a counter-clockwise curve, positive inside of it.

    The curve is the trigonometric interpolant of its nodes. The derivative of a depth is the outward
    displacement of the nearest place, because a motion of that place along the curve does not change it in first order.
    """
    N = x.shape[0]
    modes = fourier.coefficients(x)
    k = jnp.arange(N // 2 + 1)[:, None]
    slopes = (k * modes[1], -k * modes[0])
    fine = fourier.resample(x, _FINER * N, axis=0)
    nearest = jnp.argmin(jnp.sum((points[:, None] - fine) ** 2, axis=-1), axis=1)
    alpha = lax.stop_gradient(_feet(points, modes, slopes, k, nearest * (2 * np.pi / (_FINER * N))))
    apart, d = points - fourier.series(modes, alpha), fourier.series(slopes, alpha)
    inward = jnp.stack([-d[:, 1], d[:, 0]], axis=-1) / jnp.sqrt(jnp.sum(d**2, axis=-1))[:, None]
    return jnp.sum(apart * inward, axis=-1)


def _feet(points, modes, slopes, k, alpha) -> Float[Array, "K"]:
    """Returns the parameters of the nearest places, by Newton's method from the nearest of many points."""
    bends = (k * slopes[1], -k * slopes[0])
    most = np.pi / (_FINER * (len(k) - 1))  # the spacing of these points
    for _ in range(_STEPS):
        apart, d = points - fourier.series(modes, alpha), fourier.series(slopes, alpha)
        speed = jnp.sum(d**2, axis=-1)
        slope = jnp.maximum(speed - jnp.sum(apart * fourier.series(bends, alpha), axis=-1), 0.1 * speed)
        alpha = alpha + jnp.clip(jnp.sum(apart * d, axis=-1) / slope, -most, most)
    return alpha
