r"""Perimeters, areas and reduced areas of curves with noise, corrected for the noise, with standard errors.

A curve that is displaced along its outward normal by a small random δ(s) with mean zero has on average

    L + ½ ∮ ⟨(∂_s δ)²⟩ ds   instead of L,        A + ½ ∮ κ ⟨δ²⟩ ds   instead of A,

so noise makes it longer and less round. These terms are subtracted. In first order the errors are ∮ κ δ ds and ∮ δ ds.
Nothing here imports JAX.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Measure(NamedTuple):
    """A number, or one for each frame, and its standard error."""

    value: float | Float[np.ndarray, "T"]
    error: float | Float[np.ndarray, "T"]

    def mean(self, unit: float = 1.0) -> "Measure":
        """Returns the mean over the frames times `unit`; its error also covers a scatter beyond the noise."""
        T = len(self.value)
        noise = np.sqrt(np.mean(self.error**2) / T)
        scatter = np.std(self.value, ddof=1) / np.sqrt(T) if T > 1 else 0.0
        return Measure(float(unit * np.mean(self.value)), float(unit * max(noise, scatter)))


class Measures(NamedTuple):
    """Perimeter, area and reduced area of each frame."""

    length: Measure
    area: Measure
    reduced_area: Measure


def basis(t: Float[np.ndarray, "n"], modes: int) -> Float[np.ndarray, "n C"]:
    """Returns the columns 1, cos t, sin t, …, cos(modes t), sin(modes t)."""
    phase = np.outer(t, np.arange(1, modes + 1))
    waves = np.stack([np.cos(phase), np.sin(phase)], axis=-1).reshape(len(t), 2 * modes)
    return np.concatenate([np.ones((len(t), 1)), waves], axis=1)


def measures(curves: Sequence[Float[np.ndarray, "n 2"]], covariance: Sequence[Float[np.ndarray, "C C"]]) -> Measures:
    """Returns the measures of T counter-clockwise curves whose normal displacement by modes has this covariance."""
    rows = np.array([_measured(curve, C) for curve, C in zip(curves, covariance, strict=True)])
    return Measures(*(Measure(rows[:, 2 * i], rows[:, 2 * i + 1]) for i in range(3)))


def _measured(curve: Float[np.ndarray, "n 2"], C: Float[np.ndarray, "C C"]) -> Float[np.ndarray, "6"]:
    n, modes = len(curve), len(C) // 2
    z = curve[:, 0] + 1j * curve[:, 1]
    wave = np.fft.fft(z) * 1j * np.fft.fftfreq(n, 1 / n)
    d, dd = np.fft.ifft(wave), np.fft.ifft(wave * 1j * np.fft.fftfreq(n, 1 / n))
    speed = np.abs(d)
    curvature = np.imag(np.conj(d) * dd) / speed**3
    length, area = 2 * np.pi * np.mean(speed), np.pi * np.mean(np.imag(np.conj(z) * d))
    B = basis(2 * np.pi * np.arange(n) / n, modes)
    order = np.concatenate([[0], np.repeat(np.arange(1, modes + 1), 2)])
    slopes = (2 * np.pi / length) ** 2 * length * np.sum(np.diag(C) * order**2) / 2  # ½ of it for cosines and sines
    squares = np.einsum("nc,cd,nd->n", B, C, B)
    length -= slopes / 2
    area -= np.mean(curvature * squares) * length / 2
    of_length, of_area = length / n * curvature @ B, length / n * np.sum(B, axis=0)
    reduced = 4 * np.pi * area / length**2
    of_reduced = reduced * (of_area / area - 2 * of_length / length)
    errors = [np.sqrt(g @ C @ g) for g in (of_length, of_area, of_reduced)]
    return np.array([length, errors[0], area, errors[1], reduced, errors[2]])
