"""Writes results for other programs: tables in CSV, and membranes in the files of VTK, which ParaView opens.

Files of VTK are written with meshio. It is small and has no compiled parts; VTK itself would be a hundred megabytes.
"""

import csv
import itertools
from pathlib import Path
from typing import Any

import numpy as np

from ..observables.quantities import described
from .hdf5 import StoreError, named_errors

_ENTRY = '    <DataSet timestep="{:.12g}" file="{}"/>\n'


def _columns(name: str, values: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Returns the columns of an array whose first axis is the rows, such as deformation[0]."""
    flat = np.asarray(values).reshape(len(values), -1)
    indices = itertools.product(*(range(size) for size in np.shape(values)[1:]))
    return [(name + "".join(f"[{i}]" for i in index), flat[:, k]) for k, index in enumerate(indices)]


def _write_table(path: Path, columns: list[tuple[str, np.ndarray]]) -> None:
    with named_errors("write", path), open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([name for name, _ in columns])
        writer.writerows(zip(*(values.tolist() for _, values in columns), strict=True))


def run_to_csv(record: Any, path: Path) -> None:
    """Writes the diagnostics of a run. The heading of a column is its name and, in brackets, its unit."""
    columns = [("t (t_kappa)", np.asarray(record.t)[: record.saved])]
    for name, values in record.diagnostics.items():
        units = described(name, np.ndim(values)).units
        found = _columns(name, np.asarray(values)[: record.saved])
        columns += [(label if units in ("", "1") else f"{label} ({units})", column) for label, column in found]
    _write_table(path, columns)


def sweep_to_csv(record: Any, path: Path) -> None:
    """Writes one row for each case of a sweep: its numbers, its status and class, and its quantities."""
    shape, rank = record.status.shape, record.status.ndim
    columns = []
    for name, (dims, values) in record.coordinates.items():
        axes = [record.dims.index(dim) for dim in dims]
        placed = np.expand_dims(values, [axis for axis in range(rank) if axis not in axes])
        columns.append((name, np.broadcast_to(placed, shape).ravel()))
    columns.append(("status", record.status.ravel()))
    if record.classes is not None:
        columns.append(("class", record.classes.ravel()))
    if record.motions is not None:
        columns.append(("motion", record.motions.ravel()))
    for name, values in record.data.items():
        columns += _columns(name, values.reshape(-1, *values.shape[rank:]))
    _write_table(path, columns)


def run_to_vtk(record: Any, path: Path) -> None:
    """Writes PATH.pvd, which lists the times, and a file PATH_0000.vtu of closed lines for each saved time.

    Raises:
        StoreError: the name does not end in .pvd, or a file cannot be written.
        ImportError: meshio is not installed.
    """
    try:
        import meshio
    except ImportError:
        raise ImportError('Files for ParaView need meshio: python -m pip install "jaxves[vtk]"') from None
    if path.suffix != ".pvd":
        raise StoreError(f"{path}: files for ParaView begin with one whose name ends in .pvd.")
    M, N = np.shape(record.x)[1:3]
    node = np.arange(M * N).reshape(M, N)
    lines = [("line", np.stack([node, np.roll(node, -1, axis=1)], axis=-1).reshape(-1, 2))]
    entries = ""
    with named_errors("write", path):
        for row in range(record.saved):
            points = np.concatenate([np.asarray(record.x[row]).reshape(-1, 2), np.zeros((M * N, 1))], axis=1)
            data = {"tension": np.asarray(record.tension[row]).ravel(), "vesicle": np.repeat(np.arange(M), N)}
            if record.V_m is not None:
                data["V_m"] = np.asarray(record.V_m[row]).ravel()
            target = path.with_name(f"{path.stem}_{row:04d}.vtu")
            meshio.Mesh(points, lines, point_data=data).write(target)
            entries += _ENTRY.format(float(record.t[row]), target.name)
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        path.write_text(f"{head}{entries}  </Collection>\n</VTKFile>\n", encoding="utf-8")
