"""`nodes = "auto"`: as many nodes as the shape, the potential and the tension ask for, from one saved time to the next.

A stretch between saved times is marched with some number of nodes. When its end is not resolved with them, or is not
reached, the stretch is made anew with more, so that nothing unresolved stays; when its end would be resolved with
fewer, the next stretch has fewer. Unresolved are

- a spectrum (of x or V_m) whose top is above `limit` of its largest mode; that of the tension above 1000 times that,
  since a mode k of λ moves the membrane by 1/k³ of it;
- a neck or fold narrower than four nodes, where Kress's quadrature does not see the other side.

Each number of nodes is compiled once. The interpolant of the nodes goes on when their number changes; projected, so
that area, perimeter and equal spacing stay what they are.
"""

from collections.abc import Callable

import equinox as eqx
import numpy as np

from ..base import status
from ..equation.equation import Equation, Filter
from ..equation.state import Unknowns
from ..inputs.scene_tables import SceneFile
from ..numerics import fourier
from ..stepping import marching
from ..stepping.marching import State
from .build import build
from .case import Case
from .problem import AUTO_NODES, Problem, awaited, problem_of, strengthened, with_nodes

_TENSION = 1e3  # its limit in units of that of x and V_m
_NECK = 4.0  # nodes along the narrowest chord
_HYSTERESIS = 0.1  # of the limit, below which fewer nodes will do
_FEWEST = 12
_LOOSER = 30.0  # times the limit, for nodes that a second run may be without
_RESOLVABLE = frozenset({status.UNRESOLVED, status.DRIFT, status.SOLVE_FAILED, status.SELF_CONTACT}) | {
    status.COLLISION,
    status.STEP_UNDERFLOW,
    status.NOT_FINITE,
}

Row = dict[str, np.ndarray]


@eqx.filter_jit
def _march(problem: Problem, state: State, t_save):
    return marching.advance(problem.equation, problem.march, state, t_save[None], problem.stops, problem.checks)


@eqx.filter_jit
def _resampled(equation: Equation, y: Unknowns) -> Unknowns:
    N = equation.scene.x.shape[1]
    V_m = None if y.V_m is None else fourier.resample(y.V_m, N, axis=1)
    return equation.settled(Unknowns(fourier.resample(y.x, N, axis=1), V_m, y.integrals))


def finer_rows(f: np.ndarray, K: int) -> np.ndarray:
    """f (T, M, N, ...) on K nodes."""
    N = f.shape[2]
    return f if K == N else np.moveaxis(np.moveaxis(f, 2, -1) @ fourier.resampling_matrix(N, K).T, -1, 2)


