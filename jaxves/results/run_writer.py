"""Writing the result file of a run: HDF5 which survives the death of the run that writes it.

The file is changed in two ways only, and a process killed at any moment leaves a whole one:

- *Structure* (the first skeleton, the trimming at the end) is made under the temporary name `….part`, which
  replaces the file when it is complete and on the disk. A full disk spoils the temporary file only.
- *Values* go into space allocated beforehand, so that no index of the file is touched. Rows and restart state are
  flushed first; then one number, the root attribute `saved`, says that they count.

The restart state has two slots, written in turn; each tells how many rows it belongs to, and the valid one is the one
which agrees with the root's `saved` (`restart`). Rows and state thus never part.
Blocks are flushed to the operating system, not to the disk: they survive the process, not surely a power cut.
"""

import os
import platform
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import h5py
import numpy as np

from ..observables import certificate
from . import restart
from .hdf5 import (
    Description,
    OpenFile,
    StoreError,
    create_average,
    create_datasets,
    delete_averages,
    histories,
    link_scales,
    named_errors,
    opened,
    replacing,
)
from .ownership import check_in_place
from .run_store import SCHEMA_VERSION, open_result


class Writer(OpenFile):
    """Writes one run, block after block; a context manager.

    Args:
        path: the file; complete from the start, with rows of NaN, and `status` "running".
        scene_text: the scene as TOML, complete with defaults.
        attributes: further root attributes.
        times: the saved times (T,) if the run reaches its end, t = 0 included.
        vesicles: M.
        nodes: N.
        datasets: what is saved, by its path in the file; "t" must be among them. Most others are in `HISTORY` of
            `run_store`.
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
        times: np.ndarray,
        vesicles: int,
        nodes: int,
        datasets: dict[str, Description],
        force: bool = False,
    ):
        path = Path(path)
        if path.exists() and not force:
            raise StoreError(f"{path} exists already: use --force to replace it.")
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

    def _open(self, path: Path) -> None:
        self.path = path
        with named_errors("write", path):
            self._file = opened(path, "r+")
        self.saved = int(self._file.attrs["saved"])
        self._rows = histories(self._file)
        self._valid, self._free = restart.slots(self._file)

    def append(self, block: dict[str, np.ndarray], leaves: dict[str, np.ndarray]) -> None:
        """Adds saved times and the state to continue from, both or neither; done when this returns.

        Args:
            block: all datasets, each with the new saved times as its first axis.
            leaves: the arrays of the state after the last of these times; {} if nobody will continue.

        Raises:
            ValueError: names or shapes are not those of the file.
            StoreError: the file cannot be written.
            LostFile: it was removed or replaced; a copy holds all that was added.
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
            self._free.attrs.modify("saved", saved)
            self._file.flush()
            self._file.attrs.modify("saved", saved)
            self._file.flush()
            check_in_place(self._file, self.path)
        self._free, self._valid = self._valid, self._free
        self.saved = saved

    @property
    def names(self) -> list[str]:
        """What is saved of each time; a file of an earlier version may lack diagnostics that there are now."""
        return list(self._rows)

    def diagnostics(self) -> dict[str, np.ndarray]:
        """The diagnostics of all saved times."""
        start = "diagnostics/"
        return {
            name.removeprefix(start): dataset[: self.saved]
            for name, dataset in self._rows.items()
            if name.startswith(start)
        }

    def row(self, i: int) -> dict[str, np.ndarray]:
        """All that was saved of one time."""
        return {name: dataset[i] for name, dataset in self._rows.items()}

    def finish(
        self,
        status: str,
        advice: str,
        wall_time: float,
        averages: dict[str, np.ndarray] | None = None,
        links: dict[str, certificate.Link] | None = None,
        error: float | None = None,
    ) -> None:
        """Cuts off the rows never written and says how the run ended.

        `wall_time` in seconds adds to that of earlier parts of a resumed run; `averages` over time are
        named like the diagnostics they belong to; `links` are the certificate, `error` is the estimated error of
        the whole run, NaN where its estimate was interrupted, infinite where no second run arrived.
        """
        with named_errors("write", self.path), self._rebuilding() as file:
            # The file's own count: an interrupt may have come between its commit and `self.saved`.
            for dataset in histories(file).values():
                dataset.resize(file.attrs["saved"], axis=0)
            for name, value in (averages or {}).items():
                create_average(file, name, value)
            if links:
                _certify(file, links)
            if error is not None:
                file.attrs["error"] = error
            file.attrs.update(status=status, advice=advice, wall_time=file.attrs["wall_time"] + wall_time)

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
    """One labelled number a link in `/certificate`, and which is the weakest."""
    group = file.create_group("certificate")
    for name, link in links.items():
        group[name] = link.value
        group[name].attrs.update(units=link.units, long_name=link.long_name)
    weak = certificate.weakest(links)
    group.attrs.update(weakest=weak, digits=links[weak].digits)


def resume(path: str | os.PathLike, scene_text: str, times: np.ndarray) -> Writer:
    """A writer which goes on after the last saved row. A file of schema version 1 is brought to the present one.

    Args:
        path: the file.
        scene_text: as in `Writer`; the file's own, or one that asks for more saved times.
        times: all saved times (T,) if the run reaches its end, those that the file has already first.

    Raises:
        StoreError: not a result file, one of a later version, or one that cannot be written.
    """
    path = Path(path)
    with named_errors("resume", path):
        open_result(path).close()
        with replacing(path, copy=True) as file:
            _reopen(file, scene_text, times)
    writer = Writer.__new__(Writer)
    writer._open(path)
    return writer


def _reopen(file: h5py.File, scene_text: str, times: np.ndarray) -> None:
    """Makes room for the rows still to come, and takes out what only a run that has ended can say."""
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
