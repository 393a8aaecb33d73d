"""Second moments of saved outlines: which saved instants show how a shape changed, and where an angle is defined.

The nodes are equispaced in arc length, so means over nodes are means over the outline.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

_STILL = 1e-2  # a path shorter than this, in a, is no motion to be shown
_ROUND = 0.02  # an anisotropy below this leaves the direction of the major axis undefined


def spreads(x: Float[np.ndarray, "T M N 2"]) -> Float[np.ndarray, "T M 2 2"]:
    """Mean of (x - c)(x - c)ᵀ over each outline, c its mean."""
    apart = x - x.mean(axis=2, keepdims=True)
    return np.einsum("tmni,tmnj->tmij", apart, apart) / x.shape[2]


def instants(t: Float[np.ndarray, "T"], x: Float[np.ndarray, "T M N 2"], count: int) -> Int[np.ndarray, "K"]:
    """Rows of at most `count` saved instants: the first, the last, and others spread evenly along the change.

    Change is measured by the second moments of the outlines and by their places relative to each other. Where
    hardly anything changes, as in steady treading, the instants are spread evenly in time. Rows with NaN are left out.
    """
    rows = np.flatnonzero(np.isfinite(x).all(axis=(1, 2, 3)))
    if len(rows) == 0:
        return np.array([0])
    x = x[rows]
    centers = x.mean(axis=2)
    centers = centers - centers.mean(axis=1, keepdims=True)
    described = np.concatenate([part.reshape(len(x), -1) for part in (spreads(x), centers)], axis=1)
    path = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(described, axis=0), axis=1))])
    measure = path if path[-1] > _STILL else t[rows]
    wanted = np.linspace(measure[0], measure[-1], count)
    nearest = np.abs(measure - wanted[:, None]).argmin(axis=1)
    nearest[-1] = len(rows) - 1
    return rows[np.unique(nearest)]


def directed(x: Float[np.ndarray, "T M N 2"]) -> Bool[np.ndarray, "T M"]:
    """Whether each outline is longer one way than the other, so that its inclination is defined."""
    least, most = np.moveaxis(np.sqrt(np.linalg.eigvalsh(np.nan_to_num(spreads(x)))), -1, 0)
    return most - least > _ROUND * (most + least)


def drawn_angle(x: Float[np.ndarray, "T M N 2"], angle: Float[np.ndarray, "T M"]) -> Float[np.ndarray, "T M"]:
    """The inclination in degrees for a curve in time: NaN where it is undefined, and where it jumps in between.

    The direction of the major axis jumps by a right angle when a shape passes through a square or a circle.
    """
    degrees = np.where(directed(x), np.degrees(angle), np.nan)
    jumps = np.abs(np.diff(degrees, axis=0)) > 45
    degrees[1:][jumps] = np.nan
    return degrees


def turns(degrees: Float[np.ndarray, "T M"]) -> bool:
    """Whether an angle moves by more than a degree in all, other than by the jumps that `drawn_angle` cut out."""
    steps = np.abs(np.diff(degrees, axis=0))
    return bool(np.any(np.nansum(steps, axis=0) > 1))
