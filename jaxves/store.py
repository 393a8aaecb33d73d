"""The result file: HDF5 which survives the death of the run that writes it.

The file is changed in two ways only, and a process killed at any moment leaves a whole one:

- *Structure* (the first skeleton, the trimming at the end) is made under the temporary name `….part`, which
  replaces the file when it is complete and on the disk. A full disk spoils the temporary file only.
- *Values* go into space allocated beforehand, so that no index of the file is touched. Rows and restart state are
  flushed first; then one number, the root attribute `saved`, says that they count.

The restart state has two slots, `/restart/a` and `/restart/b`, written in turn; each tells how many rows it belongs
to, and the valid one is the one which agrees with the root's `saved`. Rows and state thus never part.
Blocks are flushed to the operating system, not to the disk: they survive the process, not surely a power cut.

Names are netCDF's: the datasets `/t`, `/vesicle`, `/node`, `/xy` (and `/ab`, second axis of a tensor) are attached
to the others as dimension scales, so that xarray and HDFView label the axes.
"""

import os
import platform
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from math import prod
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

SCHEMA_VERSION = 1
_CHUNK_BYTES = 2**18


class StoreError(Exception):
    """A result file cannot be written or read; the message is one line which names the file."""


class Description(NamedTuple):
    """What a dataset holds: its units, its name in words, and its axes, the first of them "t"."""

    units: str
    long_name: str
    dims: tuple[str, ...]
    dtype: type = float


HISTORY = {
    "t": Description("t_kappa", "time", ("t",)),
    "x": Description("a", "position of the nodes", ("t", "vesicle", "node", "xy")),
    "V_m": Description("a E_inf", "transmembrane potential", ("t", "vesicle", "node")),
    "tension": Description("kappa_B/a^2", "membrane tension", ("t", "vesicle", "node")),
    "nodes": Description("1", "nodes used in the computation", ("t", "vesicle"), int),
}
_SCALES = {
    "vesicle": "vesicle",
    "node": "node on its vesicle",
    "xy": "component",
    "ab": "second component of a tensor",
}


@dataclass(frozen=True)
class Record:
    """What a result file says; arrays have the saved times as their first axis, `averages` has none.

    `t` (T,), `x` (T, M, N, 2), `V_m` (T, M, N) or None without a field, `tension` (T, M, N), `nodes` (T, M).
    """

    t: np.ndarray
    x: np.ndarray
    V_m: np.ndarray | None
    tension: np.ndarray
    nodes: np.ndarray
    diagnostics: dict[str, np.ndarray]
    averages: dict[str, np.ndarray] | None
    attributes: dict
    status: str
    scene: str


