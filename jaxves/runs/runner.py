"""Runs a scene: from a scene file to a result file, with progress and restart.

Compiled code advances from one saved time to the next. In between, Python writes the file, shows progress and can be
interrupted. The same compiled code computes every row, also the first. A run that is continued from its file therefore
agrees bit for bit with an uninterrupted one (on the same machine with the same jaxlib).
"""

import time
from functools import partial
from pathlib import Path

import numpy as np

from ..base import status
from ..base.arguments import refusal
from ..base.progress import Progress, Told, silent
from ..inputs.scene_files import Readable
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import RUN
from ..observables import diagnostics
from ..observables.certificate import certificate, has_enough_digits
from ..observables.of_ones_own import Observables, require_observables, with_own
from ..results import hdf5, run_store
from ..results.ownership import real, writing
from ..stepping.state import Window
from .advice import NodesOfRun, advice
from .beginning import Begun, continued, new
from .case import Case
from .continuation import is_done, saved_times
from .error_estimate import estimated_error
from .programs import compiled


class Broken(Exception):
    """The result file can no longer be written. The rows in it are kept."""


def _means(window: Window, scene):
    return diagnostics.averages(window.means(), scene)


def run(
    scene_file: Readable,
    path: str | Path,
    *,
    force: bool = False,
    resume: bool = False,
    start: str | Path | None = None,
    at: float | None = None,
    observables: Observables | None = None,
    progress: Progress = silent,
) -> str:
    """Runs a scene and writes a result file; returns the status word. Ctrl-C ends the run as "interrupted".

    Args:
        scene_file: a scene file that was read, the path of one, the name of a built-in scene, or tables.
        path: the result file.
        force: replace the file if it exists.
        resume: continue the file, also to a later `t_end` with as many more `saves`. A complete file is not changed.
        start: another result file. The run starts at t = 0 with the nodes of its last saved time. If both have a field,
            it also starts with its V_m. Shapes, positions, `relaxed` and `disturbance` of the scene are not used. Such
            a run is resumed without `start`.
        at: start from the saved time nearest to this one instead of the last.
        observables: functions of your own by name, as for `simulate`. Their values are among the diagnostics of the
            file. A run that has them is resumed with the same names.
        progress: called at each saved time with the time reached, the end of the run, and a text.

    Raises:
        SceneError: there is no such scene, or a value of it is not allowed.
        StoreError: the file exists (without `force`), is being written by another process, cannot be written, or cannot
            be resumed; or the run cannot start from `start`.
        ValueError: `at` without `start`, `start` with `resume`, or an observable that cannot be used.
        Broken: the file can no longer be written.
        KeyboardInterrupt: Ctrl-C before anything was written.
    """
    began, path = time.perf_counter(), real(path)
    require_observables(observables)
    scene_file = Case.of(scene_file, RUN).scene_file
    told = partial(_tell, progress, scene_file.t_end)
    if at is not None and start is None:
        raise refusal("at", at, "no time without a result file to start from")
    if resume and start is not None:
        raise refusal("start", str(start), "none for a run that is resumed: its own file has the start")
    with writing(path):
        if resume and is_done(path, scene_file):
            return run_store.read_result(path).status
        if resume:
            begun = continued(scene_file, path, observables, began)
        else:
            hdf5.refuse_existing(path, force, resumable=True)
            begun = new(scene_file, path, force, start, at, observables, began, told)
        return _carried_out(scene_file, begun, observables, began, told)


def _tell(progress: Progress, t_end: float, t: float, text: str) -> None:
    progress(t, t_end, text)


def _carried_out(
    scene_file: SceneFile, begun: Begun, observables: Observables | None, began: float, progress: Told
) -> str:
    """Runs to the end, evaluates the result and completes the file; returns the status word."""
    with begun.rows.writer as writer:
        try:
            if begun.failed is None:
                word = status.WORDS[_marched(scene_file, begun, observables, progress)]
            else:
                word = begun.failed.word
            begun.rows.write()
            error = _error(scene_file, begun, progress) if word in status.SUCCESS else None
            found = writer.diagnostics()
            links = certificate(found, error)
            if word in status.SUCCESS and not has_enough_digits(links):
                word = status.WORDS[status.INACCURATE]
            failed = begun.failed and f"{begun.failed}."
            words = failed or advice(word, _nodes(begun), found)
            writer.finish(word, words, time.perf_counter() - began, _averages(begun), links, error)
        except hdf5.StoreError as error:
            raise Broken(str(error)) from error
    return word


def _marched(scene_file: SceneFile, begun: Begun, observables: Observables | None, progress: Told) -> int:
    """Advances to the end of the run; returns its status."""
    resolution, state, rows, _ = begun
    wanted = None if scene_file.stop is None else scene_file.stop.class_

    def code() -> int:
        if wanted and int(state.status) == status.RUNNING and rows.has_reached(wanted):
            return status.CLASS_REACHED
        return int(state.status)

    found = code()
    try:
        for t_save in saved_times(scene_file)[rows.writer.saved :]:
            if found != status.RUNNING:
                break
            state, row = resolution.stepped(state, t_save, partial(progress, float(state.t)))
            rows.add(with_own(row, observables), state)
            found = code()
            progress(float(state.t), f"{int(state.steps)} steps")
    except KeyboardInterrupt:
        return status.INTERRUPTED
    return status.COMPLETE if found == status.RUNNING else found


def _error(scene_file: SceneFile, begun: Begun, progress: Told) -> float | None:
    """Returns the estimated error of the whole run, None if it is not asked for, NaN if it was interrupted."""
    if scene_file.numerics.certify is False:
        return None
    writer = begun.rows.writer
    if writer.saved < 2:  # the run ended at its start, so there is nothing to compare
        return None
    try:
        return estimated_error(begun.resolution, writer.row, saved_times(scene_file)[: writer.saved], progress)
    except KeyboardInterrupt:  # the run itself is complete
        return np.nan


def _nodes(begun: Begun) -> NodesOfRun:
    sizes, neck = begun.resolution.sizes, begun.resolution.first.equation.refinement.resolved
    return NodesOfRun(begun.rows.state.y.x.shape[1], sizes[-1], len(sizes) > 1, neck)


def _averages(begun: Begun) -> dict[str, np.ndarray] | None:
    window = begun.rows.state.window
    if window is None or not window.reached[1] > window.reached[0]:
        return None
    means = compiled(_means)(window, begun.resolution.first.equation.scene)
    return {name: np.asarray(value) for name, value in means.items()}
