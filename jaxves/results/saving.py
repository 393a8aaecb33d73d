"""Writes a result of Python to a file, as a run of a scene file writes it.

The file has no restart state, because nothing continues it. Its scene is not a scene file: curves of Python need not
have a form that a scene file can say.
"""

import os
from typing import Any

import numpy as np
import tomli_w

from ..base import status
from ..observables.rows import Row
from .hdf5 import StoreError
from .ownership import real, writing
from .run_store import datasets_of, description
from .run_writer import Writer
from .views import Viewed

_NOTE = "# The scene was made in Python. It cannot be made again from this text.\n"


def save(result: Viewed, path: str | os.PathLike, *, scene: dict[str, Any], averages: Any, force: bool) -> None:
    """Writes the result of one run to a file that `jaxves.load` reads.

    Args:
        result: the result.
        path: the file.
        scene: what is told of the scene, as tables.
        averages: time averages by name, or None.
        force: replace the file if it exists.

    Raises:
        StoreError: the file exists (without `force`), or cannot be written.
    """
    path, T = real(path), result.saved
    if T == 0:
        raise StoreError(f"{path}: the result has no saved time.")
    with writing(path):
        M, N = np.shape(result.x)[1:3]
        nodes = np.full((T, M), N)
        rows = Row(result.t, result.x, result.tension, result.diagnostics, result.V_m, nodes, None, result.scalars)
        block = {name: values[:T] for name, values in datasets_of(_in_numpy(rows)).items()}
        writer = Writer(
            path,
            scene_text=_NOTE + tomli_w.dumps(scene),
            attributes={"device": "", "symmetry": "", "made_in": "Python"},
            times=block["t"],
            vesicles=M,
            nodes=N,
            datasets={name: description(name, np.ndim(value)) for name, value in block.items()},
            force=force,
        )
        with writer:
            writer.append(block, {})
            writer.finish(result.word, status.ADVICE[result.word], np.nan, _in_numpy(averages), result.certificate)


def _in_numpy(arrays: Any) -> Any:
    """Returns a row, or arrays by name, with arrays of NumPy in place of those of JAX."""
    match arrays:
        case None:
            return None
        case dict():
            return {name: np.asarray(value) for name, value in arrays.items()}
        case Row():
            return Row(*map(_in_numpy, arrays))
    return np.asarray(arrays)
