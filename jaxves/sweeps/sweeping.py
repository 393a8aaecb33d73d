"""Runs a sweep: from a sweep file to a result file, resumable, on all devices of all processes.

A sweep has several passes over its cases. In the first pass each case may take a limited number of steps. A second pass
continues with a larger limit for the cases that need more, so that they do not delay the others. With refinement, the
cases near a change of class follow, and so on until there are none. Each batch is written to the file as soon as it is
computed.
"""

import dataclasses
import time
from collections.abc import Mapping
from contextlib import nullcontext
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from ..base import status
from ..base.progress import Progress, silent
from ..inputs import sweep_files
from ..inputs.checking import SceneError
from ..inputs.sweep_files import Plan
from ..inputs.sweep_tables import SweepFile
from ..observables import quantities
from ..observables.classes import NAMES
from ..results import sweep_store
from ..results.hdf5 import StoreError, refuse_existing
from ..results.ownership import LostFile, real, writing
from ..results.sweep_store import AGAIN, DUE, PENDING, SKIPPED, SweepRecord, Variable
from ..results.sweep_writer import SweepWriter
from . import motions, processes, refinement
from .batches import METHODS, Batches
from .case_summary import with_ends

_OWN = {
    "status": Variable("1", "how the case ended", dtype="S16"),
    "passes": Variable("1", "passes given to the case", dtype="i1"),
}
_EXTRA = {
    "t_reached": Variable("t_kappa", "time at the end of the run"),
    "steps": Variable("1", "accepted steps", dtype="i4"),
    "rejected": Variable("1", "rejected steps", dtype="i4"),
    "deformation_trend": Variable("1", "change of D in as much time again, at its last rate", ("vesicle",)),
}
_HISTORY = {
    "t": ("t_kappa", "time", ()),
    "x": ("a", "position of the nodes", ("vesicle", "node", "xy")),
    "V_m": ("a E_inf", "transmembrane potential", ("vesicle", "node")),
    "tension": ("kappa_B/a^2", "membrane tension", ("vesicle", "node")),
}
_KINDS = {
    "final": "at the end, NaN for a case that did not reach it",
    "average": "time average, NaN for a case that did not reach its end",
    "min": "least of all saved times that were reached",
    "max": "greatest of all saved times that were reached",
}


class _Due(NamedTuple):
    cases: np.ndarray
    passes: int  # the number of passes after this one
    max_steps: int


def sweep(
    source: str | Path | Mapping[str, Any] | SweepFile,
    path: str | Path,
    *,
    force: bool = False,
    resume: bool = False,
    devices: int | None = None,
    batch: int | None = None,
    method: str | None = None,
    progress: Progress = silent,
) -> SweepRecord:
    """Computes a sweep into a file and returns the content of the file. After Ctrl-C the file can be resumed.

    Under `jax.distributed` every process calls this function with the same arguments and computes its share of the
    cases.

    Args:
        source: a sweep file, its tables, or what `sweep_files.parse` returned. A value that no scene may have is an
            error if it stands in a file. In tables it marks its cases as refused.
        path: the result file.
        force: replace the file if it exists.
        resume: continue the file.
        devices: number of devices of this process to use; all by default. The cores of a machine count as one device
            unless XLA_FLAGS contains --xla_force_host_platform_device_count.
        batch: cases per device and call.
        method: "map" computes one case after the other on each device, "vmap" all cases of a batch together. The
            default depends on the platform.
        progress: called after every batch with the number of finished cases, of cases planned so far, and a text.

    Raises:
        SceneError: the input is invalid, or a case does not fit into memory.
        StoreError: the file exists, belongs to another sweep, is being written by another process, or cannot be
            written.
        LostFile: the file was removed or replaced during the sweep; a copy has its content.
    """
    path = real(path)
    strict = isinstance(source, str | Path)
    origin = str(source) if strict else "sweep"
    if strict:
        source = sweep_files.read_sweep_file(source)
    elif not isinstance(source, SweepFile):
        source = sweep_files.parse(source)
    plan = sweep_files.plan(source, origin=origin, strict=strict)
    if force and resume:
        raise StoreError(f"{path}: force replaces the file and resume continues it, give one of them.")
    with writing(path) if processes.is_first() else nullcontext():
        if resume:
            _check_resumable(path, plan)
        elif processes.is_first():
            refuse_existing(path, force, resumable=True)
        began = time.perf_counter()
        progress(0, len(plan.values) - len(plan.refused), "compiling")
        batches = Batches(source, plan.names, _devices(devices), _method(method), _count("batch", batch))
        return _Sweep(path, plan, batches, force, resume, progress, began).run()