def _tail(f: np.ndarray, N: int, cut: int) -> float:
    """As `fourier.spectral_tail`, of f (M, nodes, ...) were it given on N nodes; at worst."""
    size = np.abs(np.fft.rfft(f, axis=1)).reshape(len(f), f.shape[1] // 2 + 1, -1).max(axis=2)
    last = N // 2 - cut
    top = size[:, last - max(last // 8, 2) + 1 : last + 1].max(axis=1)
    return float(np.max(top / np.maximum(size[:, 1:].max(axis=1), np.finfo(float).tiny)))


def demand(row: Row, N: int) -> float:
    """How badly the saved instant `row` (one row) needs more than N nodes: unresolved in units of the limit of x."""
    cut = Filter.for_nodes(N)
    found = [_tail(row["x"][0], N, cut.x), _tail(row["tension"][0], N, cut.surface) / _TENSION]
    if "V_m" in row and np.max(np.ptp(row["V_m"][0], axis=1)) > 1e-8:  # where it does not vary, it is round-off
        found.append(_tail(row["V_m"][0], N, cut.surface))
    return max(found)


def necks_hold(row: Row, N: int) -> bool:
    """Whether the narrowest chords of all vesicles have nodes enough."""
    spacing = row["diagnostics/length"] / N
    return bool(np.all(row["diagnostics/self_gap"] >= _NECK * spacing))


class Resolution:
    """The numbers of nodes that a run may use, and the problem with each; rows hold the greatest.

    `limit`: of the spectrum of x and V_m; a run with one number of nodes keeps it. `anew` gives the problem with N
    nodes from the scene file, whose curves more nodes show better; without it the nodes of `problem` are all there is.
    """

    def __init__(
        self,
        problem: Problem,
        sizes: tuple[int, ...],
        limit: float,
        anew: Callable[[int], Problem | None] = lambda N: None,
    ):
        self.sizes = sizes
        self.limit = limit
        self._anew = anew
        self._problems = {problem.equation.scene.x.shape[1]: problem}
        self.first = problem

    def other(self, nodes: float, tolerance: float) -> tuple["Resolution", State]:
        """The same run with about `nodes` times its nodes and `tolerance` times its tolerance, and its state at t = 0.

        Where nodes follow the need of the run, their limit moves as the error of time does.
        """
        march = self.first.march.with_tolerance(tolerance)
        sizes = tuple(max(2 * round(0.5 * nodes * N), _FEWEST) for N in self.sizes)
        if nodes > 1:  # those there are already come first: they are compiled
            sizes = tuple(sorted({*self.sizes[1:], *sizes[-1:]}))
        elif len(self.sizes) > 1:
            sizes = (*sizes[:1], *self.sizes[:-1])
        limit = self.limit * (_LOOSER if nodes < 1 else 1 / _LOOSER)
        start = self.first.state.y.x.shape[1]
        N = min((K for K in sizes if min(nodes, 1.01) * start <= K), default=sizes[-1])
        problem = self._anew(N)
        first = strengthened(eqx.tree_at(lambda p: p.march, problem or self.first, march))
        other = Resolution(first, sizes, limit)
        return other, first.state if problem else other._moved(first.state, N)

    def problem(self, N: int) -> Problem:
        """The problem with N nodes."""
        if N not in self._problems:
            equation = strengthened(eqx.filter_jit(Equation.with_nodes)(self.first.equation, N))
            self._problems[N] = eqx.tree_at(lambda p: p.equation, self.first, equation)
        return self._problems[N]

    def row(self, state: State, t_save: float) -> tuple[State, Row]:
        """The state at the next saved time with the nodes that `state` has, and the row: empty when the run ended."""
        problem = self.problem(state.y.x.shape[1])
        state, row = awaited(_march(problem, state, np.asarray(t_save)))
        row = {name: np.asarray(value) for name, value in row.items()}
        there = ~np.isnan(row["t"])
        row = {name: value[there] for name, value in row.items()}
        return state, row | {"steps": np.full(len(row["t"]), int(state.steps))}

    def stored(self, row: Row) -> Row:
        """The row with the number of nodes that all rows have, and the number that was used."""
        count, M, N = row["x"].shape[:3]
        finer = {name: finer_rows(row[name], self.sizes[-1]) for name in ("x", "V_m", "tension") if name in row}
        return row | finer | {"nodes": np.full((count, M), N)}

    def stepped(self, state: State, t_save: float) -> tuple[State, Row]:
        """The state to go on with from the next saved time, and the row for it: empty when the run ended before."""
        N = state.y.x.shape[1]
        after, row = self.row(state, t_save)
        while self._wants_more(after, row, N):
            N = min(K for K in self.sizes if K > N)
            state = self._moved(state, N)
            after, row = self.row(state, t_save)
        fewer = max((K for K in self.sizes if K < N), default=None)
        if fewer is not None and int(after.status) == status.RUNNING and self._is_enough(row, fewer):
            after = self._moved(after, fewer)
        return after, self.stored(row)

    def _wants_more(self, after: State, row: Row, N: int) -> bool:
        if self.sizes[-1] == N:
            return False
        if not len(row["t"]) or int(after.status) in _RESOLVABLE:
            return int(after.status) in _RESOLVABLE
        return demand(row, N) > self.limit or not necks_hold(row, N)

    def _is_enough(self, row: Row, N: int) -> bool:
        return demand(row, N) < _HYSTERESIS * self.limit and necks_hold(row, N)

    def _moved(self, state: State, N: int) -> State:
        y = strengthened(_resampled(self.problem(N).equation, state.y))
        return eqx.tree_at(lambda s: s.y, state, y)


def resolution_of(scene_file: SceneFile, problem: Problem) -> Resolution:
    """One number of nodes, or those of "auto" from the start's on; a hundredth of the tolerance goes to space."""
    x = problem.equation.scene.x

    def anew(N: int) -> Problem | None:
        """None for a start that the file does not describe by itself: relaxed, or taken from another run."""
        own = build(with_nodes(scene_file, x.shape[1])).x
        if not np.allclose(own, x, rtol=0.0, atol=1e-12):
            return None
        other = with_nodes(scene_file, N)
        return problem_of(Case(other), build(other))

    if scene_file.numerics.nodes != "auto":
        return Resolution(problem, (x.shape[1],), 0.0, anew)
    tolerance = scene_file.numerics.tolerance or 1e-4
    return Resolution(problem, AUTO_NODES, float(np.clip(1e-2 * tolerance, 1e-9, 1e-5)), anew)
