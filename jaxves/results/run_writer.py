"""Writes the result file of a run in HDF5. The file stays valid if the process is killed.

The file is changed in only two ways. A process that is killed at any moment leaves a valid file:

- *Structure* (the empty file at the start, the removal of unused rows at the end) is written under the temporary name
  `….part`. It replaces the file when it is complete and on the disk. A full disk damages only the temporary file.
- *Values* are written into space that was allocated before, so no index of the file changes. Rows and restart state are
  flushed first. Then the root attribute `saved` is increased, which makes them valid.

The restart state has two slots, which are written in turn. Each has the number of rows it belongs to. The valid slot is
the one that agrees with `saved` of the root (`restart`), so rows and state always belong together. Blocks are flushed
to the operating system but not to the disk. They survive the end of the process, but not always a power cut.
"""

import os
import platform
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np

from ..observables import certificate
from ..observables.rows import Row
from . import restart
from .hdf5 import (
    Description,
    OpenFile,
    create_average,
    create_datasets,
    delete_averages,
    histories,
    link_scales,
    named_errors,
    opened,
    refuse_existing,
    replacing,
)
from .ownership import check_in_place
from .run_store import SCHEMA_VERSION, open_result, row_of


class Writer(OpenFile):
    """Writes one run, block by block; a context manager.

    Args:
        path: the file. It has all rows from the start, filled with NaN, and `status` "running".
        scene_text: the scene as TOML, with all defaults.
        attributes: further root attributes.
        times: all saved times (T,) of a complete run, with t = 0.
        vesicles: M.
        nodes: N.
        datasets: descriptions of the datasets, by path in the file. "t" must be among them. `run_store.HISTORY` has
        most. force: replace an existing file, as soon as the new one is complete.

    Raises:
        StoreError: the file exists and `force` is not set, or it cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike,
        *,
        scene_text: str,
        attributes: dict,
        times: np.ndarray,
        vesicles: int,
        nodes: int,
        datasets: dict[str, Description],
        force: bool = False,
    ):
        path = Path(path)
        refuse_existing(path, force)
        sizes = {"t": len(times), "vesicle": vesicles, "node": nodes, "xy": 2, "ab": 2}
        root = {
            "schema_version": SCHEMA_VERSION,
            "scene": scene_text,
            "status": "running",
            "advice": "",
            "saved": 0,
            "saves": len(times),
            "wall_time": 0.0,
            "version": version("jaxves"),
            **{f"{package}_version": version(package) for package in ("jax", "jaxlib", "numpy")},
            "platform": platform.platform(),
        }
        with named_errors("write", path), replacing(path) as file:
            file.attrs.update(attributes | root)
            create_datasets(file, datasets, sizes)
            file["t"][...] = times
            for slot in restart.SLOTS:
                restart.create_slot(file, slot, restart.packed({}))
        self._open(path)
        self._seconds_before = 0.0

    def _open(self, path: Path) -> None:
        self.path = path
        with named_errors("write", path):
            self._file = opened(path, "r+")
        self.saved = int(self._file.attrs["saved"])
        self._rows = histories(self._file)
        self._valid, self._free = restart.slots(self._file)

    def append(self, block: dict[str, np.ndarray], leaves: dict[str, np.ndarray], wall_time: float = 0.0) -> None:
        """Adds saved times together with the restart state. They are in the file when this returns.

        Args:
            block: all datasets, each with the new saved times as its first axis.
            leaves: the arrays of the state after the last of these times; {} for a run that cannot be continued.
            wall_time: seconds of this part of the run so far, which the file keeps if the process is killed.

        Raises:
            ValueError: names or shapes are not those of the file.
            StoreError: the file cannot be written.
            LostFile: the file was removed or replaced; a copy has everything that was added.
        """
        saved, state = self.saved + self._checked_count(block), restart.packed(leaves)
        with named_errors("write", self.path):
            if restart.room(self._free) != len(state):
                stale = [slot.name for slot in ((self._free,) if self.saved else (self._free, self._valid))]
                with self._rebuilding() as file:
                    for name in stale:
                        restart.create_slot(file, name, state)
            for name, dataset in self._rows.items():
                dataset[self.saved : saved] = block[name]
            if leaves:
                self._free["state"][...] = state
            self._file.attrs.modify("wall_time", self._seconds_before + wall_time)
            self._free.attrs.modify("saved", saved)
            self._file.flush()
            self._file.attrs.modify("saved", saved)
            self._file.flush()
            check_in_place(self._file, self.path)
        self._free, self._valid = self._valid, self._free
        self.saved = saved

    @property
    def names(self) -> list[str]:
        """The names of the datasets. A file of an earlier version may not have all diagnostics of this version."""
        return list(self._rows)

    def diagnostics(self) -> dict[str, np.ndarray]:
        """Returns the diagnostics of all saved times."""
        return row_of({name: dataset[: self.saved] for name, dataset in self._rows.items()}).diagnostics

    def row(self, i: int) -> Row:
        """Returns everything that was saved at time number i."""
        return row_of({name: dataset[i] for name, dataset in self._rows.items()})

    def finish(
        self,
        status: str,
        advice: str,
        wall_time: float,
        averages: dict[str, np.ndarray] | None = None,
        links: dict[str, certificate.Link] | None = None,
        error: float | None = None,
    ) -> None:
        """Removes rows that were not written, and stores how the run ended.

        Args:
            status: the status word.
            advice: the line of advice.
            wall_time: seconds of this part of the run; added to those of earlier parts.
            averages: time averages, by the names of their diagnostics.
            links: the certificate.
            error: the estimated error of the whole run. It is NaN if the estimate was interrupted, infinite if every
                second run broke down, and None if it was not asked for.
        """
        with named_errors("write", self.path), self._rebuilding() as file:
            # The count in the file is used, because an interrupt may have come before `self.saved` was set.
            for dataset in histories(file).values():
                dataset.resize(file.attrs["saved"], axis=0)
            for name, value in (averages or {}).items():
                create_average(file, name, value)
            if links:
                _certify(file, links)
            if error is not None:
                file.attrs["error"] = error
            file.attrs.update(status=status, advice=advice, wall_time=self._seconds_before + wall_time)

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
        check_in_place(self._file, self.path)
        self._file.close()
        with replacing(self.path, copy=True) as file:
            yield file
        self._open(self.path)


def _certify(file: h5py.File, links: dict[str, certificate.Link]) -> None:
    """Writes each link of the certificate as a labelled number, and the name of the weakest one."""
    group = file.create_group("certificate")
    for name, link in links.items():
        group[name] = link.value
        group[name].attrs.update(units=link.units, long_name=link.long_name)
    weak = certificate.weakest(links)
    group.attrs.update(weakest=weak, digits=links[weak].digits)


def resume(path: str | os.PathLike, scene_text: str, times: np.ndarray) -> Writer:
    """Returns a writer that continues after the last saved row. A file of schema version 1 is converted.

    Args:
        path: the file.
        scene_text: the scene, as in `Writer`; it may ask for more saved times than that in the file.
        times: all saved times (T,) of a complete run, beginning with those in the file.

    Raises:
        StoreError: the file is not a result file, has a later version, or cannot be written.
    """
    path = Path(path)
    with named_errors("resume", path):
        open_result(path).close()
        with replacing(path, copy=True) as file:
            _reopen(file, scene_text, times)
    writer = Writer.__new__(Writer)
    writer._open(path)
    writer._seconds_before = float(writer._file.attrs["wall_time"])
    return writer


def _reopen(file: h5py.File, scene_text: str, times: np.ndarray) -> None:
    """Allocates the remaining rows, and deletes what belongs to a finished run: averages, certificate, error."""
    if file.attrs["schema_version"] == 1:
        restart.convert(file)
        link_scales(file["diagnostics"])
    for dataset in histories(file).values():
        dataset.resize(len(times), axis=0)
    saved = file.attrs["saved"]
    file["t"][saved:] = times[saved:]
    if "averages" in file:
        delete_averages(file)
    if "certificate" in file:
        del file["certificate"]
    if "error" in file.attrs:
        del file.attrs["error"]
    file.attrs.update(schema_version=SCHEMA_VERSION, scene=scene_text, saves=len(times), status="running", advice="")