def _devices(count: int | None) -> list[jax.Device]:
    known = jax.local_devices()
    if _count("devices", count) is not None and count > len(known):
        raise SceneError(f"devices = {count}, expected at most {len(known)}, which JAX has in this process.")
    return known[:count]


def _count(name: str, value: int | None) -> int | None:
    if value is not None and value < 1:
        raise SceneError(f"{name} = {value}, expected a whole number >= 1.")
    return value


def _method(name: str | None) -> str | None:
    if name is not None and name not in METHODS:
        raise SceneError(f'method = "{name}", expected one of {", ".join(METHODS)}.')
    return name


def _check_resumable(path: Path, plan: Plan) -> None:
    if sweep_store.read_sweep(path).attributes["sweep"] != sweep_files.to_toml(plan.sweep_file):
        raise StoreError(f"{path} holds another sweep: it can be resumed only with its own.")


_INACCURATE = status.WORDS[status.INACCURATE]


class _Sweep:
    """One call of `sweep`."""

    def __init__(
        self, path: Path, plan: Plan, batches: Batches, force: bool, resume: bool, progress: Progress, began: float
    ):
        self.path, self.plan, self.batches, self.progress, self.began = path, plan, batches, progress, began
        self.rounds = 0
        variables, sizes = _variables(batches.shapes())
        _check_room(path, variables, sizes, plan)
        attributes = {"device": str(jax.devices()[0]), "nodes": batches.program.scene_file.numerics.nodes}
        if processes.is_first() and not resume:
            for left in processes.other_files(path):
                left.unlink()
            SweepWriter.create(path, plan, variables, sizes, attributes, force=force).close()
        elif processes.is_first():
            self._merge()
        self._wait("begun")
        self.before = sweep_store.count_computed(sweep_store.progress(path).status)
        if processes.own_file(path) != path:
            SweepWriter.create(processes.own_file(path), plan, variables, sizes, attributes, force=True).close()

    def run(self) -> SweepRecord:
        """Makes all passes that are still to be done."""
        word = "interrupted"
        try:
            while (due := self._due()) is not None:
                with SweepWriter(processes.own_file(self.path)) as writer:
                    self._pass(writer, due)
                self._meet()
            word = "complete"
        except LostFile:  # the file that has this name now does not belong to this sweep
            word = "lost"
            raise
        finally:
            if processes.is_first() and word != "lost":
                self._finish(word)
            if word == "complete":
                self._wait("finished")
        record = sweep_store.read_sweep(self.path)
        return dataclasses.replace(record, computed=sweep_store.count_computed(record.status) - self.before)

    def _due(self) -> _Due | None:
        known = sweep_store.progress(self.path)
        computed = ~np.isin(known.status, DUE)
        self._done = int(np.sum(computed))
        first, second = self.plan.sweep_file.max_steps
        if np.any(again := known.status == AGAIN):
            due = _Due(np.flatnonzero(again), 2, second)
        else:
            classes = np.full(computed.shape, "") if known.classes is None else known.classes
            shape = self.plan.shape
            fresh = refinement.wanted(classes.reshape(shape), computed.reshape(shape), self.plan.stride)
            due = _Due(np.flatnonzero(fresh), 1, first)
        return due if len(due.cases) else None

    def _pass(self, writer: SweepWriter, due: _Due) -> None:
        mine = processes.share(due.cases, self.batches.program.size)
        total = self._done + len(due.cases)
        what = {1: "cases", 2: "cases that need more steps"}[due.passes]
        self.progress(self._done, total, what)
        for place, found in self.batches.outcomes(due.max_steps, self.plan.values[mine]):
            codes = found.pop("status")
            words = [status.WORDS[int(code)] for code in codes]
            if due.passes == 1:
                words = [AGAIN if code == status.TOO_MANY_STEPS else w for w, code in zip(words, codes, strict=True)]
            useful = [word in (*status.SUCCESS, _INACCURATE) for word in words]
            if "class" in found:
                found["class"] = np.array(
                    [
                        sweep_store.class_word(row) if use else ""
                        for use, row in zip(useful, found["class"], strict=True)
                    ],
                    dtype="S",
                )
            found = motions.reduced(with_ends(found, useful), useful)
            writer.write(mine[place], words, due.passes, found)
            self._done += (place.stop - place.start) * jax.process_count()
            self.progress(min(self._done, total), total, what)

    def _meet(self) -> None:
        """Waits until all processes have finished a pass and their files are merged."""
        self._wait("done")
        if processes.is_first():
            self._merge()
        self._wait("merged")

    def _merge(self) -> None:
        others = processes.other_files(self.path)
        if others:
            with SweepWriter(self.path) as writer:
                for other in others:
                    writer.merge(other)

    def _finish(self, word: str) -> None:
        with SweepWriter(self.path) as writer:
            if word == "complete":
                writer.mark(np.flatnonzero(writer.status == PENDING.encode()), SKIPPED)
            writer.finish(word, time.perf_counter() - self.began)
        if word == "complete":
            for other in processes.other_files(self.path):
                other.unlink()

    def _wait(self, what: str) -> None:
        self.rounds += 1
        processes.wait(f"jaxves sweep {what} {self.rounds}")


