"""The error of a whole run, from a second one with ten times its tolerance.

The tolerance bounds the error of a step. What the scene makes of those errors, amplified or damped, only another run
can tell: errors go in proportion to the tolerance (`experiments/convergence.py`), so that the looser run ends up ten
times as far from the solution, and nine errors of the first run away from it.
"""

from collections.abc import Callable

import numpy as np

from . import status
from .resolution import Resolution, Row

_LOOSER = 10.0


def estimated_error(
    resolution: Resolution, rows: Callable[[int], Row], times: np.ndarray, progress: Callable[[float, str], None]
) -> float:
    """The largest error of any node in position (a) or potential (a E_inf) at the saved `times`, the start first.

    `rows` gives what the run saved of each. NaN when the looser run breaks down, which says nothing about the first.
    """
    looser = resolution.looser(_LOOSER)
    state, apart = looser.first.state, 0.0
    for i, t in enumerate(times[1:], 1):
        state, other = looser.stepped(state, t)
        code = int(state.status)
        if not len(other["t"]) or code not in (status.RUNNING, status.STEADY):
            return np.nan
        row = rows(i)
        apart = max(apart, *(np.max(np.abs(other[name][0] - row[name])) for name in ("x", "V_m") if name in row))
        progress(float(times[-1]), f"estimating the error: t = {t:.3g} with ten times the tolerance")
        if code == status.STEADY:
            break
    return float(apart / (_LOOSER - 1))
