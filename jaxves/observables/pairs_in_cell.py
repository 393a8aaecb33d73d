"""Vectors between all pairs of centres in a periodic cell, in NumPy."""

import numpy as np
from jaxtyping import Float

from ..base.arguments import refusal

_STEPS = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
_NEAREST = 4  # place of the step (0, 0) in _STEPS


def checked(centers, lattice) -> tuple[Float[np.ndarray, "T M 2"], Float[np.ndarray, "T 2 2"]]:
    """Returns centres (T, M, 2) and one lattice (T, 2, 2) for each time, from one or several times.

    Raises:
        ValueError: the arrays do not have these forms, or a lattice has no positive area.
    """
    x, B = np.asarray(centers, dtype=float), np.asarray(lattice, dtype=float)
    x = x[None] if x.ndim == 2 else x
    if x.ndim != 3 or x.shape[-1] != 2 or 0 in x.shape:
        raise refusal("centers", np.shape(centers), "an array (M, 2), or (T, M, 2) for T times")
    if B.shape not in {(2, 2), (len(x), 2, 2)} or not np.all(np.linalg.det(B) > 0):
        raise refusal("lattice", np.shape(lattice), "vectors (2, 2) or (T, 2, 2), the second to the left of the first")
    return x, np.broadcast_to(B, (len(x), 2, 2))


def heights(lattice: Float[np.ndarray, "*T 2 2"]) -> Float[np.ndarray, "*T 2"]:
    """Returns the distances of opposite sides of the cell."""
    return np.abs(np.linalg.det(lattice))[..., None] / np.linalg.norm(lattice, axis=-1)[..., ::-1]


def separations(x: Float[np.ndarray, "M 2"], lattice: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "M M 9 2"]:
    """Returns the vectors from every centre to the nearest image of every other, and to the eight images around it.

    They contain all vectors that are shorter than the smaller height of the cell. That to a centre itself is infinite.
    """
    apart = x[None] - x[:, None]
    nearest = apart - np.round(apart @ np.linalg.inv(lattice)) @ lattice
    found = nearest[:, :, None] + _STEPS @ lattice
    itself = np.arange(len(x))
    found[itself, itself, _NEAREST] = np.inf
    return found
