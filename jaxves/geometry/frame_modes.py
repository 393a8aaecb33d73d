r"""The number of Fourier modes that the outlines of a film need, and the noise in these modes.

The points are compared with curves of a few modes, which are within `_CLOSE` of them. Their distances have the power
Q_k in the mode k along the curve, as a variance per point, averaged over T frames. The power of a shape falls steeply
with k, and that of noise hardly. So m modes are enough when the mean power of the next modes is at most twice that of
the modes after them:

    ⟨Q⟩ over k = m+1 … m+4  ≤  (2 + 3/√(4T)) ⟨Q⟩ over k = m+5 … m+12

The second term is three standard errors. The noise in the modes up to m is the value S_0 of the spectrum of blurred
independent errors, S_k = S_0 e^{-(kℓ)²}, with the best likelihood of Whittle [W] for k = m+5 … m+28 and S_0 at most
twice S_{m+8}. Errors of neighbouring points may therefore be correlated. Nothing here imports JAX.

[W] P. Whittle, Estimation and information in stationary time series, Ark. Mat. 2 (1953) 423-434.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from . import outline_fit
from .frame_measures import basis

SPARE = 3  # least number of points per unknown of a curve
FEWEST = 48  # with fewer points in a frame the noise cannot be estimated
_BAND = 64  # highest mode that is looked at
_CLOSE, _MOST_COARSE = 0.02, 8  # relative to the radius; modes of the curves that points are compared with
_NEXT, _AFTER, _WINDOW = 4, 8, 24  # numbers of modes
_RATIOS = np.linspace(1.0, 2.0, 21)  # S_0 over S_k at the middle of the modes k = m+5 … m+12


class Detail(NamedTuple):
    """The number of modes, and the noise in them as a variance per point."""

    modes: int
    density: float


def detail(films: Sequence[Float[np.ndarray, "_ 2"]], modes: int | None) -> Detail:
    """Returns the number of modes for the points of all frames, or `modes` if given, and the noise in them."""
    fewest = min(len(points) for points in films)
    band = min(_BAND, (fewest - 1) // SPARE)
    size = float(np.mean([outline_fit.radius(points) for points in films]))
    coarse, power = _power(films, band, min(_MOST_COARSE, modes or _MOST_COARSE), _CLOSE * size)
    if modes is not None:
        return Detail(modes, _noise(power, min(max(modes, coarse), band - _NEXT - 2)))
    least = 2 + 3 / np.sqrt(_NEXT * len(films))
    for m in range(coarse, band - _NEXT - _AFTER):
        near, far = power[m : m + _NEXT], power[m + _NEXT : m + _NEXT + _AFTER]
        if np.mean(near) <= max(least * np.mean(far), (outline_fit.EXACT * size) ** 2):
            break
    return Detail(m, _noise(power, m))


def _power(films, band: int, most: int, close: float) -> tuple[int, Float[np.ndarray, "band"]]:
    """Returns the number of modes of the coarse curves, and the power of the distances from them for k = 1 to band."""
    coarse, series = 0, [outline_fit.by_modes(points, most) for points in films]
    for found in zip(*series, strict=True):
        coarse += 1
        if max(np.sqrt(np.mean(across**2)) for _, across in found) <= close:
            break
    powers = []
    for feet, across in found:
        B = basis(feet, band)
        inverse = np.linalg.inv(B.T @ B)
        powers.append((inverse @ (B.T @ across)) ** 2 / np.diag(inverse))
    return coarse, np.mean(np.array(powers)[:, 1:].reshape(len(films), band, 2), axis=(0, 2))


def _noise(power: Float[np.ndarray, "band"], modes: int) -> float:
    """Returns the noise S_0 if curves with these modes leave nothing else."""
    first = modes + _NEXT + 1
    power = power[first - 1 : first - 1 + _WINDOW]
    k, middle = first + np.arange(len(power)), first + (_AFTER - 1) / 2
    least, found = np.inf, 0.0
    for ratio in _RATIOS:
        shape = ratio ** (-((k / middle) ** 2))
        density = max(float(np.mean(power / shape)), 1e-300)
        score = float(np.sum(np.log(density * shape)))
        if score < least:
            least, found = score, density
    return found
