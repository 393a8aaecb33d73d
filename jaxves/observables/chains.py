"""Chains of vesicles in a periodic cell: their lengths and directions, in NumPy.

Two vesicles are bound if their centres are close, and, with a `direction`, if the line of centres is within an angle of
it. Vesicles that bonds connect are one chain.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..base.arguments import refusal
from .pairs_in_cell import checked, heights, separations


class Chains(NamedTuple):
    """The chains of one instant.

    `label` (M,) is the chain of each vesicle, `size` (C,) the number of its vesicles, and `angle` (C,) the direction of
    its longest extent from x, in (-π/2, π/2]; NaN for single vesicles. `spans` (C,) says that a chain is bound to an
    image of itself and has no end.
    """

    label: Int[np.ndarray, "M"]
    size: Int[np.ndarray, "C"]
    angle: Float[np.ndarray, "C"]
    spans: Bool[np.ndarray, "C"]

    def mean_length(self) -> float:
        """Returns the mean size of the chain that a vesicle is in."""
        return float(np.sum(self.size**2) / np.sum(self.size))

    def order(self, angle: float) -> float:
        """Returns the mean of cos 2(θ - `angle`) over chains of two or more, weighted by size; NaN without any."""
        long = self.size > 1
        if not np.any(long):
            return float("nan")
        return float(np.average(np.cos(2 * (self.angle[long] - angle)), weights=self.size[long]))


def chains(centers, lattice, reach: float, *, direction=None, within: float = np.pi / 4) -> Chains:
    """Returns the chains of centres (M, 2) at one instant.

    Args:
        centers: centres (M, 2).
        lattice: the vectors of the cell as rows, (2, 2).
        reach: the largest distance of two bound centres, at most the smaller height of the cell.
        direction: a vector along which vesicles are bound, such as the field; by default in all directions.
        within: the largest angle between a bond and `direction`, in radians.

    Raises:
        ValueError: an argument does not have the right form.
    """
    x, lattices = checked(centers, lattice)
    if len(x) != 1:
        raise refusal("centers", np.shape(centers), "the centres (M, 2) of one instant")
    x, lattice = x[0], lattices[0]
    greatest = float(np.min(heights(lattice)))
    if not 0 < reach <= greatest:
        raise refusal("reach", reach, f"a number > 0 and <= {greatest:.6g}, the height of the cell")
    apart = separations(x, lattice)
    distance = np.hypot(apart[..., 0], apart[..., 1])
    bound = distance <= reach
    if direction is not None:
        unit = np.asarray(direction, dtype=float)
        if unit.shape != (2,) or not np.any(unit):
            raise refusal("direction", direction, "two numbers, not both zero")
        finite = np.where(np.isfinite(apart), apart, 0.0)
        bound &= np.abs(finite @ (unit / np.hypot(*unit))) >= np.cos(within) * np.where(bound, distance, 0.0)
    return _connected(bound, apart)


def _connected(bound: Bool[np.ndarray, "M M 9"], apart: Float[np.ndarray, "M M 9 2"]) -> Chains:
    """Follows the bonds from one vesicle after the other, with places that are continuous along each chain."""
    M = len(bound)
    label, place = np.full(M, -1), np.zeros((M, 2))
    angles, spans = [], []
    for first in range(M):
        if label[first] >= 0:
            continue
        chain, spanning = len(angles), False
        label[first] = chain
        waiting, members = [first], [first]
        while waiting:
            i = waiting.pop()
            for j, image in zip(*np.nonzero(bound[i]), strict=True):
                there = place[i] + apart[i, j, image]
                if label[j] < 0:
                    label[j], place[j] = chain, there
                    waiting.append(j)
                    members.append(j)
                elif not np.allclose(place[j], there, rtol=0, atol=1e-9 * (1 + np.abs(there).max())):
                    spanning = True
        angles.append(_direction(place[members]))
        spans.append(spanning)
    return Chains(label, np.bincount(label), np.array(angles), np.array(spans))


def _direction(places: Float[np.ndarray, "n 2"]) -> float:
    """Returns the angle of the longest extent of some places."""
    if len(places) < 2:
        return float("nan")
    (xx, xy), (_, yy) = np.cov(places.T)
    angle = 0.5 * np.arctan2(2 * xy, xx - yy)
    return float(angle)
