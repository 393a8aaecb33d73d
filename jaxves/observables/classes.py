"""Classes of a vesicle in a field, from the time series of its deformation D along the field.

    P      prolate throughout              D never below -THRESHOLD
    O      becomes oblate and stays        D below -THRESHOLD at the end
    POP    prolate, oblate, prolate        D below -THRESHOLD in between, above THRESHOLD at the end
    open   none of these                   the run ended too early, or the vesicle is nearly round

D = (√I_∥ - √I_⊥)/(√I_∥ + √I_⊥). THRESHOLD = 0.01 excludes round-off and nearly circular shapes. A vesicle that starts
oblate, becomes prolate and remains so is in class P. Nothing here imports JAX.
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

THRESHOLD = 0.01
NAMES = ("open", "P", "O", "POP")
OPEN, P, O, POP = range(4)  # noqa: E741


def classify(deformation: Float[Any, "T *rest"]) -> Int[Any, "*rest"]:
    """Returns indices into `NAMES` from D at the saved times (first axis); rows that are NaN are ignored.

    The result is traced for traced arrays, and a NumPy array for NumPy arrays.
    """
    xp = deformation.__array_namespace__()
    known = ~xp.isnan(deformation)
    rows = xp.arange(deformation.shape[0]).reshape(-1, *[1] * (deformation.ndim - 1))
    last = xp.max(xp.where(known, rows, 0), axis=0)
    end = xp.take_along_axis(deformation, last[None], axis=0)[0]
    start_prolate = deformation[0] > -THRESHOLD
    dipped = xp.any(xp.where(known, deformation, 0.0) < -THRESHOLD, axis=0) & start_prolate
    ends_prolate, ends_oblate = end > THRESHOLD, end < -THRESHOLD
    return xp.where(ends_oblate, O, xp.where(ends_prolate, xp.where(dipped, POP, P), OPEN))


def class_names(deformation: Float[Any, "T *rest"]) -> list[str]:
    """Returns the name of the class of each vesicle, from D at the saved times (first axis); not for traced arrays."""
    return [NAMES[code] for code in np.atleast_1d(classify(np.asarray(deformation))).ravel()]


def reached(deformation: Float[np.ndarray, "T M"], name: str) -> bool:
    """Returns whether every vesicle is in class `name` now, and not every one was at the start."""
    code = NAMES.index(name)
    return bool(np.all(classify(deformation) == code) and not np.all(classify(deformation[:1]) == code))
