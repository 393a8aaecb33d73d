"""Starts a run from a saved time of another result file: its nodes and its membrane potential."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from ..base.arguments import refusal
from ..base.resolution import sizes_up_to
from ..geometry import starts
from ..geometry.shapes import equispaced_parameters
from ..inputs.scene_tables import SceneFile
from ..numerics.fourier import evaluate
from ..physics.scene import Scene
from ..results import run_store
from ..results.hdf5 import StoreError
from ..results.run_store import Record
from .adapt_nodes import finer_rows
from .build import build


def started_from(path: str | Path, at: float | None, scene_file: SceneFile) -> tuple[Scene, str]:
    """Returns the scene of `scene_file` with the curves of another result, and a text that names file and time.

    The membrane potential is used as well if both have a field. The number of nodes is that of `scene_file`. For "auto"
    it is the smallest allowed number that is not less than that of the result.

    Args:
        path: the result file.
        at: the saved time nearest to this one is used; the last if None.
        scene_file: has everything except the shapes and positions of the vesicles.

    Raises:
        StoreError: the file is not a result file, has another number of vesicles, or does not have that time; or a run
            cannot start from its curves, or would lose the charge that it has besides V_m.
    """
    record = run_store.read_result(path)
    row = _row(record, path, at)
    M = len(scene_file.vesicles())
    if record.x.shape[1] != M:
        raise StoreError(f"{path} holds {record.x.shape[1]} vesicles, but the scene has {M}: expected as many.")
    scene, words = build(scene_file), f"{path} at t = {record.t[row]:.12g}"
    if scene.cell is not None and scene.flow is not None and record.t[row] > 0:
        raise StoreError(f"no run can start from {words}: the shear has carried the lattice of the cell along.")
    if scene.field is not None and record.scalars:
        names = " and ".join(sorted(record.scalars))
        raise StoreError(f"no run can start from {words}: a start takes over V_m, but not {names}, which are there.")
    N = _nodes(scene_file, int(record.nodes[row].max()))
    has_potential = scene.field is not None and record.V_m is not None
    fields = np.concatenate([record.x[row], record.V_m[row][..., None]], -1) if has_potential else record.x[row]
    even = _evenly(finer_rows(fields[None], N)[0])
    try:
        V_m = even[..., 2] if has_potential else None
        scene = Scene(even[..., :2], scene.bending, scene.field, scene.flow, V_m, scene.viscosity_ratio, scene.cell)
    except ValueError as error:
        raise StoreError(f"no run can start from {words}: {error}") from None
    return scene, words


def _row(record: Record, path: str | Path, at: float | None) -> int:
    if not len(record.t):
        raise StoreError(f"{path} has no saved time to start from.")
    if at is None:
        return len(record.t) - 1
    if not record.t[0] <= at <= record.t[-1]:
        raise StoreError(str(refusal("at", at, f"a time in [0, {record.t[-1]:.12g}], which {path} has")))
    return int(np.argmin(np.abs(record.t - at)))


def _nodes(scene_file: SceneFile, used: int) -> int:
    if scene_file.numerics.nodes != "auto":
        return scene_file.numerics.nodes
    sizes = sizes_up_to(used)
    return next((N for N in sizes if used <= N), sizes[-1])


def _evenly(fields: np.ndarray):
    """Returns x and V_m (M, N, 2 or 3) on nodes equispaced in arc length. Interpolated nodes are not equispaced."""
    uneven = starts.is_uneven(fields[..., :2])
    return jnp.stack(
        [
            evaluate(jnp.asarray(f), equispaced_parameters(jnp.asarray(f[:, :2]), len(f))) if bad else jnp.asarray(f)
            for f, bad in zip(fields, uneven, strict=True)
        ]
    )
