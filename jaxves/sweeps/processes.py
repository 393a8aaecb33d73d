"""Several processes that compute one sweep under `jax.distributed`: distribution of the cases and synchronisation.

The processes share a file system. An HDF5 file has only one writer, so each process writes its own file. The first
process merges them into the file of the sweep.
"""

from pathlib import Path

import jax
import numpy as np

from ..base.jax_parts import barrier

_WEEK = 7 * 24 * 3600 * 1000  # milliseconds


def is_first() -> bool:
    """Returns whether this process writes the file of the sweep; a single process does."""
    return jax.process_index() == 0


def share(cases: np.ndarray, block: int) -> np.ndarray:
    """Returns the cases of this process. Blocks of neighbouring cases are dealt to the processes in turn."""
    blocks = np.arange(len(cases)) // block
    return cases[blocks % jax.process_count() == jax.process_index()]


def own_file(path: Path) -> Path:
    """Returns the file that this process writes."""
    return path if jax.process_count() == 1 else _of_process(path, str(jax.process_index()))


def other_files(path: Path) -> list[Path]:
    """Returns the files of all processes beside the file of the sweep, also those of an interrupted sweep."""
    return sorted(path.parent.glob(_of_process(path, "*").name)) if path.parent.is_dir() else []


def _of_process(path: Path, number: str) -> Path:
    return path.with_name(f"{path.name}.process-{number}")


def wait(name: str) -> None:
    """Waits until all processes have called this function. Each call needs a different `name`.

    A single process does not wait.

    Raises:
        RuntimeError: this release of JAX does not have the barrier (`base.jax_parts`).
    """
    if jax.process_count() > 1:
        barrier()(name, timeout_in_ms=_WEEK)  # processes may arrive here hours apart
