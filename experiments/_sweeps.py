"""Folders and devices for experiments that use sweeps.

Import this module before JAX starts: it makes one device for each core.
"""

import os
import tempfile
from pathlib import Path

import numpy as np

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import jaxves
from jaxves.results.sweep_store import SweepRecord

FOLDER = Path(os.environ.get("JAXVES_SWEEPS", "sweeps"))
TOY = Path(tempfile.gettempdir()) / "jaxves-quick"  # of runs that only show that they run


def swept(tables: dict, name: str, folder: Path | None = None) -> SweepRecord:
    """Runs the sweep of these tables; continues its file if that exists."""
    resume = folder is None and (FOLDER / f"{name}.h5").exists()
    folder = FOLDER if folder is None else folder
    folder.mkdir(parents=True, exist_ok=True)
    return jaxves.sweep(tables, folder / f"{name}.h5", resume=resume, force=not resume, progress=_Told(name))


class _Told:
    """Prints a line from time to time."""

    def __init__(self, name: str):
        self.name, self.said = name, -1

    def __call__(self, done, total, text):
        if total and (tenth := 10 * done // total) != self.said:
            self.said = tenth
            print(f"{self.name}: {done} of {total} {text}", flush=True)


def listed(values: np.ndarray) -> list:
    """Returns arrays as lists, for storing."""
    return np.asarray(values).tolist()
