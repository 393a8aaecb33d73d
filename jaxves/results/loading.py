"""Reads a result file, of a run or of a sweep."""

import os

from .run_store import Record, read_result
from .sweep_store import SweepRecord, is_sweep, read_sweep


def load(path: str | os.PathLike) -> Record | SweepRecord:
    """Returns the contents of a result file: a `Record` for a run, a `SweepRecord` for a sweep.

    Raises:
        StoreError: the file does not exist, is not a result file, or has a later version.
    """
    return read_sweep(path) if is_sweep(path) else read_result(path)
