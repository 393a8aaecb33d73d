"""The contents of the file of a sweep, and functions that read it. `sweep_writer` writes it.

There is one dimension for each axis, with its values as coordinate, or one dimension called "case". Names and scales
are those of netCDF, so that xarray opens the file. `/status` is "pending" for a case that is not computed yet. It is
"again" for a case that needs more steps than the first pass allows, until the second pass has computed it.
"""

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

import jaxves

from ..base import status
from ..observables import classes
from . import exports, labelled
from .hdf5 import StoreError, datasets_below, named_errors, opened, refuse_special
from .views import card

SCHEMA_VERSION = 1
PENDING, AGAIN, REFUSED, SKIPPED = "pending", "again", "refused", "skipped"
DUE = (PENDING, AGAIN)
_EXPLAINED = {
    PENDING: "not computed yet; continue with resume=True (--resume)",
    AGAIN: "needs more steps and waits for the second pass; continue with resume=True (--resume)",
    SKIPPED: "not computed, because its cell was not refined",
}


@dataclass(frozen=True)
class Variable:
    """A dataset of the file: units, name in words, dimensions after those of the grid, and type."""

    units: str
    long_name: str
    dims: tuple[str, ...] = ()
    dtype: str = "f8"


@dataclass(frozen=True, repr=False)
class SweepRecord:
    """The contents of the file of a sweep. Arrays have the shape of the grid, followed by that of one case.

    `coordinates` has dimensions and values of each number that varies. `classes` is None without a field, and `motions`
    without a constant shear flow. `computed` is the number of cases that the call of `sweep` which returned this record
    has computed.
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
    motions: np.ndarray | None = None

    @property
    def changing(self) -> np.ndarray:
        """Which complete cases change at `t_end` so fast that their class is not final. False where this is unknown."""
        trend = self.data.get("deformation_trend")
        if trend is None:
            return np.zeros(self.status.shape, bool)
        moves = (np.abs(trend) > classes.THRESHOLD).reshape(*self.status.shape, -1).any(axis=-1)
        return moves & (self.status == status.WORDS[status.COMPLETE])

    def counts(self) -> dict[str, int]:
        """Returns the number of cases by status, the most frequent first."""
        words, counts = np.unique(self.status, return_counts=True)
        return {str(words[i]): int(counts[i]) for i in np.argsort(-counts)}

    def summary(self) -> str:
        """Returns one line: the numbers that vary, and how many cases have which status."""
        size = " × ".join(map(str, self.status.shape))
        words = ", ".join(f"{count} {word}" for word, count in self.counts().items())
        return f"{size} cases of {', '.join(self.coordinates)}: {words}"

    def __repr__(self) -> str:
        return f"<SweepRecord: {self.summary()}>"

    def _repr_html_(self) -> str:
        """Returns the card that a notebook shows."""
        return card("SweepRecord", self.summary(), "", self.plot())

    def plot(self, what: str | None = None, **how: Any) -> Any:
        """Draws a figure and returns it.

        Args:
            what: "phases", "map" or "curves"; by default what suits the sweep.
            how: the options of `phase_diagram`, `quantity_map` or `curves` in `jaxves.plots`.
        """
        return jaxves.plots.draw_sweep(self, what, **how)

    def to_xarray(self) -> Any:
        """Returns an `xarray.Dataset` of all quantities, with the numbers that vary as coordinates."""
        return labelled.dataset_of_sweep(self)

    def to_csv(self, path: str | os.PathLike) -> None:
        """Writes a table with one row for each case."""
        exports.sweep_to_csv(self, Path(path))

    def at(self, index: tuple[int, ...]) -> dict[str, float]:
        """Returns the numbers of one case, by name."""
        place = dict(zip(self.dims, index, strict=True))
        return {name: float(v[tuple(place[dim] for dim in dims)]) for name, (dims, v) in self.coordinates.items()}


def class_word(codes: np.ndarray) -> str:
    """Returns the classes of the vesicles of one case: "POP", or "P+O" for two vesicles."""
    return "+".join(classes.NAMES[int(code)] for code in codes)


def count_computed(words: np.ndarray) -> int:
    """Returns how many of these cases have been computed, with any status."""
    return int(np.sum(~np.isin(words, [*DUE, REFUSED, SKIPPED])))


def reason(word: str) -> str:
    """Returns why a case has no result, or what is wrong with its result."""
    return _EXPLAINED.get(word) or status.ADVICE.get(word, "")


def is_sweep(path: str | os.PathLike) -> bool:
    """Returns whether this is the file of a sweep; False if it does not exist."""
    if not Path(path).is_file():
        return False
    try:
        with opened(Path(path), "r") as file:
            return file.attrs.get("kind") == "sweep"
    except OSError:
        return False


def read_sweep(path: str | os.PathLike) -> SweepRecord:
    """Reads the file of a sweep, except time series and shapes.

    The sweep may be complete, interrupted or still running.

    Raises:
        StoreError: the file does not exist, is not the file of a sweep, or has a later version.
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
            motions=file["motion"][...].astype(str) if "motion" in file else None,
            passes=data.pop("passes"),
            reasons=reasons.reshape(words.shape),
            data=data,
            labels={name: (file[name].attrs["units"], file[name].attrs["long_name"]) for name in data},
            attributes=attributes,
        )


class Known(NamedTuple):
    """Status and class of each case in the file, in C order of the grid."""

    status: np.ndarray
    classes: np.ndarray | None


def progress(path: Path) -> Known:
    """Reads how far the sweep has advanced; may be used while the file is written."""
    with named_errors("read", path), open_sweep(path, "r") as file:
        classes = file["class"][...].astype(str).ravel() if "class" in file else None
        return Known(file["status"][...].astype(str).ravel(), classes)


def free_bytes(path: Path) -> int:
    """Returns the free space on the disk of the file."""
    return shutil.disk_usage(path.absolute().parent).free


def history(path: str | os.PathLike, name: str, index: tuple[int, ...]) -> np.ndarray:
    """Reads a time series of one case: a diagnostic, or x, V_m or tension. The first axis is the saved times.

    Raises:
        StoreError: the file is not the file of a sweep, or does not have this time series.
    """
    with named_errors("read", Path(path)), open_sweep(Path(path), "r") as file:
        if f"history/{name}" not in datasets_below(file):
            raise StoreError(f"{path} keeps no history of {name}.")
        return file[f"history/{name}"][tuple(index)]


def open_sweep(path: Path, mode: str) -> h5py.File:
    """Opens the file of a sweep.

    Raises:
        StoreError: the file does not exist, is not the file of a sweep, or has a later version.
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
