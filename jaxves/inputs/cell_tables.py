"""The tables of periodic cells and suspensions in a scene file. Nothing here imports JAX."""

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from ..base.bounds import NOT_NEGATIVE
from ..geometry import outlines, placement
from .checking import Expect, Table, number, one_of, refusal
from .key_types import Count, Lattice
from .vesicle_tables import EllipseVesicle, UndulationTable, VesicleTable


class CellTable(Table):
    """A doubly periodic cell with the two vectors `lattice`, in a. A shear flow carries it along."""

    lattice: Lattice = None

    def area(self) -> float:
        """Returns the area of the cell."""
        (ax, ay), (bx, by) = self.lattice
        return ax * by - ay * bx


Fraction = Annotated[float, Field(gt=0, lt=1), Expect("a number > 0 and < 1")]
Spread = Annotated[number(NOT_NEGATIVE), Field(lt=0.5), Expect("a number >= 0 and < 0.5")]


class SuspensionTable(Table):
    """Copies of the [[vesicle]] tables in turn, at places in the cell without overlap.

    The copies replace the tables when a file is read, so that a stored scene has one table for each vesicle. There are
    `count` of them, or as many as make up the `area_fraction`. `arrangement` is "random", with random angles, or
    "lattice". `size_spread` and `reduced_area_spread` are standard deviations, of the length relative to its value and
    of the reduced area, of uniform distributions. If a vesicle has thermal undulations, each copy has a seed of its
    own, which follows from that of the table.
    """

    count: Count | None = None
    area_fraction: Fraction | None = None
    seed: Annotated[int, Field(ge=0), Expect("a whole number >= 0")] = 0
    arrangement: one_of("random", "lattice") = "random"
    size_spread: Spread = 0.0
    reduced_area_spread: Spread = 0.0

    @model_validator(mode="after")
    def _says_how_many(self) -> "SuspensionTable":
        if (self.count is None) == (self.area_fraction is None):
            raise refusal("either count or area_fraction", "count", self.count)
        return self

    def copies(self, vesicles: tuple[VesicleTable, ...], cell: CellTable) -> tuple[VesicleTable, ...]:
        """Returns all vesicles of the suspension; raises a refusal if there is no room for them."""
        count = self.count
        if count is None:
            mean = np.mean([_area(vesicle) for vesicle in vesicles])
            count = round(self.area_fraction * cell.area() / mean)
            if count == 0:
                wanted = f"at least {mean / cell.area():.2g}, one vesicle in the cell"
                raise refusal(wanted, "suspension.area_fraction", self.area_fraction)
        generator = np.random.default_rng([self.seed, 1])
        chosen = [self._varied(vesicles[m % len(vesicles)], generator, m % len(vesicles)) for m in range(count)]
        chosen = [_with_own_seed(vesicle, m) for m, vesicle in enumerate(chosen)]
        lattice = np.array(cell.lattice)
        if self.arrangement == "lattice":
            centers = placement.lattice_places(count, lattice)
            return tuple(_moved(vesicle, center, 0.0) for vesicle, center in zip(chosen, centers, strict=True))
        polygons = [outlines.placed(v.polygon(), v.length, v.angle, (0.0, 0.0)) for v in chosen]
        try:
            centers, angles = placement.random_places(polygons, lattice, self.seed)
        except placement.NoRoom as error:
            key = "count" if self.area_fraction is None else "area_fraction"
            raise refusal(
                f"fewer vesicles, or another seed: {error}", f"suspension.{key}", getattr(self, key)
            ) from None
        return tuple(_moved(*parts) for parts in zip(chosen, centers, angles, strict=True))

    def _varied(self, vesicle: VesicleTable, generator: np.random.Generator, m: int) -> VesicleTable:
        size, shape = math.sqrt(3) * generator.uniform(-1, 1, 2)
        update = {"length": vesicle.length * (1 + self.size_spread * size)}
        if self.reduced_area_spread > 0:
            if not isinstance(vesicle, EllipseVesicle):
                wanted = f"0.0, because vesicle[{m}] is not an ellipse"
                raise refusal(wanted, "suspension.reduced_area_spread", self.reduced_area_spread)
            varied = vesicle.reduced_area + self.reduced_area_spread * shape
            if not 0.1 < varied <= 1:
                wanted = f"less: the reduced area of a copy of vesicle[{m}] would be {varied:.3g}"
                raise refusal(wanted, "suspension.reduced_area_spread", self.reduced_area_spread)
            update["reduced_area"] = varied
        return vesicle.model_copy(update=update)


def _with_own_seed(vesicle: VesicleTable, m: int) -> VesicleTable:
    """Returns copy m of a vesicle, with thermal undulations that are independent of those of other copies."""
    thermal = getattr(vesicle, "disturbance", None)
    if not isinstance(thermal, UndulationTable):
        return vesicle
    (seed,) = np.random.SeedSequence([thermal.seed, m]).generate_state(1)
    return vesicle.model_copy(update={"disturbance": thermal.model_copy(update={"seed": int(seed)})})


def _area(vesicle: VesicleTable) -> float:
    polygon = vesicle.polygon()
    return polygon.area * (2 * math.pi * vesicle.length / polygon.length) ** 2


def _moved(vesicle: VesicleTable, center, turn: float) -> VesicleTable:
    angle = math.remainder(vesicle.angle + float(turn), 360.0)
    return vesicle.model_copy(update={"center": (float(center[0]), float(center[1])), "angle": angle})


def with_copies(file: Any) -> Any:
    """Returns a scene file with the vesicles of its suspension instead of the table; raises a refusal."""
    if file.cell is None:
        raise refusal("a [cell], in which the vesicles are placed", "suspension", {})
    if file.pair is not None:
        raise refusal("no [pair] beside a [suspension]", "pair", {})
    return file.model_copy(update={"vesicle": file.suspension.copies(file.vesicle, file.cell), "suspension": None})


def check_beside_cell(file: Any) -> None:
    """Raises a refusal for a key of a scene file that is not supported in its periodic cell."""
    if file.flow is not None and file.flow.kind != "shear":
        raise refusal('"shear", or no [flow], in a [cell]', "flow.kind", file.flow.kind)
    if file.flow is not None and file.flow.time is not None:
        raise refusal("no such table in a [cell]", "flow.time", {})
    if file.flow is not None and file.cell.lattice[0][1] != 0:
        raise refusal("a first vector along x, [L, 0], in a shear flow", "cell.lattice", file.cell.lattice)
    if file.numerics.solver == "dense":
        raise refusal('"auto" or "matrix-free" in a [cell]', "numerics.solver", file.numerics.solver)
    if file.field is not None and file.field.charge_relaxation is not None:
        raise refusal("no such key in a [cell]", "field.charge_relaxation", file.field.charge_relaxation)
    if file.field is not None and getattr(file.field.time, "averaged", False):
        raise refusal("false in a [cell]", "field.time.averaged", True)
