"""The types of the keys of scene files, each with the text for its error message."""

import itertools
import math
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from ..base import bounds
from ..base.physical_numbers import Number
from .checking import Expect, number


def _if(holds: Callable[[Any], bool]) -> AfterValidator:
    def check(value):
        if not holds(value):
            raise ValueError
        return value

    return AfterValidator(check)


def _unit(value: tuple[float, float]) -> tuple[float, float]:
    size = math.hypot(*value)
    if size == 0:
        raise ValueError
    # A unit vector is not changed.
    return value if abs(size - 1) < 1e-15 else (value[0] / size, value[1] / size)


def _increasing(value: tuple[float, ...]) -> bool:
    return all(a < b for a, b in itertools.pairwise(value))


def _trace_free(value: tuple[tuple[float, float], ...]) -> bool:
    return abs(value[0][0] + value[1][1]) <= 1e-12 * max(map(abs, value[0] + value[1]))


def key(declared: Number) -> Any:
    """Returns the type of the key for a physical number: a float within its bounds, with its default."""
    return Annotated[number(declared.bounds), Field(default=declared.default)]


def optional_key(declared: Number) -> Any:
    """Returns the type of the key for a physical number that may be absent; it is then None."""
    return Annotated[number(declared.bounds) | None, Field(default=None)]


Finite = number(bounds.FINITE)
Positive = number(bounds.POSITIVE)
Tolerance = number(bounds.TOLERANCE)
Count = Annotated[int, Field(ge=1), Expect("a whole number >= 1")]
Seed = Annotated[int, Field(ge=0), Expect("a whole number >= 0")]
NodeCount = Annotated[
    Annotated[int, Field(ge=16), _if(lambda value: value % 2 == 0)] | Literal["auto"],
    Expect('an even whole number >= 16, or "auto"'),
]
Flag = Annotated[bool, Expect("true or false")]
Text = Annotated[str, Expect("a text in quotes")]

# TOML arrays are stored as tuples. Their numbers are checked strictly.
_ARRAY = Field(strict=False)
Pair = Annotated[tuple[Finite, Finite], _ARRAY, Expect("two finite numbers")]
Direction = Annotated[Pair, AfterValidator(_unit), Expect("two finite numbers, not both zero")]
Window = Annotated[
    Pair,
    _if(lambda value: 0 <= value[0] < value[1]),
    Expect("two times [a, b] with 0 <= a < b <= t_end"),
]
Numbers = Annotated[tuple[Finite, ...], _ARRAY, Expect("a list of finite numbers")]
Times = Annotated[Numbers, Field(min_length=2), _if(_increasing), Expect("two or more increasing times")]
Gradient = Annotated[
    tuple[Pair, Pair],
    _ARRAY,
    _if(_trace_free),
    Expect("a trace-free gradient [[a, b], [c, -a]] of finite numbers"),
]
Lattice = Annotated[
    tuple[Pair, Pair],
    _ARRAY,
    _if(lambda value: value[0][0] * value[1][1] > value[0][1] * value[1][0]),
    Expect("two vectors [[x, y], [x, y]], the second to the left of the first"),
]
PointList = Annotated[tuple[Pair, ...], _ARRAY, Expect("a list of points [x, y]")]
