"""Which of the paper's phases a vesicle went through, from the history of its deformation along the field.

    P      prolate throughout              D never below -THRESHOLD
    O      becomes oblate and stays        D below -THRESHOLD at the end
    POP    prolate, oblate, prolate        D below -THRESHOLD on the way, above THRESHOLD at the end
    open   none of these yet               the run ended on the way, or the vesicle is nearly round

D = (√I_∥ - √I_⊥)/(√I_∥ + √I_⊥); THRESHOLD = 0.01 keeps round-off and near-circles out. A start that is
already oblate counts from where it is: becoming and staying prolate is then "P". Nothing here imports JAX.
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

THRESHOLD = 0.01
NAMES = ("open", "P", "O", "POP")
OPEN, P, O, POP = range(4)  # noqa: E741


def classify(deformation: Float[Any, "T *rest"]) -> Int[Any, "*rest"]:
    """Index into `NAMES`, from D at the saved times (first axis); rows that are NaN are ignored.

    Traced arrays give traced codes, NumPy arrays NumPy codes.
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
    """The class of every vesicle in words, from D at the saved times (first axis); not for traced arrays."""
    return [NAMES[code] for code in np.atleast_1d(classify(np.asarray(deformation))).ravel()]


def reached(deformation: Float[np.ndarray, "T M"], name: str) -> bool:
    """Whether the history up to now gives every vesicle the class `name`, and the start alone did not."""
    code = NAMES.index(name)
    return bool(np.all(classify(deformation) == code) and not np.all(classify(deformation[:1]) == code))
