"""The error of a whole run, from a second one with ten times its tolerance.

The tolerance bounds the error of a step. What the scene makes of those errors, amplified or damped, only another run
can tell. With n steps to its m, and a method of order p, the error of the second is (n/m)^p times that of the first:
ten times, where the tolerance sets the steps. Where saved instants set them, the second run leaves some out.
"""

import math
from collections.abc import Callable

import numpy as np

from . import status
from .resolution import Resolution, Row

_LOOSER = 10.0
_BETWEEN = 4  # steps of the first run between instants at which the second stops, at least
_FEWER = 1.2  # how many times as many steps the first must have for an estimate


def estimated_error(
    resolution: Resolution,
    rows: Callable[[int], Row],
    times: np.ndarray,
    steps: int,
    progress: Callable[[float, str], None],
) -> float:
    """The largest error of any node in position (a) or potential (a E_inf), by a run that took `steps` steps.

    `rows` gives what it saved of each of its `times`, the start first. NaN when there is no telling: the second run
    breaks down, which says nothing about the first, or it needs as many steps.
    """
    looser = resolution.looser(_LOOSER)
    state, apart = looser.first.state, 0.0
    stride = math.ceil(_BETWEEN * (len(times) - 1) / max(steps, 1))
    for i in [*range(stride, len(times) - 1, stride), len(times) - 1]:
        state, other = looser.stepped(state, times[i])
        code = int(state.status)
        if not len(other["t"]) or code not in (status.RUNNING, status.STEADY):
            return np.nan
        row = rows(i)
        apart = max(apart, *(np.max(np.abs(other[name][0] - row[name])) for name in ("x", "V_m") if name in row))
        progress(float(times[-1]), f"estimating the error: t = {times[i]:.3g} with ten times the tolerance")
        if code == status.STEADY:
            steps = steps * times[i] / times[-1]
            break
    fewer = steps / int(state.steps)
    return float(apart / (fewer**looser.first.march.stepper.order - 1)) if fewer > _FEWER else np.nan
