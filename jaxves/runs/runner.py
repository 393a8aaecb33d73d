"""A run as users start it: from a scene file to a result file, with progress and a restart.

Compiled code marches from one saved time to the next; in between Python writes the file, shows progress, and
can be interrupted. The same compiled code makes every row, the first one too, so that a run continued from its
file has the bits of an uninterrupted one, wherever it was cut (same machine, same jaxlib).
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..base import status
from ..base.arguments import refusal
from ..inputs.scene_files import read_scene, to_toml
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import RUN
from ..observables import classes, diagnostics, quantities
from ..observables.certificate import LEAST_DIGITS, certificate, weakest
from ..physics.scene import Scene
from ..results import run_store
from ..results.ownership import real, writing
from ..stepping import marching
from ..stepping.marching import State
from .adapt_nodes import Resolution, resolution_of
from .build import build
from .case import Case
from .continuation import is_done, saved_times
from .earlier import started_from
from .error_estimate import estimated_error
from .problem import NotRelaxed, problem_of, relaxed, starting_scene, strengthened

_SECONDS = 0.5  # between writes: what a killed run may lose
# In the restart: nodes (relaxed and all) and, where it does not vanish, potential at t = 0, before they were filtered.
_START, _START_V_m = "start", "start_V_m"

Progress = Callable[[float, str], None]  # time reached, what to say of it


class Broken(Exception):
    """The result file cannot be written any more; what it has is kept."""


@eqx.filter_jit
def _means(window: marching.Window, scene):
    return diagnostics.averages(window.means(), scene)


def _named(state: State) -> dict[str, np.ndarray]:
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves}


def _restored(template: State, leaves: dict[str, np.ndarray], path: Path) -> State:
    names = list(_named(template))
    if sorted(leaves) != sorted(names):
        found = run_store.read_result(path).attributes["version"]
        other = ", ".join(sorted({*leaves} ^ {*names}))
        raise run_store.StoreError(
            f"{path} holds a state of jaxves {found}, which has other parts ({other}) than this version continues from:"
            " continue it with that version, or start from its end with --from."
        )
    state = jax.tree.unflatten(jax.tree.structure(template), [jnp.asarray(leaves[name]) for name in names])
    if int(state.status) != status.TOO_MANY_STEPS:
        return state
    # That limit is meant for one sitting.
    return eqx.tree_at(
        lambda s: (s.status, s.steps, s.rejected), state, (jnp.int32(status.RUNNING), *jnp.int32([0, 0]))
    )


def _description(name: str) -> run_store.Description:
    if name in run_store.HISTORY:
        return run_store.HISTORY[name]
    return run_store.Description(*quantities.QUANTITIES[name.removeprefix("diagnostics/")])


class _Rows:
    """Rows on their way into the file, written now and then, with the state to continue from after the last.

    `start` is None for a run that nobody can continue.
    """

    state: State

    def __init__(self, writer: run_store.Writer, start: dict[str, np.ndarray] | None):
        self.writer = writer
        self.start = start
        self.deformation: list[np.ndarray] = []  # along the field, of all rows there are
        self._waiting: list[dict[str, np.ndarray]] = []
        self._written = time.perf_counter()

    def add(self, row: dict[str, np.ndarray], state: State) -> None:
        if len(row["t"]):
            self._waiting.append(row)
            self.deformation.extend(row.get("diagnostics/deformation_along_field", ()))
            self.state = state
        if time.perf_counter() > self._written + _SECONDS:
            self.write()

    def write(self) -> None:
        if self._waiting:
            block = {name: np.concatenate([row[name] for row in self._waiting]) for name in self.writer.names}
            restart = {} if self.start is None else _named(self.state) | self.start
            self.writer.append(block, restart)
            self._waiting = []
        self._written = time.perf_counter()


def run(
    scene_file: SceneFile | str | Path,
    path: str | Path,
    *,
    force: bool = False,
    resume: bool = False,
    start: str | Path | None = None,
    at: float | None = None,
    progress: Progress = lambda t, text: None,
) -> str:
    """Runs a scene file, or the one of that path or built-in name, into a result file; returns the status word.

    Ctrl-C ends it as "interrupted".

    With `resume` the file is continued, also to a later `t_end` with as many more `saves`; one that is done already is
    left as it is.

    With `start`, another result file, the run starts at t = 0 with the nodes of the last saved time of that file, or of
    the one nearest to `at`; where both have a field, also with its V_m. The shapes, places, `relaxed` and `disturbance`
    of the scene's vesicles are not used. Such a run is resumed without `start`.

    Raises:
        SceneError: no such scene, or a value that no scene file may have.
        store.StoreError: the file exists (without `force`), is being written by another run, cannot be written, or
            cannot be resumed; or `start` cannot be started from.
        ValueError: `at` without `start`, or `start` with `resume`.
        Broken: it can no longer be written.
        KeyboardInterrupt: Ctrl-C before there was anything to write.
    """
    began, path = time.perf_counter(), real(path)
    scene_file = read_scene(scene_file) if isinstance(scene_file, str | Path) else scene_file
    Case.of(scene_file, RUN)
    if at is not None and start is None:
        raise refusal("at", at, "no time without a result file to start from")
    if resume and start is not None:
        raise refusal("start", str(start), "none for a run that is resumed: its own file has the start")
    with writing(path):
        if resume and is_done(path, scene_file):
            return run_store.read_result(path).status
        if not resume and not force and path.exists():
            raise run_store.StoreError(f"{path} exists already: use --force to replace it or --resume to continue it.")
        begun = _continued(scene_file, path) if resume else _new(scene_file, path, force, start, at, progress)
        return _carried_out(scene_file, begun, began, progress)


def _carried_out(scene_file: SceneFile, begun: "_Begun", began: float, progress: Progress) -> str:
    """Marches, judges the result and ends the file; returns the status word."""
    with begun.rows.writer as writer:
        try:
            if begun.failed is None:
                word = status.WORDS[_marched(scene_file, begun, progress)]
                advice = status.ADVICE[word]
            else:
                word, advice = begun.failed.word, f"{begun.failed}."
            begun.rows.write()
            error = _error(scene_file, begun, progress) if word in status.SUCCESS else None
            links = certificate(writer.diagnostics(), error)
            if word in status.SUCCESS and not links[weakest(links)].digits >= LEAST_DIGITS:
                word = status.WORDS[status.INACCURATE]
                advice = status.ADVICE[word]
            writer.finish(word, advice, time.perf_counter() - began, _averages(begun), links, error)
        except run_store.StoreError as error:
            raise Broken(str(error)) from error
    return word


class _Begun(NamedTuple):
    """A run with its file open, at the last row in it."""

    resolution: Resolution
    state: State
    rows: _Rows
    failed: NotRelaxed | None = None


def _started(
    scene_file: SceneFile, start: str | Path | None, at: float | None, progress: Progress
) -> tuple[Scene, dict[str, str], NotRelaxed | None]:
    """The scene at t = 0, what the file shall say of its origin, and why it has not come to rest if it had to."""
    if start is not None:
        scene, words = started_from(start, at, scene_file)
        return scene, {"started_from": words}, None
    scene = starting_scene(scene_file)
    if any(vesicle.relaxed for vesicle in scene_file.vesicles()):
        progress(0.0, "relaxing")
        try:
            scene = relaxed(Case(scene_file), scene)
        except NotRelaxed as error:
            return scene, {}, error
    return scene, {}, None


def _new(
    scene_file: SceneFile, path: Path, force: bool, start: str | Path | None, at: float | None, progress: Progress
) -> _Begun:
    """The first row is in the file."""
    case, (scene, origin, failed) = Case(scene_file), _started(scene_file, start, at, progress)
    progress(0.0, "compiling")
    problem = strengthened(problem_of(case, scene))
    resolution = resolution_of(scene_file, problem)
    state, row = resolution.row(problem.state, 0.0)
    row = resolution.stored(row)
    # Nothing has moved; but a start may be beyond the limits already.
    state = eqx.tree_at(lambda s: s.status, problem.state, state.status)
    _, M, N = row["x"].shape[:3]
    symmetry = problem.equation.symmetry
    writer = run_store.Writer(
        path,
        scene_text=to_toml(scene_file),
        attributes={"device": str(jax.devices()[0]), "symmetry": "" if symmetry is None else symmetry.kept} | origin,
        times=saved_times(scene_file),
        vesicles=M,
        nodes=N,
        datasets={name: _description(name) for name in row},
        force=force,
    )
    given = {_START: scene.x} | ({} if scene.V_m is None else {_START_V_m: scene.V_m})
    rows = _Rows(writer, None if failed else {name: np.asarray(leaf) for name, leaf in given.items()})
    rows.add(row, state)
    rows.write()
    return _Begun(resolution, state, rows, failed)


def _continued(scene_file: SceneFile, path: Path) -> _Begun:
    """At the last row of the file. Nodes are not sought and vesicles not relaxed again: the file has the start."""
    deformation = run_store.read_result(path).diagnostics.get("deformation_along_field", ())
    leaves = run_store.state(path)
    start = {name: leaves.pop(name) for name in (_START, _START_V_m) if name in leaves}
    given = jnp.asarray(start[_START]), jnp.asarray(start[_START_V_m]) if _START_V_m in start else None
    scene = eqx.tree_at(lambda s: (s.x, s.V_m), build(scene_file), given, is_leaf=lambda leaf: leaf is None)
    problem = strengthened(problem_of(Case(scene_file), scene))
    state = _restored(problem.state, leaves, path)
    # Until here the file is untouched, whatever fails or interrupts.
    rows = _Rows(run_store.resume(path, to_toml(scene_file), saved_times(scene_file)), start)
    rows.deformation.extend(deformation)
    rows.state = state
    return _Begun(resolution_of(scene_file, problem), rows.state, rows)


def _marched(scene_file: SceneFile, begun: _Begun, progress: Progress) -> int:
    """Marches to the end of the run; returns its status."""
    resolution, state, rows, _ = begun
    wanted = None if scene_file.stop is None else scene_file.stop.class_

    def code() -> int:
        if wanted and int(state.status) == status.RUNNING and classes.reached(np.array(rows.deformation), wanted):
            return status.CLASS_REACHED
        return int(state.status)

    found = code()
    try:
        for t_save in saved_times(scene_file)[rows.writer.saved :]:
            if found != status.RUNNING:
                break
            state, row = resolution.stepped(state, t_save)
            rows.add(row, state)
            found = code()
            progress(float(state.t), f"{int(state.steps)} steps")
    except KeyboardInterrupt:
        return status.INTERRUPTED
    return status.COMPLETE if found == status.RUNNING else found


def _error(scene_file: SceneFile, begun: _Begun, progress: Progress) -> float | None:
    """The estimated error of the whole run; None where it is not wanted, NaN where it was interrupted."""
    if scene_file.numerics.certify is False:
        return None
    writer = begun.rows.writer
    if writer.saved < 2:  # ended at its start: nothing to compare
        return None
    try:
        return estimated_error(begun.resolution, writer.row, saved_times(scene_file)[: writer.saved], progress)
    except KeyboardInterrupt:  # the run itself is complete
        return np.nan


def _averages(begun: _Begun) -> dict[str, np.ndarray] | None:
    window = begun.rows.state.window
    if window is None or not window.reached[1] > window.reached[0]:
        return None
    return {name: np.asarray(value) for name, value in _means(window, begun.resolution.first.equation.scene).items()}
