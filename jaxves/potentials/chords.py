r"""Differences of all pairs of nodes of one curve. They are computed once and used by all kernels of the curve.

The log of the chord is Kress's split [K]:

    log|x_i - x_j| = ½ log(4 sin²((α_i - α_j)/2)) + smooth,      smooth → log|x_α| on the diagonal

[K] R. Kress, Linear Integral Equations, 3rd ed., §12.3.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix


class Chords(eqx.Module):
    """The components of r = x_i - x_j, 1/|r|² (1 on the diagonal), and the smooth part of log|r|."""

    rx: NodeMatrix
    ry: NodeMatrix
    inverse_r2: NodeMatrix
    smooth_log: NodeMatrix

    @classmethod
    def of(cls, curve: Curve) -> "Chords":
        """Returns the differences of all pairs of nodes of `curve`."""
        N = curve.x.shape[0]
        eye = jnp.eye(N)
        chord2 = fourier.spread(4 * np.sin(np.pi * np.arange(N) / N) ** 2 + (np.arange(N) == 0))
        rx = curve.x[:, None, 0] - curve.x[None, :, 0]
        ry = curve.x[:, None, 1] - curve.x[None, :, 1]
        # Adding `eye` keeps logarithm, quotient and their gradients finite on the diagonal. The logarithm is 0 there,
        # and the limit is added to it.
        inverse_r2 = 1.0 / (rx**2 + ry**2 + eye)
        smooth = -0.5 * jnp.log(inverse_r2 * chord2) + eye * jnp.log(curve.speed)
        return cls(rx, ry, inverse_r2, smooth)
