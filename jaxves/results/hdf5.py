"""HDF5 below result files: files replaced as a whole, datasets with labels and room to fill.

Names are netCDF's: the datasets `/t`, `/vesicle`, `/node`, `/xy` (and `/ab`, second axis of a tensor) are attached
to the others as dimension scales, so that xarray and HDFView label the axes. A group has soft
links to the scales of its datasets, so that it has times and other coordinates when it is opened alone, too.
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
    """A result file cannot be written or read; the message is one line which names the file."""


class Description(NamedTuple):
    """What a dataset holds: its units, its name in words, and its axes, the first of them "t"."""

    units: str
    long_name: str
    dims: tuple[str, ...]
    dtype: type = float


@contextmanager
def named_errors(verb: str, path: Path) -> Iterator[None]:
    """Turns failures of the disk, which HDF5 words over several lines, into a StoreError: "cannot `verb` `path`: …"."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        found = re.search(r"error message = '([^']+)'", str(error))
        reason = found[1] if found else getattr(error, "strerror", None) or str(error)
        raise StoreError(f"cannot {verb} {path}: {' '.join(reason.split())}") from error


def opened(path: Path, mode: str) -> h5py.File:
    """The HDF5 file, without HDF5's own lock.

    That would keep other programs from opening the file of a run that goes on, and a notebook that has a file open from
    having its run continued. That a file has one writer is the matter of `ownership`.
    """
    try:
        return h5py.File(path, mode, locking=False)
    except OSError as error:
        if "locking flag" not in str(error):
            raise
        return h5py.File(path, mode)  # this process has it open already, with a lock, and HDF5 wants the same again


class OpenFile:
    """A file held open for adding to it: a context manager."""

    path: Path
    _file: h5py.File

    def close(self) -> None:
        """Closes the file; what was written is in it with or without this."""
        with named_errors("write", self.path):
            self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()


def refuse_special(path: Path) -> None:
    """Raises StoreError for what is there and no file: a folder, or a device such as /dev/null."""
    if path.is_dir():
        raise StoreError(f"{path} is a folder, expected the name of a file.")
    if path.exists() and not path.is_file():
        raise StoreError(f"{path} is no ordinary file, expected the name of one.")


@contextmanager
def replacing(path: Path, copy: bool = False) -> Iterator[h5py.File]:
    """A new file, or a copy of the old one, which takes the name `path` once it is complete and on the disk.

    Raises:
        StoreError: the name is that of a folder, a device or the like, which nothing may replace.
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
    """Empty datasets with all their space, and the scales of their axes, of these sizes."""
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
    """Gives a group links to those scales of the root that its datasets are attached to."""
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
    """The time average of a diagnostic, labelled like it."""
    of = file[f"diagnostics/{name}"]
    dims = [axis[0].name.removeprefix("/") for axis in of.dims][1:]
    dataset = file.create_dataset(f"averages/{name}", data=value)
    _label(file, dataset, of.attrs["units"], f"time average of {of.attrs['long_name']}", dims)
    link_scales(file["averages"])


def delete_averages(file: h5py.File) -> None:
    """Takes them out, to be made anew."""
    for dataset in datasets_below(file["averages"]).values():
        for axis in dataset.dims:
            axis.detach_scale(axis[0])  # or the scale would go on referring to it
    del file["averages"]


def datasets_below(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """Every dataset below a group, by its path in it."""
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            found[name] = item

    group.visititems(visit)
    return found


def histories(file: h5py.File) -> dict[str, h5py.Dataset]:
    """The datasets with one row per saved time: those which can grow."""
    return {name: dataset for name, dataset in datasets_below(file).items() if dataset.maxshape[:1] == (None,)}
