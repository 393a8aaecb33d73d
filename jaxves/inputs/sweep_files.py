"""Reads sweep files, and lists their cases with the numbers of each.

A number that no scene may have (a reduced area of 1.2) is an error if it stands on an axis or in a range of a file.
From Python, or in a list of cases, it marks its case as refused. So does an impossible combination of allowed numbers
(vesicles that overlap at the start). The other cases run.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from pydantic import ValidationError

from . import scene_files
from .checking import SceneError, checked
from .parameters import with_numbers
from .scene_tables import SceneFile
from .sweep_tables import Sample, Span, SweepFile
from .uses import SWEEP, refuse_unused


@dataclass(frozen=True)
class Plan:
    """The cases of a sweep, as a grid of `shape` with one row of `values` for each case in C order.

    `dims` are the names of the axes: those of the numbers for a grid, "case" for a list or a sample. `stride` is the
    distance, on each axis, between points that are always computed; the others are computed only by refinement.
    `refused` has the error message of each case that cannot run.
    """

    sweep_file: SweepFile
    names: tuple[str, ...]
    values: np.ndarray  # (cases, names)
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    stride: tuple[int, ...]
    refused: dict[int, str]

    @property
    def coordinates(self) -> dict[str, tuple[tuple[str, ...], np.ndarray]]:
        """Returns dimensions and values of each number."""
        if self.dims == ("case",):
            return {name: (self.dims, self.values[:, k]) for k, name in enumerate(self.names)}
        grid = self.values.reshape(*self.shape, len(self.names))
        found = {}
        for k, name in enumerate(self.names):
            along = tuple(slice(None) if i == k else 0 for i in range(len(self.names)))
            found[name] = (name,), grid[*along, k]
        return found


def read_sweep_file(path: str | Path) -> SweepFile:
    """Reads a sweep file; raises SceneError."""
    path = Path(path)
    tables = scene_files.read_tables(path, str(path), "a TOML file with a sweep")
    return parse(tables, origin=str(path), folder=path.parent)


def parse(tables: Mapping[str, Any], *, origin: str = "sweep", folder: Path | str = ".") -> SweepFile:
    """Checks the tables of a sweep. `scene` may be a SceneFile, its tables, a built-in name, or a file in `folder`."""
    scene = tables.get("scene")
    if scene is None:
        raise SceneError(f"{origin}: scene is missing, expected a scene file, a built-in scene, or a table [scene]")
    if isinstance(scene, str):
        source = scene if scene in scene_files.built_in_scenes() else Path(folder) / scene
        tables = {**tables, "scene": scene_files.read_scene(source)}
    sweep_file = checked(SweepFile, tables, origin, folder=Path(folder))
    refuse_unused(sweep_file.scene, SWEEP, origin)
    return sweep_file


def to_toml(sweep_file: SweepFile) -> str:
    """Returns the sweep as TOML, with its scene and all defaults."""
    text = tomli_w.dumps(sweep_file.model_dump(by_alias=True, exclude_none=True))
    return re.sub(r"\[\n([^][]*?),\n\s*\]", lambda array: f"[{' '.join(array[1].split())}]", text)


def plan(sweep_file: SweepFile, *, origin: str = "sweep", strict: bool = True) -> Plan:
    """Lists the cases and checks each with the tables of the scene.

    Args:
        sweep_file: the sweep.
        origin: the beginning of error messages.
        strict: a value of an axis that no scene may have is an error, instead of marking its cases.

    Raises:
        SceneError: the scene has no number of a given name, a value is wrong, or no case can run.
    """
    names, dims, shape, stride, values = _expanded(sweep_file)
    _check_names(sweep_file.scene, names, origin)
    strict = strict and sweep_file.cases is None
    refused = {}
    for i, row in enumerate(values):
        complaint, own = _complaint(sweep_file.scene, dict(zip(names, row.tolist(), strict=True)))
        if complaint and own and strict:
            raise SceneError(f"{origin}: {complaint}")
        if complaint:
            refused[i] = complaint
    if len(refused) == len(values):
        raise SceneError(f"{origin}: no case can run: {refused[0]}")
    return Plan(sweep_file, names, values, dims, shape, stride, refused)


def _expanded(sweep_file: SweepFile):
    if sweep_file.axes is not None:
        names = tuple(sweep_file.axes)
        levels = _levels(sweep_file)
        axes = [_fine(axis, levels[name]) for name, axis in sweep_file.axes.items()]
        values = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(names))
        return names, names, tuple(map(len, axes)), tuple(2 ** levels[name] for name in names), values
    if sweep_file.cases is not None:
        names = tuple(sweep_file.cases[0])
        values = np.array([[case[name] for name in names] for case in sweep_file.cases])
    else:
        names, values = _sampled(sweep_file.sample)
    return names, ("case",), (len(values),), (1,), values


def _levels(sweep_file: SweepFile) -> dict[str, int]:
    refine = sweep_file.refine
    if refine is None:
        return dict.fromkeys(sweep_file.axes, 0)
    along = refine.along or tuple(sweep_file.axes)
    return {name: refine.levels if name in along else 0 for name in sweep_file.axes}


def _fine(axis: Span | tuple[float, ...], levels: int) -> np.ndarray:
    """Returns the values of an axis, with those in between that refinement may need."""
    if isinstance(axis, Span):
        space = np.geomspace if axis.spacing == "log" else np.linspace
        return space(axis.start, axis.stop, (axis.num - 1) * 2**levels + 1)
    values = np.array(axis, dtype=float)
    fine = np.arange((len(values) - 1) * 2**levels + 1) / 2**levels
    return np.interp(fine, np.arange(len(values)), values) if levels else values


def _sampled(sample: Sample) -> tuple[tuple[str, ...], np.ndarray]:
    names = tuple(sample.ranges)
    from scipy.stats import qmc  # takes longer to import than everything else here

    sequence = qmc.Sobol if sample.sequence == "sobol" else qmc.Halton
    points = sequence(len(names), rng=np.random.default_rng(sample.seed)).random(sample.num)
    low, high = np.array([sample.ranges[name] for name in names]).T
    return names, low + (high - low) * points


def _check_names(scene_file: SceneFile, names: tuple[str, ...], origin: str) -> None:
    for name in names:
        try:
            with_numbers(scene_file, {name: 0.0})
        except SceneError as error:
            expected = str(error).partition(", expected ")[2]
            raise SceneError(f"{origin}: {name}, expected {expected}") from None


def _complaint(scene_file: SceneFile, values: dict[str, float]) -> tuple[str, bool]:
    """Returns the error message for these numbers, "" if they are allowed, and whether a single number is wrong."""
    tables = with_numbers(scene_file, values).model_dump(by_alias=True, exclude_none=True)
    try:
        SceneFile.model_validate(tables)
    except ValidationError as error:
        own = not error.errors(include_url=False)[0].get("ctx", {}).get("key")
        try:
            checked(SceneFile, tables, "")
        except SceneError as said:
            return str(said).removeprefix(": "), own
    return "", False
