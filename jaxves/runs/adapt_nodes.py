"""Adapts the number of nodes to the shape, the potential and the tension, for `nodes = "auto"`.

The interval between two saved times is computed with a certain number of nodes. If its end is not reached or not
resolved, the interval is computed again with more nodes. If its end would be resolved with fewer nodes, the next
interval has fewer. The end of an interval is not resolved if

- the top of a spectrum of x or V_m exceeds `limit` times its largest mode, or that of the tension 1000 times this value
  (a mode k of λ moves the membrane by a factor of 1/k³ less). While compression asks for more than 64 nodes, ten times
  as much is allowed, because wrinkles have wide spectra: with 2e-5 for x, wrinkles were correct to 1e-4
  (`experiments/strong_fields.py`);
- a neck or fold is narrower than four node spacings; or
- the membrane is so compressed that N < 3 √|λ_min|, with the most negative tension λ_min in κ_B/ρ² and the perimeter
  2πρ. The fastest growing wrinkle then has fewer than 5.2 nodes per wave. This rule also holds at every step
  (`AbstractMarch.nodes_per_wave`): an interval that breaks it is computed again.

The program for each number of nodes is compiled once. When the number changes, the new nodes lie on the interpolant of
the old ones. They are projected, so that area, perimeter and equal spacing are kept.
"""

import copy
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..base import status
from ..base.resolution import SMALL_POTENTIAL, kept_modes, nodes_for_waves, sizes_up_to
from ..equation.equation import Equation
from ..equation.projection import Filter
from ..equation.state import Unknowns
from ..inputs.parameters import with_nodes
from ..inputs.scene_tables import SceneFile
from ..inputs.vesicle_tables import undulation_modes
from ..numerics import fourier
from ..numerics.arrays import VesiclePoints
from ..observables.rows import Row
from ..physics.scene import Scene
from ..stepping.loop import to_save
from ..stepping.state import Journey, State
from .build import build
from .case import Case
from .problem import Problem, awaited, begun, keeps_linear_part, problem_of, strengthened
from .programs import compiled, is_long

_TENSION = 1e3  # limit of the tension divided by that of x and V_m
_NECK = 4.0  # least number of node spacings along the narrowest chord
_HYSTERESIS = 0.1  # fewer nodes are used if they stay below this fraction of the limit
_WRINKLED = 10.0  # factor on the limit for wrinkled membranes
_ROOM = 1.2  # and are this many times as many as the wrinkles need
_FEWEST = 12
_LOOSER = 30.0  # factor on the limit for a second run with fewer nodes
_RESOLVABLE = frozenset({status.UNRESOLVED, status.DRIFT, status.SOLVE_FAILED, status.SELF_CONTACT}) | {
    status.COLLISION,
    status.STEP_UNDERFLOW,
    status.NOT_FINITE,
}


def _march(problem: Problem, journey: Journey, t_save):
    stops = jnp.append(problem.stops, t_save)
    kept = keeps_linear_part(journey.state)
    journey = journey if kept else problem.march.begin(journey.state, problem.equation)
    journey, row = to_save(journey, problem.equation, problem.march, t_save, stops, problem.checks)
    return (journey if kept else Journey(journey.state)), row


def _interpolated(y: Unknowns, N: int) -> Unknowns:
    x, scalars = jax.tree.map(lambda f: fourier.resample(f, N, axis=1), (y.x, y.scalars))
    return Unknowns(x, scalars, y.integrals)


def _with(state: State, y: Unknowns) -> State:
    """Returns the state with unknowns on other nodes."""
    errors = None if state.errors is None else state.errors.with_nodes(y)
    return eqx.tree_at(lambda s: (s.y, s.errors), state, (y, errors), is_leaf=lambda leaf: leaf is None)


def _settled(equation: Equation, state: State) -> State:
    return _with(state, equation.settled(_interpolated(state.y, equation.scene.x.shape[1])))


def _with_nodes(problem: Problem, N: int) -> tuple[Equation, Journey]:
    """Returns the equation with N nodes, and a journey whose state is interpolated but not projected."""
    equation = problem.equation.with_nodes(N)
    state = _with(problem.state, _interpolated(problem.state.y, N))
    return equation, begun(equation, problem.march, state)


def finer_rows(f: np.ndarray, K: int) -> np.ndarray:
    """Interpolates f (T, M, N, ...) to K nodes."""
    return fourier.resampled(f, K, 2)


