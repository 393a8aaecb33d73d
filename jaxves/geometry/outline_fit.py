r"""The smooth outline behind noisy points: a truncated Fourier series, and how many of its modes the points support.

    z(t) = Σ_{|m| ≤ modes} c_m e^{imt},   z = x + iy,   least squares in c_m at the parameters t_k of the points

The t_k are found by turns with the c_m: each point moves to the foot of its perpendicular on the curve, and t is made
proportional to arc length. What remains are distances along the normal, so uneven points and noise along the curve do
no harm.

Points carry noise when their distances d_k from the best curve are above `EXACT` of its radius although the best curve
has few modes beside the points. The best number of modes has the least K log Σd² + (2 modes + 1) log K [S]. Nothing
here imports JAX.

[S] G. Schwarz, Estimating the dimension of a model, Ann. Statist. 6 (1978) 461-464.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

EXACT = 1e-4  # of the radius: smaller distances are those of written decimals
_TURNS = 8
_FEW_TURNS = 3  # while modes are added one by one
_FEWEST = 48  # points in which noise can be seen
_MOST = 64  # modes that are tried
_WINDOWS = 60  # half a moving average has this part of the points
_PATIENCE = 12  # modes without a better score, after which none is expected
_SHARE = 3  # noise is told from detail where this many points or more stand for each unknown


class Fitted(NamedTuple):
    """A fitted outline: samples, and the standard deviation of the points along its normal."""

    samples: Float[np.ndarray, "n 2"]
    deviation: float


def fitted(points: Float[np.ndarray, "K 2"], modes: int, count: int) -> Fitted:
    """The outline with this many modes through points in order, as `count` samples even in arc length."""
    z = points[:, 0] + 1j * points[:, 1]
    t = _by_chords(z)
    # With few modes first: noise makes chords longer, here more and there less.
    for few in (*range(1, min(modes, 3)), *[modes] * _TURNS):
        t, _, _ = _turned(z, t, few)
    _, c, deviation = _turned(z, t, modes)
    m = np.arange(-modes, modes + 1)
    even = np.exp(1j * np.outer(2 * np.pi * np.arange(count) / count, m)) @ c
    return Fitted(np.stack([even.real, even.imag], axis=-1), deviation)


def _by_chords(z) -> np.ndarray:
    """The first parameters of the points: in proportion to the length of the polygon of their moving average.

    Where points lie closer than their noise, the polygon of the points themselves goes to and fro.
    """
    width = len(z) // _WINDOWS
    mean = sum(np.roll(z, shift) for shift in range(-width, width + 1)) / (2 * width + 1)
    chord = np.abs(np.roll(mean, -1) - mean)
    return 2 * np.pi * np.concatenate([[0.0], np.cumsum(chord)[:-1]]) / np.sum(chord)


def _turned(z, t, modes: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Better parameters of the points, the coefficients c_m for the given ones, and the deviation from that curve."""
    m = np.arange(-modes, modes + 1)
    waves = np.exp(1j * np.outer(t, m))
    c = np.linalg.lstsq(waves.conj().T @ waves, waves.conj().T @ z, rcond=None)[0]
    apart, d = z - waves @ c, waves @ (1j * m * c)
    across = np.imag(apart * np.conj(d)) / np.abs(d)
    deviation = float(np.sqrt(np.sum(across**2) / max(len(z) - len(m), 1)))
    feet = t + np.clip(np.real(apart * np.conj(d)) / np.abs(d) ** 2, -0.2, 0.2)
    return _by_arc_length(c, m, feet), c, deviation


def _by_arc_length(c, m, t) -> np.ndarray:
    """The parameters in proportion to the arc length of the curve from t = 0 on."""
    count = 8 * len(m)
    speed = np.abs(np.exp(2j * np.pi * np.outer(np.arange(count), m) / count) @ (1j * m * c))
    # Fourier coefficients of the speed, integrated: s = mean t + a periodic part.
    k = np.arange(1, count // 2)
    periodic = np.fft.rfft(speed)[1 : count // 2] / (1j * k) * (2 / count)
    length = np.mean(speed) * t + np.real(np.exp(1j * np.outer(t, k)) @ periodic) - np.real(np.sum(periodic))
    return length / np.mean(speed)


class Noise(NamedTuple):
    """What points say of their own errors: the number of modes they support, and the deviation from those."""

    modes: int
    deviation: float
    radius: float


def noise_of(points: Float[np.ndarray, "K 2"]) -> Noise | None:
    """The noise of points in order, or None where they may be exact."""
    K = len(points)
    if K < _FEWEST:
        return None
    best, least, most = None, np.inf, min(_MOST, K // 4)
    z = points[:, 0] + 1j * points[:, 1]
    t = _by_chords(z)
    for modes in range(1, most + 1):
        for _ in range(_FEW_TURNS):
            t, _, deviation = _turned(z, t, modes)
        if deviation <= EXACT * _radius(points):
            return None
        unknowns = 2 * modes + 1
        score = K * np.log(max(deviation, 1e-300) ** 2 * (K - unknowns) / K) + unknowns * np.log(K)
        if score < least:
            best, least = Noise(modes, deviation, _radius(points)), score
        elif modes >= best.modes + _PATIENCE:
            break
    # Detail goes on beyond the modes that were tried, or hides among few points.
    detailed = 4 * best.modes > 3 * most or _SHARE * (2 * best.modes + 1) > K
    return None if detailed else best


def _radius(points: Float[np.ndarray, "K 2"]) -> float:
    """Of the circle with the perimeter of the hull of the points, about."""
    return float(np.mean(np.linalg.norm(points - np.mean(points, axis=0), axis=1)))
