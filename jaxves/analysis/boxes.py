r"""Coordinates for numbers with bounds, in which a search moves and uncertainties are expressed.

c = log value if both bounds are positive, otherwise c = (value - lower)/(upper - lower)
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Box(NamedTuple):
    """The bounds of one number."""

    lower: float
    upper: float

    @property
    def positive(self) -> bool:
        """Whether the coordinate is the logarithm of the number."""
        return self.lower > 0

    def ends(self) -> tuple[float, float]:
        """Returns the bounds of the coordinate."""
        return (math.log(self.lower), math.log(self.upper)) if self.positive else (0.0, 1.0)


def boxes(bounds: Mapping[str, tuple[float, float]]) -> dict[str, Box]:
    """Returns the boxes for these bounds, by name.

    Raises:
        ValueError: there are no bounds, or some are not two finite numbers with the lower one first.
    """
    if not bounds:
        raise ValueError("bounds are empty, expected one or more numbers of the scene, each with (lower, upper).")
    for name, ends in bounds.items():
        if np.shape(ends) != (2,) or not (np.all(np.isfinite(ends)) and ends[0] < ends[1]):
            raise ValueError(f"bounds of {name} = {ends}, expected two finite numbers (lower, upper), lower first.")
    return {name: Box(float(lower), float(upper)) for name, (lower, upper) in bounds.items()}


def to_values(c: Float[Array, "P"], inside: Mapping[str, Box]) -> dict[str, Array]:
    """Returns the numbers that have these coordinates, in the order of `inside`."""
    parts = zip(c, inside.items(), strict=True)
    return {n: jnp.exp(c) if box.positive else box.lower + (box.upper - box.lower) * c for c, (n, box) in parts}


def to_coordinates(values: Mapping[str, float], inside: Mapping[str, Box]) -> Float[np.ndarray, "P"]:
    """Returns the coordinates of these numbers; the inverse of `to_values`.

    Raises:
        ValueError: a number is not inside its box.
    """
    out = []
    for name, box in inside.items():
        value = values[name]
        if not box.lower < value < box.upper:
            raise ValueError(f"{name} = {value}, expected a number inside ({box.lower}, {box.upper}).")
        out.append(math.log(value) if box.positive else (value - box.lower) / (box.upper - box.lower))
    return np.array(out)


def slopes(values: Mapping[str, float], inside: Mapping[str, Box]) -> Float[np.ndarray, "P"]:
    """Returns d value/d coordinate for every number."""
    return np.array([values[name] if box.positive else box.upper - box.lower for name, box in inside.items()])
