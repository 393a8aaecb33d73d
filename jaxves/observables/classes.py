"""Classes of a vesicle in a field, from the time series of its deformation D along the field.

In a field with a period that is not averaged over, D is its mean over the last whole period before each saved time. The
mean is an integral over the steps, which does not depend on the saved times.

    P      prolate throughout              D never below -THRESHOLD
    O      becomes oblate and stays        D below -THRESHOLD at the end
    POP    prolate, oblate, prolate        D below -THRESHOLD in between, above THRESHOLD at the end
    open   none of these                   the run ended too early, or the vesicle is nearly round

    breathing                              D itself goes beyond both ± THRESHOLD within the last whole period, and
                                           returns: from its start to its end D changes by less than half of its swing

D = (√I_∥ - √I_⊥)/(√I_∥ + √I_⊥). THRESHOLD = 0.01 excludes round-off and nearly circular shapes. A vesicle that starts
oblate, becomes prolate and remains so is in class P. A run that is shorter than the period is open.

Nothing here imports JAX.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float, Int

THRESHOLD = 0.01
DEFORMATION, MEAN, LEAST, GREATEST, CHANGE = DIAGNOSTICS = (
    "deformation_along_field",
    "deformation_period_mean",
    "deformation_period_least",
    "deformation_period_greatest",
    "deformation_period_change",
)
NAMES = ("open", "P", "O", "POP", "breathing")
OPEN, P, O, POP, BREATHING = range(5)  # noqa: E741


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


def codes_of(found: Mapping[str, Any]) -> Int[Any, "*rest"]:
    """Returns indices into `NAMES` from the diagnostics of a run by name, with the saved times as the first axis.

    Only those of DIAGNOSTICS are used, as far as the run has them. The result is traced for traced arrays.
    """
    deformation = found[DEFORMATION]
    if MEAN not in found:
        return classify(deformation)
    mean = found[MEAN]
    xp = mean.__array_namespace__()
    rows = xp.arange(mean.shape[0]).reshape(-1, *[1] * (mean.ndim - 1))
    known = ~xp.isnan(mean)
    last = xp.max(xp.where(known, rows, 0), axis=0)[None]
    ends = (xp.take_along_axis(found[name], last, axis=0)[0] for name in (LEAST, GREATEST, CHANGE))
    least, greatest, change = ends
    returns = xp.abs(change) < 0.5 * (greatest - least)
    code = classify(xp.where(rows == 0, deformation, mean))
    code = xp.where((least < -THRESHOLD) & (greatest > THRESHOLD) & returns, BREATHING, code)
    return xp.where(xp.any(known, axis=0), code, OPEN)


def trend(found: Mapping[str, Any], t: Float[Any, "T"]) -> Float[Any, "*rest"]:
    """Returns by how much the D that classes follow from would change in as much time again, at its last rate.

    `found` is as in `codes_of`. There must be two saved times; the rate is that between the last two. The class at the
    end of a run is not final if this is larger than THRESHOLD.
    """
    series = found[MEAN] if MEAN in found else found[DEFORMATION]
    return (series[-1] - series[-2]) * ((t[-1] - t[0]) / (t[-1] - t[-2]))


def class_names(deformation: Float[Any, "T *rest"] | Mapping[str, Any]) -> list[str]:
    """Returns the name of the class of each vesicle; not for traced arrays.

    `deformation` is D at the saved times (first axis), or all diagnostics of a result by name. In a field with a period
    that is not averaged over, only the diagnostics have the means over periods.
    """
    if isinstance(deformation, Mapping):
        found = {name: np.asarray(deformation[name]) for name in DIAGNOSTICS if name in deformation}
        return [NAMES[code] for code in np.atleast_1d(codes_of(found)).ravel()]
    return [NAMES[code] for code in np.atleast_1d(classify(np.asarray(deformation))).ravel()]


def has_reached(found: Mapping[str, Any], name: str) -> Any:
    """Returns whether every vesicle is in class `name` now, and not every one was at the start; may be traced."""
    code = NAMES.index(name)
    now, before = codes_of(found) == code, classify(found[DEFORMATION][:1]) == code
    return now.all() & ~before.all()