class Writer:
    """Writes one run, block after block; a context manager.

    Args:
        path: the file; complete from the start, with rows of NaN, and `status` "running".
        scene_text: the scene as TOML, complete with defaults.
        attributes: further root attributes.
        saves: number of saved times, t = 0 included.
        vesicles: M.
        nodes: N.
        datasets: what is saved, by its path in the file; "t" must be among them, most others are in `HISTORY`.
        force: replace a file which is already there, as soon as the new one is complete.

    Raises:
        StoreError: the file exists and `force` is not set, or it cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike,
        *,
        scene_text: str,
        attributes: dict,
        saves: int,
        vesicles: int,
        nodes: int,
        datasets: dict[str, Description],
        force: bool = False,
    ):
        path = Path(path)
        if path.exists() and not force:
            raise StoreError(f"{path} exists already: use --force to replace it.")
        sizes = {"t": saves, "vesicle": vesicles, "node": nodes, "xy": 2, "ab": 2}
        root = {
            "schema_version": SCHEMA_VERSION,
            "scene": scene_text,
            "status": "running",
            "advice": "",
            "saved": 0,
            "saves": saves,
            "wall_time": 0.0,
            "version": version("jaxves"),
            **{f"{package}_version": version(package) for package in ("jax", "jaxlib", "numpy")},
            "platform": platform.platform(),
        }
        with named_errors("write", path), replacing(path) as file:
            file.attrs.update(attributes | root)
            _create_datasets(file, datasets, sizes)
            for slot in ("restart/a", "restart/b"):
                _create_slot(file, slot, {})
        self._open(path)

    def _open(self, path: Path) -> None:
        self.path = path
        with named_errors("write", path):
            self._file = h5py.File(path, "r+")
        self.saved = int(self._file.attrs["saved"])
        self._rows = _histories(self._file)
        self._valid, self._free = _slots(self._file)

    def append(self, block: dict[str, np.ndarray], restart: dict[str, np.ndarray]) -> None:
        """Adds saved times and the state to continue from, both or neither; done when this returns.

        Args:
            block: all datasets, each with the new saved times as its first axis.
            restart: the leaves of the state after the last of these times; {} if nobody will continue.

        Raises:
            ValueError: names or shapes are not those of the file.
            StoreError: the file cannot be written.
        """
        saved = self.saved + self._checked_count(block)
        with named_errors("write", self.path):
            wanted = {name: (leaf.shape, leaf.dtype) for name, leaf in restart.items()}
            if wanted != {name: (leaf.shape, leaf.dtype) for name, leaf in _datasets(self._free).items()}:
                stale = [slot.name for slot in ((self._free,) if self.saved else (self._free, self._valid))]
                with self._rebuilding() as file:
                    for name in stale:
                        del file[name]
                        _create_slot(file, name, restart)
            for name, dataset in self._rows.items():
                dataset[self.saved : saved] = block[name]
            for name, leaf in restart.items():
                self._free[name][...] = leaf
            self._free.attrs.modify("saved", saved)
            self._file.flush()
            self._file.attrs.modify("saved", saved)
            self._file.flush()
        self._free, self._valid = self._valid, self._free
        self.saved = saved

    def finish(self, status: str, advice: str, wall_time: float, averages: dict[str, np.ndarray] | None = None) -> None:
        """Cuts off the rows never written and says how the run ended.

        `wall_time` in seconds adds to that of earlier parts of a resumed run; `averages` over time are
        named like the diagnostics they belong to.
        """
        with named_errors("write", self.path), self._rebuilding() as file:
            # The file's own count: an interrupt may have come between its commit and `self.saved`.
            for dataset in _histories(file).values():
                dataset.resize(file.attrs["saved"], axis=0)
            for name, value in (averages or {}).items():
                _create_average(file, name, value)
            file.attrs.update(status=status, advice=advice, wall_time=file.attrs["wall_time"] + wall_time)

    def close(self) -> None:
        """Closes the file; what was appended is in it with or without this."""
        with named_errors("write", self.path):
            self._file.close()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def _checked_count(self, block) -> int:
        if block.keys() != self._rows.keys():
            raise ValueError(f"A block must hold {sorted(self._rows)}, but holds {sorted(block)}.")
        count = len(block["t"])
        if count == 0:
            raise ValueError("A block must hold at least one saved time, but holds none.")
        room = len(self._rows["t"])
        if self.saved + count > room:
            raise ValueError(f"{self.path} has room for {room} times, but gets {self.saved + count}.")
        for name, dataset in self._rows.items():
            expected = (count, *dataset.shape[1:])
            if np.shape(block[name]) != expected:
                raise ValueError(f"{name} must have shape {expected}, but has {np.shape(block[name])}.")
        return count

    @contextmanager
    def _rebuilding(self):
        self._file.close()
        with replacing(self.path, copy=True) as file:
            yield file
        self._open(self.path)


def resume(path: str | os.PathLike) -> tuple[Writer, dict[str, np.ndarray]]:
    """A writer which goes on after the last saved row, and the leaves of the state to continue from.

    Raises:
        StoreError: not a result file, one without a state, or one which is being written.
    """
    path = Path(path)
    with named_errors("resume", path):
        # Opened for writing although only read: the lock tells a run which is still alive.
        with _open_result(path, "r+") as file:
            valid, _ = _slots(file)
            leaves = {name: np.asarray(leaf[()]) for name, leaf in _datasets(valid).items()}
        if not leaves:
            raise StoreError(f"{path} holds no state to resume from.")
        with replacing(path, copy=True) as file:
            for dataset in _histories(file).values():
                dataset.resize(file.attrs["saves"], axis=0)
            if "averages" in file:
                _delete_averages(file)
            file.attrs.update(status="running", advice="")
    writer = Writer.__new__(Writer)
    writer._open(path)
    return writer, leaves


def load(path: str | os.PathLike) -> Record:
    """Everything a result file says, up to the last saved row; finished, broken off or still being written.

    Raises:
        StoreError: no such file, not a result file, or one of a later version.
    """
    path = Path(path)
    # A run may be holding the lock; since it only adds rows, reading beside it is safe.
    with named_errors("read", path), _open_result(path, "r", locking=False) as file:
        attributes = {k: v.item() if isinstance(v, np.generic) else v for k, v in file.attrs.items()}
        rows = {name: dataset[: attributes["saved"]] for name, dataset in _histories(file).items()}
        diagnostics = {
            name.removeprefix("diagnostics/"): rows[name] for name in rows if name.startswith("diagnostics/")
        }
        averages = {name: dataset[()] for name, dataset in file["averages"].items()} if "averages" in file else None
    return Record(
        **{name: rows.get(name) for name in HISTORY},
        diagnostics=diagnostics,
        averages=averages,
        attributes=attributes,
        status=attributes["status"],
        scene=attributes["scene"],
    )


def _open_result(path: Path, mode: str, **options) -> h5py.File:
    if not path.is_file():
        raise StoreError(f"{path} does not exist.")
    if not h5py.is_hdf5(path):
        raise StoreError(f"{path} is not a jaxves result file.")
    file = h5py.File(path, mode, **options)
    schema = file.attrs.get("schema_version")
    if schema is None or "saved" not in file.attrs:
        file.close()
        raise StoreError(f"{path} is not a jaxves result file.")
    if schema > SCHEMA_VERSION:
        file.close()
        raise StoreError(f"{path} has schema version {schema}, later than {SCHEMA_VERSION}: a newer jaxves reads it.")
    return file


@contextmanager
def named_errors(verb: str, path: Path) -> Iterator[None]:
    """Turns failures of the disk, which HDF5 words over several lines, into a StoreError: "cannot `verb` `path`: …"."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        found = re.search(r"error message = '([^']+)'", str(error))
        reason = found[1] if found else getattr(error, "strerror", None) or str(error)
        raise StoreError(f"cannot {verb} {path}: {' '.join(reason.split())}") from error


