"""HDF5 functions for result files: safe replacement of files, datasets with labels and allocated space.

Axes are named as in netCDF: the datasets `/t`, `/vesicle`, `/node`, `/xy` (and `/ab`, the second axis of a tensor) are
attached to the others as dimension scales, so that xarray and HDFView label the axes. A group has soft links to the
scales of its datasets. It therefore has its coordinates also when it is opened without the rest of the file.
"""

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

_CHUNK_BYTES = 2**18
_SCALES = {
    "vesicle": "vesicle",
    "node": "node on its vesicle",
    "xy": "component",
    "ab": "second component of a tensor",
}


class StoreError(Exception):
    """A result file cannot be written or read. The message is one line that names the file."""


def refuse_existing(path: Path, force: bool, *, resumable: bool = False) -> None:
    """Raises StoreError if the file exists, unless `force`. `resumable` says whether the caller can also continue it.

    The message has the words of Python and of the command line, as both end here.
    """
    if path.exists() and not force:
        other = " or continue it with resume=True (--resume)" if resumable else ""
        raise StoreError(f"{path} exists already: replace it with force=True (--force on the command line){other}.")


class Description(NamedTuple):
    """A description of a dataset: units, name in words, and axes, of which the first is "t"."""

    units: str
    long_name: str
    dims: tuple[str, ...]
    dtype: type = float


@contextmanager
def named_errors(verb: str, path: Path) -> Iterator[None]:
    """Turns errors of the disk, which HDF5 reports in several lines, into a StoreError "cannot `verb` `path`: …"."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        found = re.search(r"error message = '([^']+)'", str(error))
        reason = found[1] if found else getattr(error, "strerror", None) or str(error)
        raise StoreError(f"cannot {verb} {path}: {' '.join(reason.split())}") from error


def opened(path: Path, mode: str) -> h5py.File:
    """Opens an HDF5 file without the lock of HDF5.

    With that lock, other programs could not open the file of a running run, and a run could not continue while a
    notebook has its file open. `ownership` ensures that a file has one writer.
    """
    try:
        return h5py.File(path, mode, locking=False)
    except OSError as error:
        if "locking flag" not in str(error):
            raise
        return h5py.File(path, mode)  # this process has the file open with a lock, and HDF5 requires the same again


class OpenFile:
    """A file that is kept open for writing; a context manager."""

    path: Path
    _file: h5py.File

    def close(self) -> None:
        """Closes the file. What was written is in the file also without this."""
        with named_errors("write", self.path):
            self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()


def refuse_special(path: Path) -> None:
    """Raises StoreError if the path is a folder, or a device such as /dev/null."""
    if path.is_dir():
        raise StoreError(f"{path} is a folder, expected the name of a file.")
    if path.exists() and not path.is_file():
        raise StoreError(f"{path} is no ordinary file, expected the name of one.")


@contextmanager
def replacing(path: Path, copy: bool = False) -> Iterator[h5py.File]:
    """Yields a new file, or a copy of the old one. It gets the name `path` when it is complete and on the disk.

    Raises:
        StoreError: the path is a folder or a device.
    """
    refuse_special(path)
    part = path.with_name(path.name + ".part")
    try:
        if copy:
            shutil.copyfile(path, part)
        with h5py.File(part, "r+" if copy else "w") as file:
            yield file
        with open(part, "rb+") as written:
            os.fsync(written.fileno())
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def create_datasets(file: h5py.File, datasets: dict[str, Description], sizes: dict[str, int]) -> None:
    """Creates empty datasets with all their space allocated, and the scales of their axes with these sizes."""
    early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    for name, described in datasets.items():
        shape = tuple(sizes[dim] for dim in described.dims)
        rows = min(max(1, _CHUNK_BYTES // (8 * prod(shape[1:]))), shape[0])
        file.create_dataset(
            name,
            shape,
            described.dtype,
            chunks=(rows, *shape[1:]),
            maxshape=(None, *shape[1:]),
            fillvalue=np.nan if described.dtype is float else 0,
            dcpl=early,
        )
    file["t"].make_scale("t")
    for dim in sorted({dim for described in datasets.values() for dim in described.dims} - {"t"}):
        values = np.arange(sizes[dim]) if dim in ("vesicle", "node") else np.array(["x", "y"], h5py.string_dtype())
        file[dim] = values
        file[dim].make_scale(dim)
        file[dim].attrs.update(units="1", long_name=_SCALES[dim])
    for name, described in datasets.items():
        _label(file, file[name], described.units, described.long_name, described.dims)
    if "diagnostics" in file:
        link_scales(file["diagnostics"])


def link_scales(group: h5py.Group) -> None:
    """Adds links to a group, to the scales of its datasets."""
    for dataset in datasets_below(group).values():
        for dim in (axis[0].name.removeprefix("/") for axis in dataset.dims):
            if dim not in group:
                group[dim] = h5py.SoftLink(f"/{dim}")


def _label(file: h5py.File, dataset: h5py.Dataset, units: str, long_name: str, dims) -> None:
    dataset.attrs.update(units=units, long_name=long_name)
    if not dataset.is_scale:
        for axis, dim in zip(dataset.dims, dims, strict=True):
            axis.attach_scale(file[dim])


def create_average(file: h5py.File, name: str, value) -> None:
    """Creates the time average of a diagnostic, with the same units and axes."""
    of = file[f"diagnostics/{name}"]
    dims = [axis[0].name.removeprefix("/") for axis in of.dims][1:]
    dataset = file.create_dataset(f"averages/{name}", data=value)
    _label(file, dataset, of.attrs["units"], f"time average of {of.attrs['long_name']}", dims)
    link_scales(file["averages"])


def delete_averages(file: h5py.File) -> None:
    """Deletes the time averages, which are computed again at the end of a continued run."""
    for dataset in datasets_below(file["averages"]).values():
        for axis in dataset.dims:
            axis.detach_scale(axis[0])  # otherwise the scale would still refer to the dataset
    del file["averages"]


def datasets_below(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """Returns all datasets below a group, by their paths relative to it."""
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            found[name] = item

    group.visititems(visit)
    return found


def histories(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Returns the datasets with one row per saved time, by their paths."""
    return {name: dataset for name, dataset in datasets_below(file).items() if dataset.maxshape[:1] == (None,)}
