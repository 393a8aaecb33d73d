"""The cells of a grid of cases in a figure: their edges, the borders between classes, and cells without a result."""

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch
from scipy.ndimage import distance_transform_edt

_HATCHED = {"hatch": "//////", "facecolor": "white", "edgecolor": "0.65", "linewidth": 0.0}


def is_geometric(values: Float[np.ndarray, "n"]) -> bool:
    """Returns whether the values have equal ratios rather than equal differences, so that their axis is logarithmic."""
    if len(values) < 3 or not np.all(values > 0):
        return False
    ratios, steps = np.diff(np.log(values)), np.diff(values)
    return bool(np.ptp(ratios) < 1e-6 * abs(ratios).max() < np.ptp(steps))


def edges(centers: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n+1"]:
    """Returns the edges of the cells around these values: half-way between them, on a logarithmic axis in its sense.

    The cells of values that are not negative end at 0.
    """
    if is_geometric(centers):
        return np.exp(_halfway(np.log(centers)))
    found = _halfway(np.asarray(centers, dtype=float))
    return np.maximum(found, 0.0) if np.all(centers >= 0) else found


def _halfway(centers: np.ndarray) -> np.ndarray:
    if len(centers) == 1:
        return centers[0] + np.array([-0.5, 0.5])
    middle = 0.5 * (centers[1:] + centers[:-1])
    return np.concatenate([[2 * centers[0] - middle[0]], middle, [2 * centers[-1] - middle[-1]]])


def filled(values: Float[np.ndarray, "nx ny"], skipped: Bool[np.ndarray, "nx ny"]) -> Float[np.ndarray, "nx ny"]:
    """Returns the grid in which cases that refinement skipped have the value of the nearest other case."""
    if not skipped.any() or skipped.all():
        return values
    nearest = distance_transform_edt(skipped, return_distances=False, return_indices=True)
    return values[tuple(nearest)]


def borders(
    across: Float[np.ndarray, "_"], upward: Float[np.ndarray, "_"], cells: Float[np.ndarray, "nx ny"]
) -> Float[np.ndarray, "K 2 2"]:
    """Returns the edges (`edges`) between neighbouring cells with different values, of which none is NaN."""
    i, j = np.nonzero(np.abs(np.diff(cells, axis=0)) > 0)
    vertical = np.stack([np.stack([across[i + 1], upward[j + k]], axis=-1) for k in (0, 1)], axis=1)
    i, j = np.nonzero(np.abs(np.diff(cells, axis=1)) > 0)
    level = np.stack([np.stack([across[i + k], upward[j + 1]], axis=-1) for k in (0, 1)], axis=1)
    return np.concatenate([vertical, level])


def hatch(ax: Axes, across: np.ndarray, upward: np.ndarray, missing: Bool[np.ndarray, "nx ny"]) -> None:
    """Hatches the cells without a result."""
    corners = [
        [(across[i + a], upward[j + b]) for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))] for i, j in np.argwhere(missing)
    ]
    if corners:
        ax.add_collection(PolyCollection(corners, zorder=1.5, **_HATCHED))


def hatched_patch(label: str) -> Patch:
    """Returns what the legend shows for cells without a result."""
    return Patch(label=label, **_HATCHED)
