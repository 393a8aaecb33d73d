"""What the file of a sweep holds, and reading it. `sweep_writer` writes it.

One dimension per axis with its values as coordinate (or one called "case"), netCDF's names and scales, so that xarray
opens it. `/status` is "pending" for a case that is still to come. A case that ran out of steps in the first pass is
called "again" until it has been given the second.
"""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from ..base import status
from ..observables import classes
from .hdf5 import StoreError, datasets_below, named_errors, opened, refuse_special

SCHEMA_VERSION = 1
PENDING, AGAIN, REFUSED, SKIPPED = "pending", "again", "refused", "skipped"
DUE = (PENDING, AGAIN)
_EXPLAINED = {
    PENDING: "not computed yet; continue with --resume",
    AGAIN: "out of steps in the first pass, the second is to come; continue with --resume",
    SKIPPED: "between cases of one class: refinement did not ask for it",
}


@dataclass(frozen=True)
class Variable:
    """A dataset of the file: its units, its name in words, its dimensions after those of the grid, and its type."""

    units: str
    long_name: str
    dims: tuple[str, ...] = ()
    dtype: str = "f8"


@dataclass(frozen=True)
class SweepRecord:
    """What the file of a sweep says; arrays have the shape of the grid, then that of one case.

    `coordinates` holds dimensions and values of each swept number; `classes` is None without a field; `computed` is
    how many cases the sitting that returns this has computed.
    """

    dims: tuple[str, ...]
    coordinates: dict[str, tuple[tuple[str, ...], np.ndarray]]
    status: np.ndarray
    classes: np.ndarray | None
    passes: np.ndarray
    reasons: np.ndarray
    data: dict[str, np.ndarray]
    labels: dict[str, tuple[str, str]]  # units and name in words
    attributes: dict
    computed: int = 0

    def counts(self) -> dict[str, int]:
        """How many cases have which status, the most frequent first."""
        words, counts = np.unique(self.status, return_counts=True)
        return {str(words[i]): int(counts[i]) for i in np.argsort(-counts)}

    def at(self, index: tuple[int, ...]) -> dict[str, float]:
        """The swept numbers of one case."""
        place = dict(zip(self.dims, index, strict=True))
        return {name: float(v[tuple(place[dim] for dim in dims)]) for name, (dims, v) in self.coordinates.items()}


def class_word(codes: np.ndarray) -> str:
    """The classes of the vesicles of one case: "POP", or "P+O" of two."""
    return "+".join(classes.NAMES[int(code)] for code in codes)


def count_computed(words: np.ndarray) -> int:
    """How many of these cases have been computed, to whatever end."""
    return int(np.sum(~np.isin(words, [*DUE, REFUSED, SKIPPED])))


def reason(word: str) -> str:
    """Why a case has no result, or why it may be no good."""
    return _EXPLAINED.get(word) or status.ADVICE.get(word, "")


def is_sweep(path: str | os.PathLike) -> bool:
    """Whether this is the file of a sweep; False for whatever else, and for no file."""
    if not Path(path).is_file():
        return False
    try:
        with opened(Path(path), "r") as file:
            return file.attrs.get("kind") == "sweep"
    except OSError:
        return False


def read_sweep(path: str | os.PathLike) -> SweepRecord:
    """All but histories and shapes; of a sweep finished, broken off, or still going on.

    Raises:
        StoreError: no such file, not that of a sweep, or one of a later version.
    """
    path = Path(path)
    with named_errors("read", path), open_sweep(path, "r") as file:
        attributes = {k: v.item() if isinstance(v, np.generic) else v for k, v in file.attrs.items()}
        attributes["sweep"] = file["sweep"].asstr()[()]
        dims = tuple(attributes["dims"])
        words = file["status"][...].astype(str)
        complaints = file["complaint"].asstr()[...] if "complaint" in file else np.full(words.shape, "")
        reasons = np.array(
            [said or reason(word) for word, said in zip(words.ravel(), complaints.ravel(), strict=True)], object
        )
        names = [name for name in datasets_below(file) if "per_case" in file[name].attrs and "/" not in name]
        data = {name: file[name][...] for name in names if file[name].dtype.kind != "S"}
        coordinates = {}
        for name in file.attrs["coordinates"].split() if dims == ("case",) else dims:
            coordinates[name] = dims if dims == ("case",) else (name,), file[name][...]
        return SweepRecord(
            dims=dims,
            coordinates=coordinates,
            status=words,
            classes=file["class"][...].astype(str) if "class" in file else None,
            passes=data.pop("passes"),
            reasons=reasons.reshape(words.shape),
            data=data,
            labels={name: (file[name].attrs["units"], file[name].attrs["long_name"]) for name in data},
            attributes=attributes,
        )


class Known(NamedTuple):
    """What of each case is in the file, in C order of the grid."""

    status: np.ndarray
    classes: np.ndarray | None


def progress(path: Path) -> Known:
    """How far the sweep has come; beside its writer."""
    with named_errors("read", path), open_sweep(path, "r") as file:
        classes = file["class"][...].astype(str).ravel() if "class" in file else None
        return Known(file["status"][...].astype(str).ravel(), classes)


def free_bytes(path: Path) -> int:
    """On the disk where the file is or will be."""
    return shutil.disk_usage(path.absolute().parent).free


def history(path: str | os.PathLike, name: str, index: tuple[int, ...]) -> np.ndarray:
    """What was kept over time of one case: a diagnostic, or x, V_m, tension; saved times first.

    Raises:
        StoreError: not the file of a sweep, or one that keeps no such history.
    """
    with named_errors("read", Path(path)), open_sweep(Path(path), "r") as file:
        if f"history/{name}" not in datasets_below(file):
            raise StoreError(f"{path} keeps no history of {name}.")
        return file[f"history/{name}"][tuple(index)]


def open_sweep(path: Path, mode: str) -> h5py.File:
    """The open file of a sweep.

    Raises:
        StoreError: no such file, not that of a sweep, or one of a later version.
    """
    refuse_special(path)
    if not path.exists():
        raise StoreError(f"{path} does not exist.")
    if not h5py.is_hdf5(path):
        raise StoreError(f"{path} is not the file of a sweep.")
    file = opened(path, mode)
    if file.attrs.get("kind") != "sweep":
        file.close()
        raise StoreError(f"{path} is not the file of a sweep.")
    if file.attrs["schema_version"] > SCHEMA_VERSION:
        file.close()
        raise StoreError(f"{path} has a later schema version than {SCHEMA_VERSION}: a newer jaxves reads it.")
    return file
