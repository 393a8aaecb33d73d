"""Second moments of saved outlines. They choose the instants to draw, and show where an inclination angle is defined.

The nodes are equispaced in arc length, so a mean over the nodes is a mean over the outline.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ..observables.angles import jumps

_STILL = 1e-2  # a total change smaller than this, in units of a, counts as no change
_TIME = 0.25  # share of the time, beside the change of the shapes, in the distance between instants
_ROUND = 0.02  # below this anisotropy the direction of the major axis is undefined


def spreads(x: Float[np.ndarray, "T M N 2"]) -> Float[np.ndarray, "T M 2 2"]:
    """Returns the mean of (x - c)(x - c)ᵀ over each outline, where c is the mean of x."""
    apart = x - x.mean(axis=2, keepdims=True)
    return np.einsum("tmni,tmnj->tmij", apart, apart) / x.shape[2]


def _radii(x: Float[np.ndarray, "T M N 2"]) -> Float[np.ndarray, "T M 2 2"]:
    """Returns the symmetric square roots of `spreads`, which are proportional to the size of a shape."""
    found = spreads(x)
    root = np.sqrt(np.maximum(np.linalg.det(found), 0.0))[..., None, None]
    total = np.trace(found, axis1=-2, axis2=-1)[..., None, None] + 2 * root
    return (found + root * np.eye(2)) / np.sqrt(total)


def instants(t: Float[np.ndarray, "T"], x: Float[np.ndarray, "T M N 2"], count: int) -> Int[np.ndarray, "K"]:
    """Returns the rows of at most `count` saved instants: the first, the last, and others between them.

    The others are spread evenly along the change of the shapes and, to a quarter, in time, so that no two are nearly
    the same. Change is measured by the radii of gyration of the outlines, as matrices (the square roots of their second
    moments), and by their positions relative to each other. If hardly anything changes, as in steady tank-treading,
    they are spread evenly in time. Rows with NaN are left out.
    """
    rows = np.flatnonzero(np.isfinite(x).all(axis=(1, 2, 3)))
    if len(rows) == 0:
        return np.array([0])
    x = x[rows]
    centers = x.mean(axis=2)
    centers = centers - centers.mean(axis=1, keepdims=True)
    described = np.concatenate([part.reshape(len(x), -1) for part in (_radii(x), centers)], axis=1)
    path = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(described, axis=0), axis=1))])
    passed = (t[rows] - t[rows[0]]) / (t[rows[-1]] - t[rows[0]] or 1.0)
    measure = (1 - _TIME) * path / path[-1] + _TIME * passed if path[-1] > _STILL else passed
    wanted = np.linspace(measure[0], measure[-1], count)
    nearest = np.abs(measure - wanted[:, None]).argmin(axis=1)
    nearest[-1] = len(rows) - 1
    return rows[np.unique(nearest)]


def directed(x: Float[np.ndarray, "T M N 2"]) -> Bool[np.ndarray, "T M"]:
    """Returns whether each outline is longer in one direction than in the other, so that its inclination is defined."""
    least, most = np.moveaxis(np.sqrt(np.linalg.eigvalsh(np.nan_to_num(spreads(x)))), -1, 0)
    return most - least > _ROUND * (most + least)


def drawn_angle(x: Float[np.ndarray, "T M N 2"], angle: Float[np.ndarray, "T M"]) -> Float[np.ndarray, "T M"]:
    """Returns the inclination in degrees for drawing: NaN where it is undefined."""
    return np.where(directed(x), np.degrees(angle), np.nan)


def broken(t: Float[np.ndarray, "T"], degrees: Float[np.ndarray, "T"]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times and the angles of a line that is broken at the jumps, by a NaN between the points."""
    after = np.flatnonzero(jumps(degrees)) + 1
    return np.insert(t, after, np.nan), np.insert(degrees, after, np.nan)


def alone(values: Float[np.ndarray, "T"]) -> Int[np.ndarray, "K"]:
    """Returns the rows of the points that no line reaches, because the values before and after them are NaN."""
    there = np.pad(np.isfinite(values), 1)
    return np.flatnonzero(there[1:-1] & ~there[:-2] & ~there[2:])
