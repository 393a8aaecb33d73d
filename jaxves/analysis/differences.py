"""Derivatives by central differences with an estimate of their own error, to check others by.

Ridders' tableau: central differences with steps h, h/2, h/4, … extrapolated after Richardson, row by row; the entry
that differs least from its neighbours is taken, and by how much it does is its error. Too large a step shows in the
one direction, round-off in the other.

C. J. F. Ridders, Accurate computation of F'(x) and F'(x) F''(x), Adv. Eng. Software 4 (1982) 75-76.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Difference(NamedTuple):
    """A derivative for every output, and the error it believes to have."""

    value: Float[np.ndarray, "Q"]
    error: Float[np.ndarray, "Q"]


def central(function: Callable[[float], Float[np.ndarray, "Q"]], x: float, step: float, *, rows: int = 4) -> Difference:
    """df/dx at x, by steps from `step` down to `step`/2^(rows-1)."""
    steps = step * 0.5 ** np.arange(rows)
    return _best([(function(x + h) - function(x - h)) / (2 * h) for h in steps], order=2, every=2)


def one_sided(
    function: Callable[[float], Float[np.ndarray, "Q"]], x: float, step: float, *, rows: int = 5
) -> Difference:
    """df/dx at x from the side of `step`, which may be negative: for an x at the end of its range."""
    steps = step * 0.5 ** np.arange(rows)
    at = function(x)
    return _best([(function(x + h) - at) / h for h in steps], order=1, every=1)


def _best(column: list[Float[np.ndarray, "Q"]], order: int, every: int) -> Difference:
    """Extrapolates a column of values for halved steps h, whose errors are h^order, and so on in `every`."""
    column = np.array(column)
    best, error = column[-1].copy(), np.full(column.shape[1:], np.inf)
    while len(column) > 1:
        factor = 2.0**order
        higher = (factor * column[1:] - column[:-1]) / (factor - 1)
        change = np.maximum(np.abs(higher - column[1:]), np.abs(higher - column[:-1]))
        for value, doubt in zip(higher, change, strict=True):
            better = doubt < error
            best, error = np.where(better, value, best), np.where(better, doubt, error)
        column, order = higher, order + every
    return Difference(best, error)