def _tail(f: np.ndarray, N: int, cut: int, least: float = np.finfo(float).tiny) -> float:
    """Returns the largest `fourier.spectral_tail` of f (M, nodes, ...), as if f were given on N nodes."""
    size = np.abs(np.fft.rfft(f, axis=1)).reshape(len(f), f.shape[1] // 2 + 1, -1).max(axis=2)
    last = N // 2 - cut
    top = size[:, last - max(last // 8, 2) + 1 : last + 1].max(axis=1)
    return float(np.max(top / np.maximum(size[:, 1:].max(axis=1), 0.5 * f.shape[1] * least)))


def demand(row: Row, N: int) -> float:
    """Returns the largest spectral tail of one saved row on N nodes, in units of the limit of x."""
    cut = Filter.for_nodes(N)
    found = [_tail(row.x[0], N, cut.x), _tail(row.tension[0], N, cut.surface) / _TENSION]
    if row.V_m is not None:
        found.append(_tail(row.V_m[0], N, cut.surface, SMALL_POTENTIAL))
    return max(found)


def necks_hold(row: Row, N: int) -> bool:
    """Returns whether N nodes are enough for the narrowest chords of all vesicles."""
    spacing = row.diagnostics["length"] / N
    return bool(np.all(row.diagnostics["self_gap"] >= _NECK * spacing))


def nodes_for_wrinkles(row: Row, bending: np.ndarray) -> float:
    """Returns the number of nodes that the compression of the membranes at one saved time asks for."""
    compression = np.maximum(-row.diagnostics["tension_min"][0], 0.0)
    radius = row.diagnostics["length"][0] / (2 * np.pi)
    return nodes_for_waves(float(np.max(radius * np.sqrt(compression / (3 * bending)))))


def rebuilt(scene_file: SceneFile, x: VesiclePoints, N: int) -> Scene | None:
    """Returns the scene of the file with N nodes.

    It is None if the file does not describe the starting nodes x: they are relaxed, or taken from another run. The same
    holds if N nodes do not resolve its undulations.
    """
    if any(undulation_modes(vesicle) > kept_modes(N) for vesicle in scene_file.vesicle):
        return None
    own = build(with_nodes(scene_file, x.shape[1])).x
    return build(with_nodes(scene_file, N)) if np.allclose(own, x, rtol=0.0, atol=1e-12) else None


class Resolution:
    """The numbers of nodes that a run may use, with the problem for each. Rows are stored with the largest number.

    `limit` is that for the spectrum of x and V_m. `anew(N)` builds the problem with N nodes from the scene file, whose
    curves are more accurate than an interpolant of fewer nodes. If it returns None, the nodes of `problem` are
    interpolated.
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
        self._reached: Journey | None = None

    def other(self, nodes: float, tolerance: float, say: Callable[[str], None]) -> tuple["Resolution", State]:
        """Returns the same run with about `nodes` times its nodes and `tolerance` times its tolerance, and its start.

        If the number of nodes is adapted, the limit of the spectra is changed as well. `say` is told which number of
        nodes is compiled for.
        """
        march = self.first.march.with_tolerance(tolerance)
        sizes = tuple(max(2 * round(0.5 * nodes * N), _FEWEST) for N in self.sizes)
        if nodes > 1:  # sizes of this run are used first, because they are compiled already
            sizes = tuple(sorted({*self.sizes[1:], *sizes[-1:]}))
        elif len(self.sizes) > 1:
            sizes = (*sizes[:1], *self.sizes[:-1])
        limit = self.limit * (_LOOSER if nodes < 1 else 1 / _LOOSER)
        start = self.first.state.y.x.shape[1]
        N = min((K for K in sizes if min(nodes, 1.01) * start <= K), default=sizes[-1])
        problem = self._anew(N)
        first = strengthened(eqx.tree_at(lambda p: p.march, problem or self.first, march))
        other = Resolution(first, sizes, limit)
        return other, first.state if problem else other._moved(first.state, N, say)

    def up_to(self, nodes: float | int) -> "Resolution":
        """Returns the same run with its numbers of nodes up to about `nodes`, and at least that of its start."""
        other, sizes = copy.copy(self), sizes_up_to(max(nodes, self.first.state.y.x.shape[1]))
        other.sizes = tuple(N for N in self.sizes if sizes[-1] >= N)
        return other

    def problem(self, N: int) -> Problem:
        """Returns the problem with N nodes."""
        if N not in self._problems:
            parts = strengthened(compiled(_with_nodes)(self.first, N))
            self._problems[N] = eqx.tree_at(lambda p: (p.equation, p.journey), self.first, parts)
        return self._problems[N]

    def row(self, state: State, t_save: float) -> tuple[State, Row]:
        """Advances to the next saved time with the nodes of `state`; returns the state and the row.

        The row is empty if the run ended before.
        """
        M, N, _ = state.y.x.shape
        problem, reached = self.problem(N), self._reached
        # F and A at the last saved time are known, unless the run continues from another state.
        journey = reached if reached is not None and reached.state is state else problem.at(state)
        march = compiled(_march, quickly=not is_long(int(state.steps), M * N))
        self._reached, row = awaited(march(problem, journey, np.asarray(t_save)))
        state = self._reached.state
        row = jax.tree.map(lambda value: np.asarray(value)[None], row)
        row = row if not np.isnan(row.t[0]) else jax.tree.map(lambda value: value[:0], row)
        return state, row._replace(steps=np.full(len(row.t), int(state.steps)))

    def stored(self, row: Row) -> Row:
        """Returns the row interpolated to the number of nodes of all rows, with the number that was used."""
        count, M, N = row.x.shape[:3]
        at_nodes = {name: getattr(row, name) for name in ("x", "tension", "V_m", "scalars")}
        finer = jax.tree.map(lambda f: finer_rows(f, self.sizes[-1]), at_nodes)
        return row._replace(nodes=np.full((count, M), N), **finer)

    def stepped(self, state: State, t_save: float, say: Callable[[str], None]) -> tuple[State, Row]:
        """Advances to the next saved time and adapts the number of nodes; returns the state and the row.

        The row is empty if the run ended before. `say` is told which number of nodes is compiled for.
        """
        N = state.y.x.shape[1]
        after, row = self.row(state, t_save)
        while self._wants_more(int(after.status), row, N):
            wanted = self.wanted(row) if len(row.t) else 0.0
            N = next((K for K in self.sizes if N < K and wanted <= K), self.sizes[-1])
            state = self._moved(state, N, say)
            after, row = self.row(state, t_save)
        fewer = max((K for K in self.sizes if K < N), default=None)
        if fewer is not None and int(after.status) == status.RUNNING and self._is_enough(row, fewer):
            after = self._moved(after, fewer, say)
        return after, self.stored(row)

    def _wants_more(self, code: int, row: Row, N: int) -> bool:
        if self.sizes[-1] == N:
            return False
        if not len(row.t) or code in _RESOLVABLE:
            return code in _RESOLVABLE
        return demand(row, N) > self._limit(row) or not necks_hold(row, N) or self.wanted(row) > N

    def _is_enough(self, row: Row, N: int) -> bool:
        fits = demand(row, N) < _HYSTERESIS * self._limit(row) and necks_hold(row, N)
        return fits and _ROOM * self.wanted(row) <= N

    def _limit(self, row: Row) -> float:
        return self.limit * (_WRINKLED if self.wanted(row) > sizes_up_to(0)[0] else 1.0)

    def wanted(self, row: Row) -> float:
        """Returns the number of nodes that the compression of the membranes in a row asks for."""
        return nodes_for_wrinkles(row, np.asarray(self.first.equation.scene.bending))

    def _moved(self, state: State, N: int, say: Callable[[str], None]) -> State:
        if N not in self._problems:
            say(f"compiling with {N} nodes")
        return strengthened(compiled(_settled)(self.problem(N).equation, state))


def resolution_of(scene_file: SceneFile, problem: Problem, largest: float | int) -> Resolution:
    """Returns the numbers of nodes for a run: a fixed one, or those of "auto" up to `largest`.

    For "auto" the limit of the spectra is a hundredth of the tolerance, in [1e-9, 1e-5].
    """
    x = problem.equation.scene.x

    def anew(N: int) -> Problem | None:
        scene = rebuilt(scene_file, x, N)
        return None if scene is None else problem_of(Case(with_nodes(scene_file, N)), scene)

    if scene_file.numerics.nodes != "auto":
        return Resolution(problem, (x.shape[1],), 0.0, anew)
    tolerance = scene_file.numerics.tolerance or 1e-4
    sizes = tuple(N for N in sizes_up_to(largest) if largest >= N)
    return Resolution(problem, sizes, float(np.clip(1e-2 * tolerance, 1e-9, 1e-5)), anew)
