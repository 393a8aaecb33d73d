r"""Numbers in a box as unbounded unknowns, for least squares.

    u = lower + (upper - lower) / (1 + e^{-z}),     value = e^u where the box is positive, else u

A positive box is searched in its logarithm: factors count there, not differences. `coordinate` is what uncertainties
are judged in: the logarithm, or else the fraction of the box.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Box(NamedTuple):
    """Bounds of one number."""

    lower: float
    upper: float

    @property
    def positive(self) -> bool:
        """Whether it is searched in its logarithm."""
        return self.lower > 0

    def ends(self) -> tuple[float, float]:
        """Bounds of u."""
        return (math.log(self.lower), math.log(self.upper)) if self.positive else (self.lower, self.upper)


def boxes(bounds: Mapping[str, tuple[float, float]]) -> dict[str, Box]:
    """Boxes of these bounds. Raises ValueError unless they are finite and lower < upper."""
    for name, (lower, upper) in bounds.items():
        if not (math.isfinite(lower) and math.isfinite(upper) and lower < upper):
            raise ValueError(f"{name} in ({lower}, {upper}), expected finite bounds, the lower one first.")
    return {name: Box(float(lower), float(upper)) for name, (lower, upper) in bounds.items()}


def to_values(z: Float[Array, "P"], inside: Mapping[str, Box]) -> dict[str, Array]:
    """The numbers that z stands for, in the order of `inside`."""
    out = {}
    for i, (name, box) in enumerate(inside.items()):
        lower, upper = box.ends()
        u = lower + (upper - lower) * jax.nn.sigmoid(z[i])
        out[name] = jnp.exp(u) if box.positive else u
    return out


def to_z(values: Mapping[str, float], inside: Mapping[str, Box]) -> Float[np.ndarray, "P"]:
    """Back. Raises ValueError for a value that is not inside its box."""
    out = []
    for name, box in inside.items():
        lower, upper = box.ends()
        if not box.lower < values[name] < box.upper:
            raise ValueError(f"{name} = {values[name]}, expected a number inside ({box.lower}, {box.upper}).")
        u = math.log(values[name]) if box.positive else values[name]
        fraction = (u - lower) / (upper - lower)
        out.append(math.log(fraction / (1 - fraction)))
    return np.array(out)


def slopes(values: Mapping[str, float], inside: Mapping[str, Box]) -> tuple[np.ndarray, np.ndarray]:
    """(d coordinate/dz, d value/d coordinate) of every number."""
    to_coordinate, to_value = [], []
    for name, box in inside.items():
        lower, upper = box.ends()
        u = math.log(values[name]) if box.positive else values[name]
        width = upper - lower
        du_dz = (u - lower) * (upper - u) / width
        to_coordinate.append(du_dz if box.positive else du_dz / width)
        to_value.append(values[name] if box.positive else width)
    return np.array(to_coordinate), np.array(to_value)
