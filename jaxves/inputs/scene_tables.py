"""The tables of a scene file. Their fields are the keys of the file, with their defaults.

Lengths are in units of a, times in t_κ = μa³/κ_B, and all angles are in degrees. A missing table means that the field,
the flow or the pair is absent. A key is required if its default is None and its type does not allow None (`checking`).
Nothing here imports JAX, so that wrong input is reported quickly.
"""

import math
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, model_validator

from ..base import physical_numbers
from ..geometry import outlines
from .cell_tables import CellTable, SuspensionTable, check_beside_cell, with_copies
from .checking import Table, choice, one_of, refusal
from .field_checks import check_field, check_step
from .key_types import (
    Count,
    Direction,
    Flag,
    Gradient,
    NodeCount,
    Numbers,
    Positive,
    Times,
    Tolerance,
    Window,
    key,
    optional_key,
)
from .vesicle_tables import CircleVesicle, EllipseVesicle, PointsVesicle, VesicleTable, check_undulations


def _tables(value: Any) -> Any:
    if not isinstance(value, list | tuple) or not value:
        raise refusal("one or more [[vesicle]] tables")
    return value


class PairTable(Table):
    """Two copies of the one vesicle. Its center becomes the center of the pair."""

    separation: key(physical_numbers.SEPARATION)
    offset_angle: key(physical_numbers.OFFSET_ANGLE)

    def offset(self, xp: Any = math) -> tuple[Any, Any]:
        """Returns the vector from the center of the pair to the second vesicle; the first is opposite.

        `xp` is the module with cos and sin for the numbers, such as jax.numpy for traced ones.
        """
        angle = self.offset_angle * (math.pi / 180)
        return 0.5 * self.separation * xp.cos(angle), 0.5 * self.separation * xp.sin(angle)


class TimeTable(Table):
    """The time dependence of the field or the flow: a factor on its strength."""

    told_apart_by: ClassVar[str] = "kind"


class ConstantTime(TimeTable):
    """The field or the flow is constant."""

    kind: Literal["constant"] = "constant"


class PulseTime(TimeTable):
    """A pulse with linear flanks of length `rise`."""

    kind: Literal["pulse"] = "pulse"
    start: key(physical_numbers.START)
    duration: key(physical_numbers.DURATION)
    rise: key(physical_numbers.RISE)


class SineTime(TimeTable):
    """offset + amplitude · sin(2π frequency t + phase), the phase in degrees."""

    kind: Literal["sine"] = "sine"
    frequency: key(physical_numbers.FREQUENCY)
    amplitude: key(physical_numbers.AMPLITUDE)
    offset: key(physical_numbers.OFFSET)
    phase: key(physical_numbers.PHASE)


class AcTime(SineTime):
    """offset + amplitude · cos(2π frequency t + phase), the phase in degrees; resolved, or averaged over the period."""

    kind: Literal["ac"] = "ac"
    averaged: Flag = False


class TabulatedTime(TimeTable):
    """Linear between the given times, constant before and after."""

    kind: Literal["table"] = "table"
    times: Times = None
    values: Numbers = None

    @model_validator(mode="after")
    def _one_value_per_time(self) -> "TabulatedTime":
        if len(self.values) != len(self.times):
            raise refusal(f"{len(self.times)} numbers, one for each of the times", "values", self.values)
        return self


class FieldTable(Table):
    """The imposed electric field, and the electrical parameters of fluids and membranes."""

    beta: key(physical_numbers.BETA)
    conductivity_ratio: key(physical_numbers.CONDUCTIVITY_RATIO)
    membrane_conductance: key(physical_numbers.MEMBRANE_CONDUCTANCE)
    chi: key(physical_numbers.CHI)
    permittivity_ratio: key(physical_numbers.PERMITTIVITY_RATIO)
    charge_relaxation: optional_key(physical_numbers.CHARGE_RELAXATION)
    direction: Direction = (0.0, 1.0)
    time: choice(ConstantTime, PulseTime, SineTime, AcTime, TabulatedTime) | None = None


