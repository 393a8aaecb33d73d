"""Writes the file of a sweep: a labelled grid in HDF5. The file stays valid if the process is killed.

All space is allocated at the start. The values of a case are flushed first. Then its `/status` changes from "pending"
to another word, which makes the case valid. A process that is killed in between leaves the case "pending".

Several processes write one such file each, and the first process merges them (`merge`).
"""

import platform
from importlib.metadata import version
from itertools import pairwise
from math import prod
from pathlib import Path

import h5py
import numpy as np

from ..inputs.sweep_files import Plan, to_toml
from .hdf5 import OpenFile, datasets_below, link_scales, named_errors, refuse_existing, replacing
from .ownership import check_in_place
from .sweep_store import AGAIN, DUE, PENDING, REFUSED, SCHEMA_VERSION, Variable, open_sweep

_WORD = "S16"


class SweepWriter(OpenFile):
    """Writes cases in any order; a context manager. It opens an existing file; `create` makes a new one."""

    def __init__(self, path: Path):
        self.path = path
        with named_errors("write", path):
            self._file = open_sweep(path, "r+")
        self.status = self._file["status"][...].ravel()
        self._shape = self._file["status"].shape
        self._names = [name for name in datasets_below(self._file) if self._file[name].attrs.get("per_case")]

    @classmethod
    def create(
        cls,
        path: Path,
        plan: Plan,
        variables: dict[str, Variable],
        sizes: dict[str, int],
        attributes: dict,
        *,
        force: bool = False,
    ) -> "SweepWriter":
        """Creates a file with room for all cases, and marks refused ones.

        Args:
            path: the file.
            plan: the cases.
            variables: the variables of each case, by name.
            sizes: lengths of the dimensions besides those of the grid.
            attributes: further root attributes.
            force: replace an existing file.

        Raises:
            StoreError: the file exists and `force` is not set, or it cannot be written.
        """
        refuse_existing(path, force)
        with named_errors("write", path), replacing(path) as file:
            file.attrs.update(
                {
                    "kind": "sweep",
                    "schema_version": SCHEMA_VERSION,
                    "dims": list(plan.dims),
                    "status": "running",
                    "wall_time": 0.0,
                    "version": version("jaxves"),
                    **{f"{package}_version": version(package) for package in ("jax", "jaxlib", "numpy")},
                    "platform": platform.platform(),
                    **attributes,
                }
            )
            # This is not an attribute, because attributes are limited to 64 KiB and a list of cases may be longer.
            file["sweep"] = to_toml(plan.sweep_file)
            file["sweep"].attrs.update(units="1", long_name="the sweep as TOML, complete with scene and defaults")
            _create_scales(file, plan, sizes)
            for name, variable in variables.items():
                _create(file, name, variable, plan)
            if "history" in file:
                link_scales(file["history"])
            words = np.full(prod(plan.shape), PENDING, _WORD)
            words[list(plan.refused)] = REFUSED.encode()
            file["status"][...] = words.reshape(plan.shape)
            if plan.refused:
                # They are written only here, because strings of variable length have no allocated space.
                texts = [plan.refused.get(i, "") for i in range(prod(plan.shape))]
                complaints = file.create_dataset(
                    "complaint", plan.shape, data=np.array(texts, object).reshape(plan.shape), dtype=h5py.string_dtype()
                )
                _label(file, complaints, Variable("1", "why a refused case cannot run"), plan)
        return cls(path)

    def write(self, cases: np.ndarray, words: list[str], passes: int, outcomes: dict[str, np.ndarray]) -> None:
        """Adds these cases, each completely or not at all. The first axis of `outcomes` is the cases."""
        with named_errors("write", self.path):
            done = np.array([word not in DUE for word in words])
            for first, last in _runs(cases, self._shape):
                place = self._place(int(cases[first]), last - first)
                self._file["passes"][place] = passes
                if done[first:last].any():
                    for name, values in outcomes.items():
                        self._file[name][place] = values[first:last]
            self._file.flush()
            self.status[cases] = [word.encode() for word in words]
            for first, last in _runs(cases, self._shape):
                place = self._place(int(cases[first]), last - first)
                self._file["status"][place] = self.status[cases[first:last]]
            self._file.flush()
            check_in_place(self._file, self.path)

    def mark(self, cases: np.ndarray, word: str) -> None:
        """Sets only the status of these cases."""
        with named_errors("write", self.path):
            self.status[cases] = word.encode()
            self._file["status"][...] = self.status.reshape(self._shape)
            self._file.flush()

    def merge(self, other: Path) -> None:
        """Copies the cases that are further advanced in another file of the same sweep."""
        with named_errors("read", other), open_sweep(other, "r") as file:
            words, passes = file["status"][...].ravel(), file["passes"][...].ravel()
            news = np.flatnonzero(_progressed(words) > _progressed(self.status))
            # A few at a time, because all of them may not fit into memory.
            for part in np.array_split(news, max(1, len(news) // 64)):
                places = [np.unravel_index(case, self._shape) for case in part]
                for given in np.unique(passes[part]):
                    chosen = passes[part] == given
                    found = {
                        name: np.array([file[name][p] for p, c in zip(places, chosen, strict=True) if c])
                        for name in self._names
                        if name not in ("status", "passes")
                    }
                    self.write(part[chosen], [word.decode() for word in words[part][chosen]], int(given), found)

    def finish(self, word: str, wall_time: float) -> None:
        """Stores how this call of `sweep` ended. `wall_time` in seconds is added to that of earlier calls."""
        self._file.close()
        with named_errors("write", self.path), replacing(self.path, copy=True) as file:
            file.attrs.update(status=word, wall_time=file.attrs["wall_time"] + wall_time)
        self.__init__(self.path)

    def _place(self, case: int, count: int) -> tuple:
        *rows, column = np.unravel_index(case, self._shape)
        return (*rows, slice(int(column), int(column) + count))


def _progressed(words: np.ndarray) -> np.ndarray:
    """Returns how far these cases have advanced, as numbers."""
    return np.where(words == PENDING.encode(), 0, np.where(words == AGAIN.encode(), 1, 2))


def _runs(cases: np.ndarray, shape: tuple[int, ...]):
    """Returns ranges of consecutive cases in one row of the grid, as pairs of positions in `cases`."""
    cuts = [i for i in range(1, len(cases)) if cases[i] != cases[i - 1] + 1 or cases[i] % shape[-1] == 0]
    return list(pairwise([0, *cuts, len(cases)])) if len(cases) else []


def _create_scales(file: h5py.File, plan: Plan, sizes: dict[str, int]) -> None:
    for name, (dims, values) in plan.coordinates.items():
        if dims == (name,):
            file[name] = values
            file[name].make_scale(name)
            file[name].attrs.update(units="1", long_name=name)
    if plan.dims == ("case",):
        file["case"] = np.arange(plan.shape[0])
        file["case"].make_scale("case")
        file["case"].attrs.update(units="1", long_name="number of the case")
        for name, (_, values) in plan.coordinates.items():
            file[name] = values
            file[name].attrs.update(units="1", long_name=name)
            file[name].dims[0].attach_scale(file["case"])
        file.attrs["coordinates"] = " ".join(plan.names)
    for dim, size in sizes.items():
        named = dim in ("xy", "ab")
        if dim == "t":
            scene = plan.sweep_file.scene
            file[dim] = scene.t_end * np.arange(size) / scene.saves
        else:
            file[dim] = np.array(["x", "y"], h5py.string_dtype()) if named else np.arange(size)
        file[dim].make_scale(dim)
        file[dim].attrs.update(units="t_kappa" if dim == "t" else "1", long_name="time" if dim == "t" else dim)


def _create(file: h5py.File, name: str, variable: Variable, plan: Plan) -> None:
    shape = (*plan.shape, *(len(file[dim]) for dim in variable.dims))
    early = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    early.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    kind = np.dtype(variable.dtype).kind
    fill = {"f": np.nan, "S": b"", "i": 0}[kind]
    dataset = file.create_dataset(name, shape, variable.dtype, fillvalue=fill, dcpl=early)
    dataset.attrs["per_case"] = True
    if kind == "S":
        dataset.attrs["_Encoding"] = "utf-8"
    _label(file, dataset, variable, plan)


def _label(file: h5py.File, dataset: h5py.Dataset, variable: Variable, plan: Plan) -> None:
    dataset.attrs.update(units=variable.units, long_name=variable.long_name)
    for axis, dim in zip(dataset.dims, (*plan.dims, *variable.dims), strict=True):
        axis.attach_scale(file[dim])
