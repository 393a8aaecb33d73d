r"""The structure factor S of centres in a periodic cell, in NumPy.

    S(k) = |Σ e^{-ik·x}|²/M,      k = 2π B⁻¹ m

B is the lattice with its vectors as rows, and m are two whole numbers.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..base.arguments import require_count
from .pairs_in_cell import checked


class StructureFactor(NamedTuple):
    """S (T, K) at the wave vectors k (T, K, 2) of each time. k = 0 is left out."""

    k: Float[np.ndarray, "T K 2"]
    S: Float[np.ndarray, "T K"]

    def radial(self, edges) -> Float[np.ndarray, "R"]:
        """Returns the mean of S over all k with |k| between two of the edges (R + 1,); NaN where there are none."""
        size = np.linalg.norm(self.k, axis=-1)
        count, _ = np.histogram(size, edges)
        total, _ = np.histogram(size, edges, weights=self.S)
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def structure_factor(centers, lattice, modes: int) -> StructureFactor:
    """Returns the structure factor at all wave vectors with |m₁|, |m₂| <= `modes`, one of k and -k.

    Args:
        centers: centres (M, 2), or (T, M, 2) for several times.
        lattice: the vectors of the cell as rows, (2, 2), or one for each time, (T, 2, 2).
        modes: the largest whole number of waves across the cell.

    Raises:
        ValueError: an argument does not have the right form.
    """
    x, lattices = checked(centers, lattice)
    require_count("modes", modes)
    m1, m2 = np.meshgrid(np.arange(modes + 1), np.arange(-modes, modes + 1), indexing="ij")
    m = np.stack([m1, m2], axis=-1).reshape(-1, 2)
    m = m[(m[:, 0] > 0) | (m[:, 1] > 0)]
    k = 2 * np.pi * np.einsum("tij,kj->tki", np.linalg.inv(lattices), m)
    phase = np.exp(-1j * np.einsum("tki,tmi->tkm", k, x))
    return StructureFactor(k, np.abs(np.sum(phase, axis=-1)) ** 2 / x.shape[1])