def _variables(shapes: dict[str, jax.ShapeDtypeStruct]) -> tuple[dict[str, Variable], dict[str, int]]:
    """Returns the variables of each case in the file, and the lengths of their own dimensions."""
    variables, sizes = dict(_OWN), {}
    for name, shape in shapes.items():
        if name == "status" or name.startswith(motions.SERIES):
            continue
        if name == "class":
            variables[name] = Variable("1", f"class: {', '.join(NAMES)}; of several vesicles joined by +", dtype="S64")
            continue
        variables[name] = _EXTRA.get(name) or _variable(name)
        sizes |= dict(zip(variables[name].dims, shape.shape, strict=True))
    if f"{motions.SERIES}t" in shapes:
        variables |= motions.VARIABLES
    return variables, sizes


def _variable(name: str) -> Variable:
    if name.startswith("history/"):
        name = name.removeprefix("history/")
        units, long_name, dims = _HISTORY.get(name) or (
            quantities.QUANTITIES[name].units,
            quantities.QUANTITIES[name].long_name,
            quantities.QUANTITIES[name].dims[1:],
        )
        return Variable(units, long_name, ("t", *dims))
    name, _, kind = name.rpartition("_")
    quantity = quantities.QUANTITIES[name]
    return Variable(quantity.units, f"{quantity.long_name}: {_KINDS[kind]}", quantity.dims[1:])


def _check_room(path: Path, variables: dict[str, Variable], sizes: dict[str, int], plan: Plan) -> None:
    """Raises SceneError if the disk has no room for the file."""
    each = sum(np.dtype(v.dtype).itemsize * prod(sizes[dim] for dim in v.dims) for v in variables.values())
    free = sweep_store.free_bytes(path)
    cases = prod(plan.shape)
    # The file is copied once at the end.
    if 2 * each * cases > free:
        fits = int(free // (2 * each))
        raise SceneError(
            f"{path}: {cases} cases of {each / 2**20:.2g} MiB need {2 * each * cases / 2**30:.3g} GiB on the disk, "
            f"expected at most {free / 2**30:.3g} GiB, which are free: {fits} cases would fit, or less in keep."
        )