@contextmanager
def replacing(path: Path, copy: bool = False) -> Iterator[h5py.File]:
    """A new file, or a copy of the old one, which takes the name `path` once it is complete and on the disk."""
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


def _create_datasets(file: h5py.File, datasets: dict[str, Description], sizes: dict[str, int]) -> None:
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


def _label(file: h5py.File, dataset: h5py.Dataset, units: str, long_name: str, dims) -> None:
    dataset.attrs.update(units=units, long_name=long_name)
    if not dataset.is_scale:
        for axis, dim in zip(dataset.dims, dims, strict=True):
            axis.attach_scale(file[dim])


def _create_average(file: h5py.File, name: str, value) -> None:
    of = file[f"diagnostics/{name}"]
    dims = [axis[0].name.removeprefix("/") for axis in of.dims][1:]
    dataset = file.create_dataset(f"averages/{name}", data=value)
    _label(file, dataset, of.attrs["units"], f"time average of {of.attrs['long_name']}", dims)


def _delete_averages(file: h5py.File) -> None:
    for dataset in file["averages"].values():
        for axis in dataset.dims:
            axis.detach_scale(axis[0])  # or the scale would go on referring to it
    del file["averages"]


def _create_slot(file: h5py.File, name: str, leaves: dict[str, np.ndarray]) -> None:
    """A restart slot with room for `leaves`, valid for no row."""
    slot = file.create_group(name)
    slot.attrs["saved"] = 0
    for leaf_name, leaf in leaves.items():
        slot[leaf_name] = leaf


def _slots(file: h5py.File) -> tuple[h5py.Group, h5py.Group]:
    """The restart slot which belongs to the saved rows, and the other."""
    a, b = file["restart/a"], file["restart/b"]
    return (a, b) if a.attrs["saved"] == file.attrs["saved"] else (b, a)


def _datasets(group: h5py.Group) -> dict[str, h5py.Dataset]:
    """Every dataset below a group, by its path in it."""
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            found[name] = item

    group.visititems(visit)
    return found


def _histories(file: h5py.File) -> dict[str, h5py.Dataset]:
    """The datasets with one row per saved time: those which can grow."""
    return {name: dataset for name, dataset in _datasets(file).items() if dataset.maxshape[:1] == (None,)}
