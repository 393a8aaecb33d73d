"""Begins a run: with a new result file, from an earlier result, or after the last row of its own file."""

from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..base.progress import Told
from ..inputs.scene_files import to_toml
from ..inputs.scene_tables import SceneFile
from ..observables.of_ones_own import Observables, with_own
from ..observables.quantities import QUANTITIES
from ..physics.scene import Scene
from ..results import run_store, run_writer
from ..results.hdf5 import StoreError
from ..stepping.state import State
from .adapt_nodes import Resolution, resolution_of
from .build import build
from .case import Case
from .continuation import saved_times
from .earlier import started_from
from .first_nodes import first_row
from .problem import NotRelaxed, problem_of, relaxed, starting_scene, strengthened
from .rows import Rows, restored

# Names in the restart state: nodes (after relaxation) and, if not zero, potential at t = 0, before they are filtered.
_START, _START_V_m = "start", "start_V_m"


class Begun(NamedTuple):
    """A run with its file open, after the last row in it."""

    resolution: Resolution
    state: State
    rows: Rows
    failed: NotRelaxed | None = None


def _started(
    scene_file: SceneFile, start: str | Path | None, at: float | None, progress: Told
) -> tuple[Scene, dict[str, str], NotRelaxed | None]:
    """Returns the scene at t = 0, attributes that describe its origin, and the error if a vesicle did not relax."""
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


def new(
    scene_file: SceneFile,
    path: Path,
    force: bool,
    start: str | Path | None,
    at: float | None,
    observables: Observables | None,
    began: float,
    progress: Told,
) -> Begun:
    """Begins a new run and writes its first row. The arguments are those of `runner.run`; `began` is that of `Rows`."""
    case, (scene, origin, failed) = Case(scene_file), _started(scene_file, start, at, progress)
    progress(0.0, "compiling")
    scene, resolution, state, row = first_row(case, scene)
    row = with_own(resolution.stored(row), observables)
    _, M, N = row.x.shape[:3]
    symmetry = resolution.first.equation.symmetry
    writer = run_writer.Writer(
        path,
        scene_text=to_toml(scene_file),
        attributes={"device": str(jax.devices()[0]), "symmetry": "" if symmetry is None else symmetry.kept} | origin,
        times=saved_times(scene_file),
        vesicles=M,
        nodes=N,
        datasets={name: run_store.description(name, np.ndim(f)) for name, f in run_store.datasets_of(row).items()},
        force=force,
    )
    given = {_START: scene.x} | ({} if scene.V_m is None else {_START_V_m: scene.V_m})
    rows = Rows(writer, None if failed else {name: np.asarray(leaf) for name, leaf in given.items()}, began)
    rows.add(row, state)
    rows.write()
    return Begun(resolution, state, rows, failed)


def continued(scene_file: SceneFile, path: Path, observables: Observables | None, began: float) -> Begun:
    """Returns the run in the file, after its last row.

    The starting shapes come from the file, so that vesicles are not relaxed again.

    Raises:
        StoreError: the file cannot be continued, or has other observables than these.
    """
    record = run_store.read_result(path)
    own = sorted(record.diagnostics.keys() - QUANTITIES.keys())
    if own != sorted(observables or ()):
        given = ", ".join(sorted(observables or ())) or "none"
        expected = ", ".join(own) or "none"
        raise StoreError(f"observables = {given}, expected those of the run in {path}: {expected}.")
    leaves = run_store.state(path)
    start = {name: leaves.pop(name) for name in (_START, _START_V_m) if name in leaves}
    given = jnp.asarray(start[_START]), jnp.asarray(start[_START_V_m]) if _START_V_m in start else None
    scene = eqx.tree_at(lambda s: (s.x, s.V_m), build(scene_file), given, is_leaf=lambda leaf: leaf is None)
    problem = strengthened(problem_of(Case(scene_file), scene))
    state = restored(problem.state, leaves, path)
    # Until here the file is unchanged, also after an error or an interrupt.
    rows = Rows(run_writer.resume(path, to_toml(scene_file), saved_times(scene_file)), start, began)
    rows.remember(record.diagnostics)
    rows.state = state
    return Begun(resolution_of(scene_file, problem, record.x.shape[2]), rows.state, rows)
