"""The [[vesicle]] tables of a scene file: an ellipse, a circle, or a curve through points."""

import abc
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Discriminator, Tag, model_validator

from ..base import physical_numbers
from ..base.resolution import kept_modes, sizes_up_to
from ..geometry import outlines
from ..geometry.outline_files import SUFFIXES, read_outline
from .checking import Table, number, refusal
from .key_types import Count, Flag, Pair, PointList, Seed, Text, key, optional_key


class VesicleTable(Table):
    """The keys of vesicles of every shape.

    Electrical numbers that are absent are those of [field], and the viscosity ratio is that of [fluid].
    """

    told_apart_by: ClassVar[str] = "shape"

    shape: str
    angle: key(physical_numbers.ANGLE)
    center: Pair = (0.0, 0.0)  # position of the centroid
    length: key(physical_numbers.LENGTH)
    bending: key(physical_numbers.BENDING)
    relaxed: Flag = False  # relax to equilibrium before the run, without field or flow
    conductivity_ratio: optional_key(physical_numbers.CONDUCTIVITY_RATIO)
    membrane_conductance: optional_key(physical_numbers.MEMBRANE_CONDUCTANCE)
    chi: optional_key(physical_numbers.CHI)
    permittivity_ratio: optional_key(physical_numbers.PERMITTIVITY_RATIO)
    viscosity_ratio: optional_key(physical_numbers.VISCOSITY_RATIO)

    @abc.abstractmethod
    def polygon(self) -> outlines.Polygon:
        """Returns the outline of the shape. Its size, angle and position are not specified."""


class UndulationTable(Table):
    """A random thermal disturbance, `shapes.undulated`. It is the same for every number of nodes."""

    temperature: key(physical_numbers.TEMPERATURE)
    tension: key(physical_numbers.TENSION)
    seed: Seed = 1  # of the random numbers
    modes: Count = None  # the highest mode


def _kind_of_disturbance(value: Any) -> str:
    return "kind=table" if isinstance(value, dict | UndulationTable) else "kind=number"


Disturbance = Annotated[
    Annotated[number(physical_numbers.DISTURBANCE.bounds), Tag("kind=number")]
    | Annotated[UndulationTable, Tag("kind=table")],
    Discriminator(_kind_of_disturbance),
]


class DeformableVesicle(VesicleTable):
    """A vesicle whose shape can be disturbed, which is not possible for a circle."""

    disturbance: Disturbance | None = None  # the amplitude in `shapes.disturbed`, or thermal undulations

    @model_validator(mode="after")
    def _stays(self):
        if self.relaxed and self.disturbance is not None:
            raise refusal("no disturbance where relaxed = true, which would undo it", "disturbance", self.disturbance)
        return self


def undulation_modes(vesicle: VesicleTable) -> int:
    """Returns the highest mode of the thermal undulations of a vesicle; 0 without."""
    disturbance = getattr(vesicle, "disturbance", None)
    return disturbance.modes if isinstance(disturbance, UndulationTable) else 0


def check_undulations(vesicles: Sequence[VesicleTable], nodes: int | Literal["auto"] | None) -> None:
    """Refuses undulations with more modes than the nodes keep; for "auto" or None, than the largest number keeps."""
    N = sizes_up_to(math.inf)[-1] if nodes in ("auto", None) else nodes
    for i, vesicle in enumerate(vesicles):
        modes = undulation_modes(vesicle)
        if modes > kept_modes(N):
            wanted = f"at most {kept_modes(N)} modes for {N} nodes"
            raise refusal(wanted, f"vesicle[{i}].disturbance.modes", modes)


class EllipseVesicle(DeformableVesicle):
    """An ellipse with the reduced area Δ = 4πA/L²."""

    shape: Literal["ellipse"] = "ellipse"
    reduced_area: key(physical_numbers.REDUCED_AREA)

    def polygon(self):
        return outlines.ellipse_polygon(self.reduced_area)


class CircleVesicle(VesicleTable):
    """A circle, whose reduced area is 1."""

    shape: Literal["circle"] = "circle"

    def polygon(self):
        return outlines.circle_polygon()


class PointsVesicle(DeformableVesicle):
    """A smooth closed curve through points, scaled to the length. Clockwise points are reversed.

    `file` is read at once and becomes `points`, so that a stored scene does not depend on other files. If the points
    are noisy, as those from a microscope, only some Fourier modes of the outline are kept. `modes` is their number.
    Without it the number is chosen from the noise and stored in `modes`, with a warning. `flip_y` is for images, whose
    y axis points down. The points are flipped at once and stored with `flip_y` false.
    """

    shape: Literal["points"] = "points"
    file: Text | None = None  # .csv, .txt, .tsv, .dat or .npy, relative to the scene file
    points: PointList | None = None
    modes: Count | None = None  # number of Fourier modes; by default all, or chosen from the noise of the points
    flip_y: Flag = False

    @model_validator(mode="before")
    @classmethod
    def _read(cls, values: Any, info) -> Any:
        if not isinstance(values, dict):
            return values
        file = values.get("file")
        if (file is None) == (values.get("points") is None):
            wanted = f"the name of a {', '.join(SUFFIXES)} file, or else points = [[x, y], …]"
            raise refusal(wanted, "file", file)
        if file is not None and not isinstance(file, str):
            return values  # refused by the type of the key
        key = "points" if file is None else "file"
        try:
            if file is None:
                points, lines = _as_array(values["points"]), None
            else:
                points, lines = read_outline((info.context or {}).get("folder", Path()) / file)
            modes, flip = values.get("modes"), values.get("flip_y", False)
            if (
                points is None
                or not (modes is None or (type(modes) is int and modes > 0))
                or not isinstance(flip, bool)
            ):
                return values  # the types of the keys report what is wrong
            outline = outlines.prepared(points * [1.0, -1.0] if flip else points, modes, lines)
        except ValueError as error:
            raise refusal(str(error), key, values[key]) from None
        found = {"points": outline.points.tolist(), "modes": outline.modes, "flip_y": False}
        return {key: value for key, value in values.items() if key != "file"} | found

    def polygon(self):
        return outlines.Polygon(outlines.smooth(np.array(self.points), self.modes))


def _as_array(points: Any) -> np.ndarray | None:
    """Returns points as an array (K, 2), or None if they are not points."""
    try:
        array = np.array(points)
    except ValueError:
        return None
    good = array.ndim == 2 and array.shape[1] == 2 and array.dtype.kind in "iuf"
    return array.astype(float) if good else None
