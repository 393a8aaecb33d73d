r"""The pair distribution g of centres in a periodic cell: how often a distance occurs, over the same for random places.

    g(r, θ) = (pairs of a centre and another at r, θ) / (M · M/A · area of the bin)

θ is the direction of the line of centres, from x, in [-π/2, π/2).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..base.arguments import refusal, require_count
from .pairs_in_cell import checked, heights, separations


class PairDistribution(NamedTuple):
    """g (R, S) for R distances and S directions, with the edges (R + 1,) and (S + 1,) of the bins."""

    g: Float[np.ndarray, "R S"]
    distance: Float[np.ndarray, "R1"]
    angle: Float[np.ndarray, "S1"]


def pair_distribution(centers, lattice, edges, *, sectors: int = 1) -> PairDistribution:
    """Returns the pair distribution of centres, averaged over the given times.

    Args:
        centers: centres (M, 2), or (T, M, 2) for several times, such as `result.diagnostics["center"]`.
        lattice: the vectors of the cell as rows, (2, 2), or one for each time, (T, 2, 2).
        edges: the increasing distances between which pairs are counted, (R + 1,), up to the smaller height of the cell.
        sectors: the number of directions that are told apart.

    Raises:
        ValueError: an argument does not have the right form.
    """
    x, lattices = checked(centers, lattice)
    edges = np.asarray(edges, dtype=float)
    greatest = float(np.min(heights(lattices)))
    rising = edges.ndim == 1 and len(edges) > 1 and bool(np.all(np.diff(edges) > 0))
    if not rising or edges[0] < 0 or edges[-1] > greatest * (1 + 1e-12):
        raise refusal("edges", edges, f"increasing distances from 0 up to {greatest:.6g}, the height of the cell")
    require_count("sectors", sectors)
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, sectors + 1)
    g = np.zeros((len(edges) - 1, sectors))
    for nodes, B in zip(x, lattices, strict=True):
        apart = separations(nodes, B).reshape(-1, 2)
        apart = apart[np.all(np.isfinite(apart), axis=-1)]
        distance = np.hypot(*apart.T)
        theta = np.mod(np.arctan2(apart[:, 1], apart[:, 0]) + 0.5 * np.pi, np.pi) - 0.5 * np.pi
        count, _, _ = np.histogram2d(distance, theta, (edges, angle))
        g += count * np.linalg.det(B) / len(nodes) ** 2
    areas = np.pi * np.diff(edges**2) / sectors
    return PairDistribution(g / (len(x) * areas[:, None]), edges, angle)
