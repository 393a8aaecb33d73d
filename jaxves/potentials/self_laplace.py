r"""Laplace layer potentials on one curve (self-interaction), as symmetric or transposable kernels.

    S[q](x)  = ∮ G(x-y) q(y) ds_y,               G(r) = -log|r| / 2π
    D[V](x)  = ∮ ∂G(x-y)/∂n_y V(y) ds_y          principal value: interior limit D - ½, exterior D + ½
    S'[q](x) = ∮ ∂G(x-y)/∂n_x q(y) ds_y          principal value: interior limit S' + ½, exterior S' - ½
    D'[V]    = ∂_s S[∂_s V]                      hypersingular, through tangential derivatives [H]

A kernel `k` maps a density times |x_α| at the nodes to the potential at the same nodes: S q = k (|x_α| q).
So weighted, S is symmetric, and D is the transpose of S'. S is log-singular: Kress's split, the log
handled by its exact Fourier symbol -π/|k|. S' is smooth, with the diagonal limit -κ/4π.

[H] G. C. Hsiao, W. L. Wendland, Boundary Integral Equations, §1.2.
"""

import jax.numpy as jnp
import numpy as np

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix
from .chords import Chords


def _log_rule(N: int) -> np.ndarray:
    """∫ ½ log(4 sin²((α_i - α)/2)) f(α) dα as the first column of a circulant matrix: symbol -π/|k|, 0 for k = 0."""
    k = fourier.wavenumbers(N).astype(float)
    return np.fft.irfft(np.where(k > 0, -np.pi / np.maximum(k, 1), 0.0), N)


def slp(chords: Chords) -> NodeMatrix:
    """Kernel of S, symmetric."""
    N = chords.rx.shape[0]
    return fourier.spread(_log_rule(N) * (-0.5 / np.pi)) - chords.smooth_log / N


def slp_dn(curve: Curve, chords: Chords) -> NodeMatrix:
    """Kernel of S', principal value; its transpose is the kernel of D."""
    N = chords.rx.shape[0]
    kernel = (chords.rx * curve.normal[:, 0, None] + chords.ry * curve.normal[:, 1, None]) * chords.inverse_r2
    return (kernel + 0.5 * jnp.diag(curve.curvature)) * (-1.0 / N)
