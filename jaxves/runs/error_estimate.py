"""Estimates the error of a whole run, from nodes and time steps together, with a second run.

The tolerance bounds the error of one step. Spectral tails show the error in space at one instant. The second run, with
other nodes and other steps, measures how the flow amplifies both. The first choice is a coarser run with three quarters
of the nodes and ten times the tolerance, which costs about a third of the run. Its error is larger than that of the
run:

- if the run makes n steps, the coarser one m, and the scheme has order p, its error in time is (n/m)^p times larger;
- its error in space is larger at least by the ratio of the spectral tails, of x and V_m or of the tension.

The difference between the two runs at each compared time is therefore multiplied by the larger of 1/((n/m)^p - 1), with
the steps up to that time, and the ratio of the tails of the run to those of the coarser one, and at most by one. At the
start there is no error in time. If stability and not the tolerance limits the steps, both runs make equally many. In
this case a run with a thirtieth of the tolerance is used instead. If the coarser run breaks down, or the estimate is
larger than `_POOR`, a finer run is made with one and a half times the nodes and a thirtieth of the tolerance. The
difference from this run is then the estimate.
"""

import math
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from ..base import status
from ..base.progress import Told
from ..observables.rows import Row
from .adapt_nodes import Resolution, finer_rows

_BETWEEN = 4  # least number of steps of the first run between the times at which the second stops
_TAILS = ("spectral_tail", "tension_tail")
_POOR = 1e-2  # above this estimate a finer run is made


class _Second(NamedTuple):
    """A second run: its nodes and tolerance relative to those of the first run.

    The two runs are compared if the ratio of their numbers of steps is at least `enough`. With a larger tolerance the
    error is not yet proportional to a power of the step, so a larger ratio is needed.
    """

    nodes: float
    tolerance: float
    enough: float

    def tells(self, ratio: float) -> bool:
        """Returns whether the numbers of steps of the two runs differ enough."""
        return max(ratio, 1 / ratio) >= self.enough

    def in_words(self) -> str:
        """Returns a description for the progress bar."""
        return f"{self.nodes:.3g} times the nodes and {self.tolerance:.2g} times the tolerance"


_COARSER = (_Second(0.75, 10.0, 1.4), _Second(0.75, 1 / 30, 1.2))
_FINER = _Second(1.5, 1 / 30, 1.0)


class _Compared(NamedTuple):
    """A comparison of two runs.

    `apart` is the largest difference of any node in position or potential, and `steps` is n/m, at each compared time.
    `tails` are the spectral tails of the first run divided by those of the second, the larger one of x and V_m and of
    the tension.
    """

    apart: np.ndarray
    steps: np.ndarray
    tails: float

    def estimate(self, order: int) -> float:
        """Returns the estimated error of the first run, if the second is coarser, for a scheme of this order."""
        gained = np.abs(self.steps**order - 1)
        share = np.maximum(1 / np.maximum(gained, np.finfo(float).tiny), self.tails)
        return float(np.max(self.apart * np.minimum(share, 1.0)))


def estimated_error(resolution: Resolution, rows: Callable[[int], Row], times: np.ndarray, progress: Told) -> float:
    """Returns the estimated largest error of any node in position (in a) or potential (in a E_inf) of a run.

    `rows(i)` returns the row of saved time i of `times`; row 0 is the start. The result is infinite if every second run
    breaks down.
    """
    rows = lru_cache(maxsize=1)(rows)  # a row is asked for several times, one after the other, and comes from a file
    estimate = math.inf
    order = resolution.first.march.stepper.order
    for second in _COARSER:
        found = _compared(resolution, second, rows, times, progress)
        if found is not None and second.tells(float(found.steps[-1])):
            estimate = found.estimate(order)
            break
    if estimate > _POOR:
        found = _compared(resolution, _FINER, rows, times, progress)
        estimate = estimate if found is None else float(np.max(found.apart))
    return estimate


def _compared(
    resolution: Resolution,
    second: _Second,
    rows: Callable[[int], Row],
    times: np.ndarray,
    progress: Told,
) -> _Compared | None:
    """Makes the second run and compares it with the first; returns None if it breaks down."""
    progress(times[-1], f"estimating the error: compiling a run with {second.in_words()}")
    other, state = resolution.other(second.nodes, second.tolerance, partial(progress, times[-1]))
    apart, ratios, tails = [], [], np.zeros((2, len(_TAILS)))
    last = len(times) - 1
    for i in instants(lambda i: int(rows(i).steps), last):
        row = rows(i)
        state, found = other.stepped(state, times[i], partial(progress, times[i]))
        code = int(state.status)
        if not len(found.t) or code not in (status.RUNNING, status.STEADY):
            return None
        tails = np.maximum(tails, [[np.max(r.diagnostics[name]) for name in _TAILS] for r in (row, found)])
        apart.append(max(_distances(row, found)))
        ratios.append(int(row.steps) / max(int(state.steps), 1) if row.steps else math.inf)
        progress(times[-1], f"estimating the error: t = {times[i]:.3g} with {second.in_words()}")
        if code == status.STEADY or (2 * i > last and not second.tells(ratios[-1])):
            break
    found = np.array(apart), np.array(ratios)
    return _Compared(*found, float(np.max(tails[0] / np.maximum(tails[1], np.finfo(float).tiny))))


def instants(steps: Callable[[int], int], last: int) -> Iterator[int]:
    """Yields the saved times at which two runs are compared: the first, the `last`, and those a few steps apart.

    `steps(i)` is the number of steps up to saved time i. A fast transient has many steps, so it is not passed over.
    """
    before = 0
    for i in range(last + 1):
        if i in (0, last) or steps(i) - before >= _BETWEEN:
            before = steps(i)
            yield i


def _distances(row: Row, found: Row) -> list[float]:
    """Returns the largest differences of x and V_m between rows of two runs, on the finer nodes of the two."""
    out = []
    for one, other in ((row.x, found.x), (row.V_m, found.V_m)):
        if one is not None:
            K = max(one.shape[1], other.shape[2])
            first, second = finer_rows(one[None], K), finer_rows(other, K)
            out.append(float(np.max(np.abs(first - second))))
    return out
