r"""Intervals of fitted numbers, and what the observations leave open.

Near the minimum, χ² is a paraboloid with the curvature JᵀJ, the Fisher information in the coordinates of `boxes`. Its
inverse is the covariance. A combination of coordinates with a 95 % interval of more than ± `LOOSE` is not determined: a
number by a factor of e, or the whole range of its bounds. Such a number has no interval. A number that is part of such
a combination has none either, because χ² is no paraboloid over so long a range. If a product or a ratio of two numbers
is determined although they are not, it is named.
"""

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .boxes import Box

NORMAL_95 = 1.959964
LOOSE = 1.0  # half of a 95 % interval of a coordinate beyond which it counts as not determined
_PART = 0.1  # weight in a combination from which on a number is named as a part of it
_ROUND_OFF = 1e-9
_POWERS = ((1, -1), (1, 1), (1, -2), (2, -1), (1, 2), (2, 1))  # of combinations of two numbers, the simplest first


class Judgement(NamedTuple):
    """Half-widths (P,) of 95 % intervals in the coordinates, their covariance, and what is left open, in words."""

    half_widths: Float[np.ndarray, "P"]
    undetermined: Bool[np.ndarray, "P"]  # the numbers that are not determined
    covariance: Float[np.ndarray, "P P"]
    loose: tuple[str, ...]  # combinations that are not determined
    determined: tuple[str, ...]  # combinations that are, although their numbers are not


def judged(jacobian: Float[np.ndarray, "R P"], inside: Mapping[str, Box]) -> Judgement:
    """Returns intervals and open combinations from the Jacobian of the residuals in the coordinates."""
    said = np.max(np.abs(jacobian), axis=0)
    # Columns at the level of round-off carry no information. They would contaminate combinations with the others.
    known = np.where(said < _ROUND_OFF * np.max(said), 0.0, jacobian)
    _, singular, axes = np.linalg.svd(np.vstack([known, np.zeros((known.shape[1],) * 2)]), full_matrices=False)
    singular = np.maximum(singular, 1e-100)
    covariance = (axes.T / singular**2) @ axes
    sizes = NORMAL_95 * np.sqrt(np.diag(covariance))
    open_axes = axes[NORMAL_95 / singular > LOOSE]
    loose = tuple(_in_words(axis, inside) for axis in open_axes)
    undetermined = (sizes > LOOSE) | np.any(np.abs(open_axes) > _PART, axis=0)
    open_numbers = [(i, name) for i, (name, box) in enumerate(inside.items()) if undetermined[i] and box.positive]
    determined = []
    for (i, first), (j, second) in itertools.combinations(open_numbers, 2):
        for powers in _POWERS:
            weights = np.zeros(len(inside))
            weights[[i, j]] = powers
            along = axes @ weights
            along[np.abs(along) < _ROUND_OFF] = 0.0
            size = NORMAL_95 * float(np.linalg.norm(along / singular))
            if size <= LOOSE:
                determined.append(
                    f"{_product((first, second), powers)} is determined to ±{np.expm1(size):.1%}, "
                    f"{first} and {second} alone are not"
                )
                break
    return Judgement(sizes, undetermined, covariance, loose, tuple(determined))


def _product(names: tuple[str, str], powers: tuple[int, int]) -> str:
    """Returns a b, a/b, a²/b and so on."""
    first, second = (name + ("²" if abs(power) == 2 else "") for name, power in zip(names, powers, strict=True))
    return f"{first}/{second}" if powers[1] < 0 else f"{first} {second}"


def _in_words(axis: Float[np.ndarray, "P"], inside: Mapping[str, Box]) -> str:
    """Returns a combination of numbers in words, with the largest weight positive: "+0.71 log a -0.71 log b"."""
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    parts = [
        f"{weight:+.2f} {f'log {name}' if box.positive else name}"
        for weight, (name, box) in zip(axis, inside.items(), strict=True)
        if abs(weight) > _PART
    ]
    return " ".join(parts)