class FluidTable(Table):
    """The fluids. Without this table, and without ratios of single vesicles, all viscosities are equal."""

    viscosity_ratio: key(physical_numbers.VISCOSITY_RATIO)


class FlowTable(Table):
    """An imposed flow, and the factor of time that it has."""

    told_apart_by: ClassVar[str] = "kind"

    time: choice(ConstantTime, PulseTime, SineTime, TabulatedTime) | None = None


class ShearFlow(FlowTable):
    """v = Ca (y, 0)."""

    kind: Literal["shear"] = "shear"
    capillary_number: key(physical_numbers.CAPILLARY_NUMBER)


class ExtensionFlow(FlowTable):
    """v = Ca (x, -y)."""

    kind: Literal["extension"] = "extension"
    capillary_number: key(physical_numbers.CAPILLARY_NUMBER)


class LinearFlow(FlowTable):
    """v = gradient · x."""

    kind: Literal["linear"] = "linear"
    gradient: Gradient = None


class PoiseuilleFlow(FlowTable):
    """v = Ca (1 - (y/half_width)², 0)."""

    kind: Literal["poiseuille"] = "poiseuille"
    capillary_number: key(physical_numbers.CAPILLARY_NUMBER)
    half_width: key(physical_numbers.HALF_WIDTH)


class StopTable(Table):
    """Ends the run early: when no shape changes any more, or when all vesicles are in a class.

    A class that the vesicles have at the start already does not end the run; see `observables/classes.py`.
    """

    steady: Positive | None = None
    class_: one_of("P", "O", "POP") | None = Field(None, alias="class")

    @model_validator(mode="after")
    def _says_when(self) -> "StopTable":
        if self.steady is None and self.class_ is None:
            raise refusal("steady, class, or both")
        return self


class NumericsTable(Table):
    """The numerical parameters.

    By default `nodes` is "auto" in a run and 64 in all other uses, whose nodes are fixed. "auto" starts with the
    fewest of 64, 96, 128, 192 and 256 nodes that resolve the starting curves: the top of their spectra is below
    1e-6 of the largest mode. A compressed membrane starts with as many as its wrinkles need, up to 2048. The number
    is adapted during the run; the result has it in `/nodes`. Rows are stored with the largest number that the run may
    use, 256 unless wrinkles need more.

    `method = "auto"` is "ark4". For a tolerance below 3e-6, or below 3e-5 with several vesicles, it is "ark5".

    `solver = "dense"` factorises the systems that couple all membranes. "matrix-free" forms a matrix of two membranes
    only if they are close. "auto" chooses by size. `neighbours` is its room for close pairs, per vesicle on average;
    "crowded" if more is needed. Fast sums are accurate to 0.01 `tolerance`, 1e-12 to 1e-6, and their systems to 0.1.

    `certify` makes a second run with other nodes and steps to estimate the error of the whole run. That takes about a
    third of the time of the run, and several times as long if it is poorly resolved.
    """

    nodes: NodeCount | None = None  # "auto" in a run, otherwise 64: `uses.for_use`
    tolerance: Tolerance | None = None  # 1e-4, unless there is a time_step
    time_step: Positive | None = None
    method: one_of("auto", "ark4", "ark5", "euler") = "auto"
    solver: one_of("auto", "dense", "matrix-free") = "auto"
    neighbours: Count = 8
    certify: Flag | None = None  # a run makes the estimate unless this is false

    @model_validator(mode="before")
    @classmethod
    def _has_a_tolerance_or_a_step(cls, values: Any) -> Any:
        if isinstance(values, dict) and values.get("tolerance") is None and values.get("time_step") is None:
            return values | {"tolerance": 1e-4}
        return values

    @model_validator(mode="after")
    def _one_control_of_the_step(self) -> "NumericsTable":
        if self.tolerance is not None and self.time_step is not None:
            raise refusal("no time_step beside a tolerance: one of the two", "time_step", self.time_step)
        if self.method == "euler" and self.time_step is None:
            wanted = '"auto", "ark4" or "ark5", or a time_step: "euler" has no error estimate'
            raise refusal(wanted, "method", self.method)
        return self


