r"""Laplace layer potentials on one curve (self-interaction), as kernels that are symmetric or transposes of others.

    S[q](x)  = ∮ G(x-y) q(y) ds_y,               G(r) = -log|r| / 2π
    D[V](x)  = ∮ ∂G(x-y)/∂n_y V(y) ds_y          principal value: interior limit D - ½, exterior D + ½
    S'[q](x) = ∮ ∂G(x-y)/∂n_x q(y) ds_y          principal value: interior limit S' + ½, exterior S' - ½
    D'[V]    = ∂_s S[∂_s V]                      hypersingular, through tangential derivatives [H]

A kernel `k` maps a density times |x_α| at the nodes to the potential at the same nodes: S q = k (|x_α| q).
With this weight, S is symmetric and D is the transpose of S'. S has a logarithmic singularity. Kress's split (`chords`)
separates it, and its quadrature uses the exact Fourier symbol -π/|k| of the periodic logarithm. S' is smooth, with the
limit -κ/4π on the diagonal.

[H] G. C. Hsiao, W. L. Wendland, Boundary Integral Equations, §1.2.
"""

import jax.numpy as jnp
import numpy as np

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix
from .chords import Chords


def _log_rule(N: int) -> np.ndarray:
    """Returns the first column of the circulant matrix of ∫ ½ log(4 sin²((α_i - α)/2)) f(α) dα.

    Its Fourier symbol is -π/|k|, and 0 for k = 0.
    """
    k = fourier.wavenumbers(N).astype(float)
    return np.fft.irfft(np.where(k > 0, -np.pi / np.maximum(k, 1), 0.0), N)


def slp(chords: Chords) -> NodeMatrix:
    """Returns the kernel of S, which is symmetric."""
    N = chords.rx.shape[0]
    return fourier.spread(_log_rule(N) * (-0.5 / np.pi)) - chords.smooth_log / N


def slp_dn(curve: Curve, chords: Chords) -> NodeMatrix:
    """Returns the kernel of S' (principal value). Its transpose is the kernel of D."""
    N = chords.rx.shape[0]
    kernel = (chords.rx * curve.normal[:, 0, None] + chords.ry * curve.normal[:, 1, None]) * chords.inverse_r2
    return (kernel + 0.5 * jnp.diag(curve.curvature)) * (-1.0 / N)
