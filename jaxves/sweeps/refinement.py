"""Where a grid of classes should be looked at more closely: in the cells within which the class changes.

The finest grid is laid out from the start; first the points `stride` apart are computed. A cell whose computed points
are not all of one class is halved along the refined axes, and so on. What is asked for depends on the classes alone,
not on the order in which they became known: an interrupted refinement ends with the same cases.
"""

from itertools import product

import numpy as np
from jaxtyping import Bool, Shaped


def wanted(
    classes: Shaped[np.ndarray, "..."], known: Bool[np.ndarray, "..."], stride: tuple[int, ...]
) -> Bool[np.ndarray, "..."]:
    """The points to be computed next, as a mask of the grid; empty when the boundaries are found.

    Args:
        classes: the class at each point in a word, "" where there is none (a case that failed counts for nothing).
        known: which points have been computed.
        stride: how far apart the first points are on each axis, a power of two; 1 on an axis that is not refined.
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
