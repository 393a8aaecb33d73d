"""The tables of a sweep file: a scene, and the values of some of its numbers.

The cases come from exactly one of `[axes]` (a grid), `[[cases]]` (a list) and `[sample]` (a low-discrepancy sample).
Names are those of `parameters`. Nothing here imports JAX.
"""

from typing import Annotated, Any

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from .checking import Expect, Table, one_of, refusal
from .key_types import Count, Finite
from .scene_tables import SceneFile

# Any number is allowed here; the tables of the scene check its value.
_Number = Annotated[float, Expect("a number")]
_Limits = Annotated[
    tuple[Count, Count], Field(strict=False), Expect("two numbers of steps, of the first pass and of the second")
]


class Span(Table):
    """`num` values from start to stop, both included, with equal differences or equal ratios."""

    start: Finite = None
    stop: Finite = None
    num: Annotated[int, Field(ge=2), Expect("a whole number >= 2")] = None
    spacing: one_of("linear", "log") = "linear"

    @model_validator(mode="after")
    def _goes_somewhere(self) -> "Span":
        if self.start == self.stop:
            raise refusal("another number than start", "stop", self.stop)
        if self.spacing == "log" and not (self.start > 0 and self.stop > 0):
            raise refusal('"linear", or a positive start and stop', "spacing", self.spacing)
        return self


def _values(value: Any) -> Any:
    if isinstance(value, dict | Span):
        return value
    if not isinstance(value, list | tuple) or not value:
        raise refusal("a list of numbers, or { start = …, stop = …, num = … }")
    return value


def _named(value: Any) -> Any:
    if not isinstance(value, dict) or not value:
        raise refusal('one or more names with their values, as in "field.beta" = [1.0, 2.0]')
    return value


def _kind(value: Any) -> str:
    return "axis=span" if isinstance(value, dict | Span) else "axis=list"


_Axis = Annotated[
    Annotated[tuple[_Number, ...], Field(strict=False), Tag("axis=list")] | Annotated[Span, Tag("axis=span")],
    Discriminator(_kind),
    BeforeValidator(_values),
]
_Case = Annotated[dict[str, _Number], BeforeValidator(_named)]
_Range = Annotated[tuple[Finite, Finite], Field(strict=False), Expect("two finite numbers, least and greatest")]


class Sample(Table):
    """`num` cases that fill the box of these ranges evenly, from a scrambled sequence."""

    num: Count = None
    sequence: one_of("halton", "sobol") = "halton"
    seed: Annotated[int, Field(ge=0), Expect("a whole number >= 0")] = 0
    ranges: Annotated[dict[str, _Range], BeforeValidator(_named)] = None

    @model_validator(mode="after")
    def _suits_the_sequence(self) -> "Sample":
        if self.sequence == "sobol" and self.num & (self.num - 1):
            raise refusal('a power of two, or sequence = "halton"', "num", self.num)
        return self


class Refine(Table):
    """Halves the cells of the grid in which the class changes, `levels` times, along these axes (default: all)."""

    levels: Annotated[int, Field(ge=1, le=8), Expect("a whole number from 1 to 8")] = None
    along: Annotated[tuple[str, ...], Field(strict=False), Expect("a list of names of axes")] | None = None


class SweepFile(Table):
    """A complete sweep file with its scene."""

    scene: SceneFile = None
    axes: Annotated[dict[str, _Axis], BeforeValidator(_named)] | None = None
    cases: Annotated[tuple[_Case, ...], Field(strict=False)] | None = None
    sample: Sample | None = None
    refine: Refine | None = None
    keep: Annotated[tuple[one_of("history", "shapes"), ...], Field(strict=False)] = ()
    max_steps: _Limits = (2000, 40000)

    @model_validator(mode="after")
    def _has_cases(self) -> "SweepFile":
        sources = [key for key in ("axes", "cases", "sample") if getattr(self, key) is not None]
        if len(sources) != 1:
            raise refusal(f"one of [axes], [[cases]] and [sample], not {' and '.join(sources) or 'none'}", "axes", {})
        if self.cases is not None:
            names = set(self.cases[0]) if self.cases else set()
            for i, case in enumerate(self.cases):
                if set(case) != names:
                    raise refusal(f"the names of the first case: {', '.join(sorted(names))}", f"cases[{i}]", {})
            if not names:
                raise refusal("one or more [[cases]]", "cases", [])
        self._refines_a_grid_with_classes()
        return self

    def _refines_a_grid_with_classes(self) -> None:
        if self.refine is None:
            return
        if self.axes is None:
            raise refusal("[axes], whose cells it halves", "refine", {})
        if self.scene.field is None:
            raise refusal("a scene with a [field]: without one there are no classes", "refine", {})
        for name in self.refine.along or ():
            if name not in self.axes:
                raise refusal(f"names of axes: {', '.join(self.axes)}", "refine.along", list(self.refine.along))
