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
    """The sweep of these tables; without a folder of its own, from its file where that holds some of it already."""
    resume = folder is None and (FOLDER / f"{name}.h5").exists()
    folder = FOLDER if folder is None else folder
    folder.mkdir(parents=True, exist_ok=True)
    return jaxves.sweep(tables, folder / f"{name}.h5", resume=resume, force=not resume, progress=_Told(name))


class _Told:
    """A line now and then."""

    def __init__(self, name: str):
        self.name, self.said = name, -1

    def __call__(self, done, total, text):
        if total and (tenth := 10 * done // total) != self.said:
            self.said = tenth
            print(f"{self.name}: {done} of {total} {text}", flush=True)


def listed(values: np.ndarray) -> list:
    """Arrays as lists, for storing."""
    return np.asarray(values).tolist()
