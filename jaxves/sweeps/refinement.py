"""Refinement of a grid of classes: cells in which the class changes are halved.

The finest grid is defined at the start. First, every point at a distance of `stride` is computed. A cell whose computed
points are not all of one class is then halved along the refined axes, and so on. The choice depends only on the classes
and not on the order in which they were computed. An interrupted refinement therefore ends with the same cases.
"""

from itertools import product

import numpy as np
from jaxtyping import Bool, Shaped


def wanted(
    classes: Shaped[np.ndarray, "..."], known: Bool[np.ndarray, "..."], stride: tuple[int, ...]
) -> Bool[np.ndarray, "..."]:
    """Returns the points to compute next as a mask of the grid. No point is set when the refinement is complete.

    Args:
        classes: the name of the class at each point, "" if there is none. Failed cases have none and are ignored.
        known: the points that have been computed.
        stride: the distance between the first points on each axis, a power of two; 1 on an axis that is not refined.
    """
    asked = np.zeros(known.shape, bool)
    asked[tuple(slice(None, None, s) for s in stride)] = True
    refined = [s > 1 for s in stride]
    while max(stride) > 1:
        half = tuple(max(1, s // 2) for s in stride)
        starts = [range(0, n - 1, s) if r else range(n) for n, s, r in zip(known.shape, stride, refined, strict=True)]
        for corner in product(*starts):
            cell, corners, finer = (
                tuple(
                    slice(i, i + s + 1, step) if r else slice(i, i + 1)
                    for i, s, step, r in zip(corner, stride, steps, refined, strict=True)
                )
                for steps in ((1,) * len(stride), stride, half)
            )
            if known[corners].all() and len(set(classes[cell][known[cell]]) - {""}) > 1:
                asked[finer] = True
        stride = half
    return asked & ~known
