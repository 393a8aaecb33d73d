"""Derivatives by finite differences with an error estimate. They are used to check other derivatives.

The method is Ridders' tableau. Central differences with steps h, h/2, h/4, … are extrapolated by Richardson's rule, row
by row. The result is the entry that differs least from its neighbours, and this difference is its error estimate. It
includes the error of too large steps as well as round-off.

C. J. F. Ridders, Accurate computation of F'(x) and F'(x) F''(x), Adv. Eng. Software 4 (1982) 75-76.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Difference(NamedTuple):
    """A derivative of every output, and its estimated error."""

    value: Float[np.ndarray, "Q"]
    error: Float[np.ndarray, "Q"]


def central(function: Callable[[float], Float[np.ndarray, "Q"]], x: float, step: float, *, rows: int = 4) -> Difference:
    """Returns df/dx at x by central differences, with steps from `step` down to `step`/2^(rows-1)."""
    steps = step * 0.5 ** np.arange(rows)
    return _best([(function(x + h) - function(x - h)) / (2 * h) for h in steps], order=2, every=2)


def one_sided(
    function: Callable[[float], Float[np.ndarray, "Q"]], x: float, step: float, *, rows: int = 5
) -> Difference:
    """Returns df/dx at x by one-sided differences, for an x at the end of its range. `step` may be negative."""
    steps = step * 0.5 ** np.arange(rows)
    at = function(x)
    return _best([(function(x + h) - at) / h for h in steps], order=1, every=1)


def _best(column: list[Float[np.ndarray, "Q"]], order: int, every: int) -> Difference:
    """Extrapolates values for steps that are halved. Their error has the powers order, order + every, … of the step."""
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
