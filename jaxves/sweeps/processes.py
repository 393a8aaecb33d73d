"""The processes that work on one sweep together, under `jax.distributed`: who takes which case, and who waits for whom.

They share a file system. Each writes its own file (HDF5 has one writer); the first takes them into the one file.
"""

from pathlib import Path

import jax
import numpy as np

_WEEK = 7 * 24 * 3600 * 1000  # milliseconds
_BARRIER = "jax._src.distributed.global_state.client.wait_at_barrier"
_KNOWN_JAX = "0.10.2"  # has it


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
    """Returns when all processes have come here; each place where they wait needs a name of its own.

    Raises RuntimeError if this release of JAX does not have the barrier, which is not part of its public interface.
    A lone process does not need it.
    """
    if jax.process_count() > 1:
        # JAX's public barrier is a collective, which on CPU gives up after half a minute; here processes may be
        # hours apart. The service behind `jax.distributed` has one with a time limit of one's own.
        try:
            from jax._src.distributed import global_state

            barrier = global_state.client.wait_at_barrier
        except (ImportError, AttributeError) as error:
            raise RuntimeError(
                f"The processes of a sweep cannot wait for each other: jax {jax.__version__} lacks {_BARRIER} "
                f"({error}); use one process, or python -m pip install jax=={_KNOWN_JAX}"
            ) from error
        barrier(name, timeout_in_ms=_WEEK)
