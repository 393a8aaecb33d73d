"""The error of a whole run, from a second one with another tolerance.

The tolerance bounds the error of a step. What the scene makes of those errors, amplified or damped, only another run
can tell. With n steps to its m, and a method of order p, the error of the second is (n/m)^p times that of the first.
Ten times the tolerance is the cheaper choice, and tells where the tolerance sets the steps; where saved instants set
them, the second run leaves some out. Where stability sets them, it makes as many, or breaks down, and is given up half
way: a thirtieth of the tolerance tells then.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from . import status
from .resolution import Resolution, Row

_BETWEEN = 4  # steps of the first run between instants at which the second stops, at least


class _Second(NamedTuple):
    """A second run: `factor` times the tolerance, worth an estimate where step numbers differ at least `enough` times.

    Errors of a loose tolerance hardly go in proportion yet, and need more distance.
    """

    factor: float
    enough: float

    def tells(self, ratio: float) -> bool:
        """Whether one run makes enough more steps than the other."""
        return max(ratio, 1 / ratio) >= self.enough


_SECOND = (_Second(10.0, 1.4), _Second(1 / 30, 1.2))


def estimated_error(
    resolution: Resolution, rows: Callable[[int], Row], times: np.ndarray, progress: Callable[[float, str], None]
) -> float:
    """The largest error of any node in position (a) or potential (a E_inf) of a run.

    `rows` gives what it saved of each of its `times`, the start first. NaN when there is no telling: no other run
    arrives with another number of steps.
    """
    for second in _SECOND:
        compared = _compared(resolution, second, rows, times, progress)
        if compared is not None:
            apart, ratio = compared
            return apart / abs(ratio**resolution.first.march.stepper.order - 1)
    return np.nan


def _compared(
    resolution: Resolution,
    second: _Second,
    rows: Callable[[int], Row],
    times: np.ndarray,
    progress: Callable[[float, str], None],
) -> tuple[float, float] | None:
    """How far the second run is from the first at most, and how many times as many steps the first made.

    None where the second breaks down, which says nothing about the first, or makes as many steps.
    """
    other = resolution.with_tolerance(second.factor)
    state, apart, ratio = other.first.state, 0.0, 1.0
    last = len(times) - 1
    stride = math.ceil(_BETWEEN * last / max(int(rows(last)["steps"]), 1))
    for i in [*range(stride, last, stride), last]:
        state, found = other.stepped(state, times[i])
        code = int(state.status)
        if not len(found["t"]) or code not in (status.RUNNING, status.STEADY):
            return None
        row = rows(i)
        apart = max(apart, *(float(np.max(np.abs(found[k][0] - row[k]))) for k in ("x", "V_m") if k in row))
        ratio = float(row["steps"] / int(state.steps))
        progress(times[-1], f"estimating the error: t = {times[i]:.3g} with {second.factor:.2g} times the tolerance")
        if code == status.STEADY or (2 * i > last and not second.tells(ratio)):
            break
    return (apart, ratio) if second.tells(ratio) else None
