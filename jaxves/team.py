"""The processes that work on one sweep together, under `jax.distributed`: who takes which case, and who waits for whom.

They share a file system. Each writes its own file (HDF5 has one writer); the first takes them into the one file.
"""

from pathlib import Path

import jax
import numpy as np
from jax._src import distributed

_WEEK = 7 * 24 * 3600 * 1000  # milliseconds


def is_first() -> bool:
    """Whether this process keeps the file of the sweep; a lone one does."""
    return jax.process_index() == 0


def share(cases: np.ndarray, block: int) -> np.ndarray:
    """The part of the cases that this process takes: every so many blocks of neighbours."""
    blocks = np.arange(len(cases)) // block
    return cases[blocks % jax.process_count() == jax.process_index()]


def own_file(path: Path) -> Path:
    """Where this process writes."""
    return path if jax.process_count() == 1 else _of_process(path, str(jax.process_index()))


def other_files(path: Path) -> list[Path]:
    """What processes have left beside the file of the sweep, now or before it broke off."""
    return sorted(path.parent.glob(_of_process(path, "*").name)) if path.parent.is_dir() else []


def _of_process(path: Path, number: str) -> Path:
    return path.with_name(f"{path.name}.process-{number}")


def wait(name: str) -> None:
    """Until all processes have come here; each place where they wait needs a name of its own."""
    if jax.process_count() > 1:
        # JAX's public barrier is a collective, which on CPU gives up after half a minute; here processes may be
        # hours apart. The service behind `jax.distributed` has one with a time limit of one's own.
        distributed.global_state.client.wait_at_barrier(name, timeout_in_ms=_WEEK)
