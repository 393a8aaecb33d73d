"""The [[vesicle]] tables of a scene file: an ellipse, a circle, or a curve through points."""

import abc
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import model_validator

from . import outlines
from .tables import Table, refusal
from .values import (
    Finite,
    Flag,
    NotNegative,
    Pair,
    PointList,
    Positive,
    Ratio,
    ReducedArea,
    Text,
)


class VesicleTable(Table):
    """What vesicles of every shape have; the electrical numbers, where absent, are those of [field]."""

    told_apart_by: ClassVar[str] = "shape"

    shape: str
    angle: Finite = 0.0  # by which the shape is turned; that of the major axis of an ellipse
    center: Pair = (0.0, 0.0)  # where the centroid is
    length: Positive = 1.0  # perimeter / 2π
    bending: Positive = 1.0  # relative to the reference κ_B
    relaxed: Flag = False  # first relax to equilibrium, without field or flow
    conductivity_ratio: Ratio | None = None
    membrane_conductance: NotNegative | None = None
    chi: Positive | None = None
    permittivity_ratio: Positive | None = None

    @abc.abstractmethod
    def polygon(self) -> outlines.Polygon:
        """The outline of the shape, of any size, angle and place."""


class DeformableVesicle(VesicleTable):
    """What can be given no symmetry; a circle has no room for it."""

    disturbance: Finite | None = None  # amplitude of what breaks the symmetry of the shape (`shapes.disturbed`)

    @model_validator(mode="after")
    def _stays(self):
        if self.relaxed and self.disturbance is not None:
            raise refusal("no disturbance where relaxed = true, which would undo it", "disturbance", self.disturbance)
        return self


class EllipseVesicle(DeformableVesicle):
    """An ellipse of given reduced area Δ = 4πA/L²."""

    shape: Literal["ellipse"] = "ellipse"
    reduced_area: ReducedArea = None

    def polygon(self):
        return outlines.ellipse_polygon(self.reduced_area)


class CircleVesicle(VesicleTable):
    """A circle, whose reduced area is 1."""

    shape: Literal["circle"] = "circle"

    def polygon(self):
        return outlines.circle_polygon()


class PointsVesicle(DeformableVesicle):
    """A smooth closed curve through points, scaled to the length; clockwise ones are turned round.

    `file` is read at once and becomes `points`: a scene written back does not depend on other files.
    """

    shape: Literal["points"] = "points"
    file: Text | None = None  # .csv, .txt or .npy, relative to the scene file
    points: PointList | None = None

    @model_validator(mode="before")
    @classmethod
    def _read(cls, values: Any, info) -> Any:
        if not isinstance(values, dict):
            return values
        file = values.get("file")
        if (file is None) == (values.get("points") is None):
            raise refusal("the name of a .csv, .txt or .npy file, or else points = [[x, y], …]", "file", file)
        if not isinstance(file, str):
            return values
        try:
            points = outlines.read_points((info.context or {}).get("folder", Path()) / file)
            points = outlines.counter_clockwise(points)
        except ValueError as error:
            raise refusal(str(error), "file", file) from None
        return {key: value for key, value in values.items() if key != "file"} | {"points": points.tolist()}

    def polygon(self):
        return outlines.Polygon(outlines.smooth(np.array(self.points)))