class SceneFile(Table):
    """A complete scene file."""

    t_end: Positive = None
    saves: Count = 200
    average: Window | None = None
    vesicle: Annotated[
        tuple[choice(EllipseVesicle, CircleVesicle, PointsVesicle, default="ellipse"), ...],
        Field(strict=False),
        BeforeValidator(_tables),
    ] = None
    pair: PairTable | None = None
    fluid: FluidTable | None = None
    field: FieldTable | None = None
    flow: choice(ShearFlow, ExtensionFlow, LinearFlow, PoiseuilleFlow) | None = None
    cell: CellTable | None = None
    suspension: SuspensionTable | None = None  # None again when it has been read: then `vesicle` has the copies
    stop: StopTable | None = None
    numerics: NumericsTable = NumericsTable()

    def vesicles(self, xp: Any = math) -> tuple[VesicleTable, ...]:
        """Returns all vesicles, a pair as two. `xp` is as in `PairTable.offset`."""
        if self.pair is None:
            return self.vesicle
        dx, dy = self.pair.offset(xp)
        (one,) = self.vesicle
        x, y = one.center
        return tuple(one.model_copy(update={"center": (x + s * dx, y + s * dy)}) for s in (-1, 1))

    @model_validator(mode="after")
    def _placed(self) -> "SceneFile":
        return self if self.suspension is None else with_copies(self)

    @model_validator(mode="after")
    def _hangs_together(self) -> "SceneFile":
        if self.average is not None and self.average[1] > self.t_end:
            raise refusal(f"two times [a, b] with 0 <= a < b <= t_end = {self.t_end}", "average", self.average)
        if self.pair is not None and len(self.vesicle) != 1:
            raise refusal(f"exactly one [[vesicle]] to copy, not {len(self.vesicle)}", "pair", {})
        if self.field is None:
            self._has_nothing_electric()
        else:
            check_field(self)
        if self.flow is not None:
            check_step(self, self.flow.time, "flow")
        if self.cell is not None:
            check_beside_cell(self)
        check_undulations(self.vesicle, self.numerics.nodes)
        self._is_clear_of_contact()
        return self

    def _has_nothing_electric(self) -> None:
        for i, vesicle in enumerate(self.vesicle):
            for name in (number.key for number in physical_numbers.PER_VESICLE):
                value = getattr(vesicle, name)
                if value is not None:
                    raise refusal(f"a [field], without which no {name} matters", f"vesicle[{i}].{name}", value)
        if self.stop is not None and self.stop.class_ is not None:
            raise refusal("a [field], along which a vesicle is prolate or oblate", "stop.class", self.stop.class_)

    def _is_clear_of_contact(self) -> None:
        vesicles = self.vesicles()
        if len(vesicles) == 1 and self.cell is None:
            return
        polygons = [outlines.placed(v.polygon(), v.length, v.angle, v.center) for v in vesicles]
        touching = outlines.first_touching(polygons, None if self.cell is None else self.cell.lattice)
        if touching is None:
            return
        i, j = touching
        if self.pair is not None:
            expected = "more: vesicle[0] and vesicle[1], the two copies, overlap or touch at the start"
            raise refusal(expected, "pair.separation", self.pair.separation)
        if i == j:
            expected = f"less than the cell has room for: vesicle[{i}] overlaps or touches its own image at the start"
            raise refusal(expected, f"vesicle[{i}].length", vesicles[i].length)
        expected = f"a place clear of vesicle[{i}]: vesicle[{i}] and vesicle[{j}] overlap or touch at the start"
        raise refusal(expected, f"vesicle[{j}].center", vesicles[j].center)
