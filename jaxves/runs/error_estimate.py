"""The error of a whole run, of nodes and time steps together, from a second run with other nodes and other steps.

The tolerance bounds the error of a step, and spectral tails bound what one instant misses. How the flow amplifies both
is measured with a second run. The first choice is a coarser one, with three quarters of the nodes and ten times the
tolerance, which costs about a third of the run. It is off by more than the run itself:

- with n steps to its m and a method of order p, its error in time is (n/m)^p times that of the run;
- its error in space is larger by the ratio of the spectral tails, of x and V_m or of the tension, or more.

The distance of the two runs is therefore multiplied by the larger of 1/((n/m)^p - 1) and that ratio of tails, at most
by one. Where stability and not the tolerance sets the steps, both runs make as many, and a thirtieth of the tolerance
is taken instead. Where the coarser run breaks down, or tells of an error above `_POOR`, a finer one with one and a half
times the nodes and a thirtieth of the tolerance replaces it: the distance from that is the error.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..base import status
from .adapt_nodes import Resolution, Row, finer_rows

_BETWEEN = 4  # steps of the first run between instants at which the second stops, at least
_TAILS = ("diagnostics/spectral_tail", "diagnostics/tension_tail")
_POOR = 1e-2  # an estimate above this is worth a finer run


class _Second(NamedTuple):
    """A second run: its nodes and tolerance in units of those of the run.

    `enough`: the two are compared where step numbers differ at least so many times. Errors of a loose tolerance hardly
    go in proportion yet, and need more distance.
    """

    nodes: float
    tolerance: float
    enough: float

    def tells(self, ratio: float) -> bool:
        """Whether one run makes enough more steps than the other."""
        return max(ratio, 1 / ratio) >= self.enough

    def in_words(self) -> str:
        """For the progress."""
        return f"{self.nodes:.3g} times the nodes and {self.tolerance:.2g} times the tolerance"


_COARSER = (_Second(0.75, 10.0, 1.4), _Second(0.75, 1 / 30, 1.2))
_FINER = _Second(1.5, 1 / 30, 1.0)


class _Compared(NamedTuple):
    """How far the second run is from the first at most, and how their steps and their spectral tails compare.

    `steps` is n/m, `tails` the tails of the first run over those of the second, at worst of the two kinds.
    """

    apart: float
    steps: float
    tails: float


def estimated_error(
    resolution: Resolution, rows: Callable[[int], Row], times: np.ndarray, progress: Callable[[float, str], None]
) -> float:
    """The largest error of any node in position (a) or potential (a E_inf) of a run.

    `rows` gives what it saved of each of its `times`, the start first. Infinite where every second run breaks down, so
    that nothing is known.
    """
    estimate = math.inf
    order = resolution.first.march.stepper.order
    for second in _COARSER:
        found = _compared(resolution, second, rows, times, progress)
        if found is not None and second.tells(found.steps):
            estimate = found.apart * min(max(1 / abs(found.steps**order - 1), found.tails), 1.0)
            break
    if estimate > _POOR:
        found = _compared(resolution, _FINER, rows, times, progress)
        estimate = estimate if found is None else found.apart
    return estimate


def _compared(
    resolution: Resolution,
    second: _Second,
    rows: Callable[[int], Row],
    times: np.ndarray,
    progress: Callable[[float, str], None],
) -> _Compared | None:
    """The second run beside the first; None where it breaks down."""
    progress(times[-1], f"estimating the error: compiling a run with {second.in_words()}")
    other, state = resolution.other(second.nodes, second.tolerance)
    apart, ratio, tails = 0.0, 1.0, np.zeros((2, len(_TAILS)))
    last = len(times) - 1
    stride = math.ceil(_BETWEEN * last / max(int(rows(last)["steps"]), 1))
    for i in [0, *range(stride, last, stride), last]:
        state, found = other.stepped(state, times[i])
        code = int(state.status)
        if not len(found["t"]) or code not in (status.RUNNING, status.STEADY):
            return None
        row = rows(i)
        tails = np.maximum(tails, [[np.max(r[name]) for name in _TAILS] for r in (row, found)])
        apart = max(apart, *_distances(row, found))
        ratio = float(row["steps"] / max(int(state.steps), 1))
        progress(times[-1], f"estimating the error: t = {times[i]:.3g} with {second.in_words()}")
        if code == status.STEADY or (2 * i > last and not second.tells(ratio)):
            break
    return _Compared(apart, ratio, float(np.max(tails[0] / np.maximum(tails[1], np.finfo(float).tiny))))


def _distances(row: Row, found: Row) -> list[float]:
    """How far x and V_m of the row of one run are from those of another, each on the finer nodes of the two."""
    out = []
    for name in ("x", "V_m"):
        if name in row:
            K = max(row[name].shape[1], found[name].shape[2])
            first, second = finer_rows(row[name][None], K), finer_rows(found[name], K)
            out.append(float(np.max(np.abs(first - second))))
    return out
