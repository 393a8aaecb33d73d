r"""Fits a smooth outline to noisy points: a truncated Fourier series, and the choice of its number of modes.

    z(t) = Σ_{|m| ≤ modes} c_m e^{imt},   z = x + iy,   least squares in c_m at the parameters t_k of the points

The t_k and the c_m are updated in turn. Each t_k becomes the parameter of the nearest point of the curve, and then t is
made proportional to arc length. The remaining distances are normal to the curve. Uneven points and noise along the
curve therefore do not change the result.

Points are noisy if their distances d_k from the best curve exceed `EXACT` times its radius although this curve has few
modes compared with the number of points. The best number of modes minimises K log Σd² + (2 modes + 1) log K [S].
Nothing here imports JAX.

[S] G. Schwarz, Estimating the dimension of a model, Ann. Statist. 6 (1978) 461-464.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

EXACT = 1e-4  # relative to the radius; smaller distances come from the number of decimals in a file
_TURNS = 8
_FEW_TURNS = 3  # the same while modes are added one by one
_FEWEST = 48  # with fewer points, noise is not estimated
_MOST = 64  # largest number of modes that is tried
_WINDOWS = 60  # half a moving average spans the number of points divided by this
_PATIENCE = 12  # the search ends after so many modes without a better score
_SHARE = 3  # least number of points per unknown for which noise can be distinguished from detail


class Fitted(NamedTuple):
    """A fitted outline: samples (n, 2), and the standard deviation of the points along its normal.

    `feet` are the parameters in (-π, 3π) of the points' nearest places, proportional to arc length. `inside` are the
    distances of the points from there, positive on the left of the curve, which is inside if it is counter-clockwise.
    """

    samples: Float[np.ndarray, "n 2"]
    deviation: float
    feet: Float[np.ndarray, "K"]
    inside: Float[np.ndarray, "K"]


def fitted(points: Float[np.ndarray, "K 2"], modes: int, count: int) -> Fitted:
    """Fits an outline with this many modes to points in order; returns `count` samples equispaced in arc length."""
    z = points[:, 0] + 1j * points[:, 1]
    t = _by_chords(z)
    # It starts with few modes, because noise makes the chords longer by different amounts.
    for few in (*range(1, min(modes, 3)), *[modes] * _TURNS):
        t, _, _ = _turned(z, t, few)
    _, c, across = _turned(z, t, modes)
    m = np.arange(-modes, modes + 1)
    even = np.exp(1j * np.outer(2 * np.pi * np.arange(count) / count, m)) @ c
    return Fitted(np.stack([even.real, even.imag], axis=-1), deviation_of(across, modes), t, across)


def deviation_of(across: Float[np.ndarray, "K"], modes: int) -> float:
    """Returns the standard deviation of points whose distances from the curve are `across`."""
    return float(np.sqrt(np.sum(across**2) / max(len(across) - (2 * modes + 1), 1)))


def _by_chords(z) -> np.ndarray:
    """Returns initial parameters of the points, proportional to the length of the polygon of their moving average.

    If the points are closer than their noise, the polygon of the points themselves would move back and forth.
    """
    width = len(z) // _WINDOWS
    mean = sum(np.roll(z, shift) for shift in range(-width, width + 1)) / (2 * width + 1)
    chord = np.abs(np.roll(mean, -1) - mean)
    return 2 * np.pi * np.concatenate([[0.0], np.cumsum(chord)[:-1]]) / np.sum(chord)


def _turned(z, t, modes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Makes one update; returns new parameters, the coefficients c_m for the old ones, and the distances from them."""
    m = np.arange(-modes, modes + 1)
    waves = np.vander(np.exp(1j * t), len(m), increasing=True) * np.exp(-1j * modes * t)[:, None]
    c = np.linalg.lstsq(waves.conj().T @ waves, waves.conj().T @ z, rcond=None)[0]
    apart, d = z - waves @ c, waves @ (1j * m * c)
    across = np.imag(apart * np.conj(d)) / np.abs(d)
    feet = t + np.clip(np.real(apart * np.conj(d)) / np.abs(d) ** 2, -0.2, 0.2)
    return _by_arc_length(c, m, feet), c, across


def _by_arc_length(c, m, t) -> np.ndarray:
    """Returns parameters proportional to the arc length of the curve, measured from t = 0."""
    count = 8 * len(m)
    speed = np.abs(np.exp(2j * np.pi * np.outer(np.arange(count), m) / count) @ (1j * m * c))
    # Fourier coefficients of the speed, integrated: s = mean t + a periodic part.
    k = np.arange(1, count // 2)
    periodic = np.fft.rfft(speed)[1 : count // 2] / (1j * k) * (2 / count)
    sums = np.polyval([*periodic[::-1], 0.0], np.exp(1j * t)) - np.sum(periodic)
    return t + np.real(sums) / np.mean(speed)


class Noise(NamedTuple):
    """The noise of points: the best number of modes, the deviation from that curve, and the radius."""

    modes: int
    deviation: float
    radius: float


def by_modes(
    points: Float[np.ndarray, "K 2"], most: int
) -> Iterator[tuple[Float[np.ndarray, "K"], Float[np.ndarray, "K"]]]:
    """Yields the feet of points in order and their distances from the curves with 1, 2, …, `most` modes (`Fitted`)."""
    z = points[:, 0] + 1j * points[:, 1]
    t = _by_chords(z)
    for modes in range(1, most + 1):
        for _ in range(_FEW_TURNS - 1):
            t, _, _ = _turned(z, t, modes)
        feet = t
        t, _, across = _turned(z, t, modes)
        yield feet, across


def noise_of(points: Float[np.ndarray, "K 2"]) -> Noise | None:
    """Estimates the noise of points in order; returns None if they may be exact."""
    K = len(points)
    if K < _FEWEST:
        return None
    best, least, most = None, np.inf, min(_MOST, K // 4)
    for modes, (_, across) in enumerate(by_modes(points, most), start=1):
        deviation = deviation_of(across, modes)
        if deviation <= EXACT * radius(points):
            return None
        score = K * np.log(max(np.mean(across**2), 1e-300)) + (2 * modes + 1) * np.log(K)
        if score < least:
            best, least = Noise(modes, deviation, radius(points)), score
        elif modes >= best.modes + _PATIENCE:
            break
    # Then the points may be exact: the outline has more modes than were tried, or there are too few points to decide.
    detailed = 4 * best.modes > 3 * most or _SHARE * (2 * best.modes + 1) > K
    return None if detailed else best


def radius(points: Float[np.ndarray, "K 2"]) -> float:
    """Returns the mean distance of the points from their centre."""
    return float(np.mean(np.linalg.norm(points - np.mean(points, axis=0), axis=1)))
