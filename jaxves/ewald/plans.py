"""Sizes of grids and lists of the fast sums, which compiled code needs as constants.

Everything scales with the box around the nodes or with the cell: r_c is a fraction of it. Few vesicles a side need
a small grid. The capacities of the lists hold for vesicles that fill the box evenly, with room to spare. `measured`
counts them for given nodes. What does not fit is found at run time (`lists.Lists.overflow`).
"""

import math
from typing import NamedTuple

from ..base.arguments import refusal


class Accuracy(NamedTuple):
    """Error relative to the largest value, shape of the blob, width of the window in grid cells, degree of polynomials.

    The polynomials are those of the local part. The error is at most a fifth of `tolerance`.
    """

    tolerance: float
    shape: float
    width: int
    degree: int

    def for_double_layer(self) -> "Accuracy":
        """Returns the accuracy with which sums of the Stokes double layer have an error below the same `tolerance`.

        Its kernel has one derivative more than the single layer, so the end of the blob's transform matters more.
        """
        return self._replace(shape=self.shape + 3, degree=self.degree + 2)


ACCURACIES = (
    Accuracy(1e-4, 12.0, 6, 10),
    Accuracy(1e-6, 17.0, 8, 13),
    Accuracy(1e-8, 21.5, 10, 16),
    Accuracy(1e-10, 26.5, 12, 19),
    Accuracy(1e-12, 31.0, 14, 22),
)
_REACH = 0.7  # r_c over the mean distance of neighbours, at which lists and transforms take about equally long
_REACH_IN_CELL = 0.5  # the same in a cell, where nothing around it has to be transformed
_CLUSTER = 8  # consecutive nodes
CHUNK = 32  # pairs of clusters that are computed at once
_VARIATION = 16  # clusters that may have all their room used


class Plan(NamedTuple):
    """The sizes of one fast sum.

    `grid` are the grid points along both axes, `patch` those that a cluster reaches, `cluster` its nodes. A target
    vesicle has up to `vesicles` others within reach, a target cluster up to `room` other clusters, and `average` of
    them on average (None: `room`). `images` are the images of a vesicle on each side that may be within reach, in a
    periodic cell.
    """

    accuracy: Accuracy
    grid: tuple[int, int]
    patch: int
    cluster: int
    vesicles: int
    room: int
    images: int = 0
    average: int | None = None

    def pairs(self, clusters: int) -> int:
        """Returns the length of the list of all pairs of clusters, a multiple of `CHUNK`."""
        most = clusters * self.room
        if self.average is not None:  # numbers vary more if there are few
            most = min(most, clusters * self.average + _VARIATION * self.room)
        return -(-most // CHUNK) * CHUNK


def accuracy_for(tolerance: float, *, contrast: bool = False) -> Accuracy:
    """Returns the cheapest accuracy with an error below `tolerance`; raises ValueError below 1e-12.

    `contrast` includes sums of the Stokes double layer.
    """
    for known in ACCURACIES:
        if known.tolerance <= tolerance * (1 + 1e-12):
            return known.for_double_layer() if contrast else known
    raise refusal("tolerance", tolerance, "a relative error of at least 1e-12")


def plan_for(M: int, N: int, tolerance: float, *, contrast: bool = False) -> Plan:
    """Returns the plan for M vesicles of N nodes that fill a square box about evenly."""
    accuracy = accuracy_for(tolerance, contrast=contrast)
    side = math.sqrt(M)
    cells = 2 * accuracy.shape / math.pi * side / _REACH
    n = fast_size(math.ceil(cells) + accuracy.width + 3)
    cluster = math.gcd(N, _CLUSTER)
    vesicles = min(M - 1, 24)
    room = min(vesicles * N // cluster, 4 * N // cluster + 8)
    patch = patch_for(n / side, N, cluster, accuracy)
    return Plan(accuracy, (n, n), patch, cluster, vesicles, room, average=2 * N // cluster + 8)


def plan_in_cell(M: int, N: int, tolerance: float, aspect: float, *, contrast: bool = False) -> Plan:
    """Returns the plan for M vesicles of N nodes that fill a periodic cell about evenly.

    `aspect` is the length of its first vector over that of the second. The cell may be sheared by up to a half.
    """
    accuracy = accuracy_for(tolerance, contrast=contrast)
    side = math.sqrt(M)
    cells = 2 * accuracy.shape / math.pi * side / _REACH_IN_CELL
    grid = tuple(
        fast_size(math.ceil(max(cells * stretch, 2 * accuracy.width))) for stretch in (aspect**0.5, aspect**-0.5)
    )
    cluster = math.gcd(N, _CLUSTER)
    patch = patch_for(1.2 * max(grid) / side, N, cluster, accuracy)
    vesicles = min(9 * M - 1, 24)
    room = min(vesicles * N // cluster, 5 * N // cluster + 8)
    return Plan(accuracy, grid, patch, cluster, vesicles, room, 1, N // cluster + 8)


def patch_for(cells: float, N: int, cluster: int, accuracy: Accuracy) -> int:
    """Returns the size of a patch, where a vesicle has `cells` grid cells to itself along each axis."""
    return math.ceil(0.9 * cells * min(1.0, 3.5 * cluster / N)) + accuracy.width + 2


def fast_size(n: int) -> int:
    """Returns the least even size of at least n whose prime factors are 2, 3 and 5."""
    n += n % 2
    while True:
        rest = n
        for prime in (2, 3, 5):
            while rest % prime == 0:
                rest //= prime
        if rest == 1:
            return n
        n += 2
