"""Bounds of numbers. Scene files and Python functions use the same ones, also for traced numbers.

Which physical number has which bounds is declared in `physical_numbers`. Nothing here imports JAX.
"""

import dataclasses
from typing import Any


@dataclasses.dataclass(frozen=True)
class Bounds:
    """The allowed values of a number: above `gt`, at least `ge` and at most `le`.

    It is finite unless `finite` is false, and not zero if `nonzero` is true. `expected` says the same in words, for
    error messages.
    """

    expected: str
    gt: float | None = None
    ge: float | None = None
    le: float | None = None
    finite: bool = True
    nonzero: bool = False

    def hold(self, value: Any) -> Any:
        """Returns for each entry whether it is within the bounds; takes numbers, NumPy arrays and traced arrays."""
        within = value == value  # false for NaN
        if self.finite:
            within = within & (abs(value) < float("inf"))
        if self.gt is not None:
            within = within & (value > self.gt)
        if self.ge is not None:
            within = within & (value >= self.ge)
        if self.le is not None:
            within = within & (value <= self.le)
        if self.nonzero:
            within = within & (value != 0)
        return within


FINITE = Bounds("a finite number")
NONZERO = Bounds("a finite number other than zero", nonzero=True)
POSITIVE = Bounds("a positive finite number", gt=0.0)
NOT_NEGATIVE = Bounds("a finite number >= 0", ge=0.0)
RATIO = Bounds("a number >= 0, or inf", ge=0.0, finite=False)
VISCOSITY_RATIO = Bounds("a number in [1e-6, 1e8]", ge=1e-6, le=1e8)
RATIO_OF_RELAXING = Bounds("a finite number >= 0, because charge_relaxation is given", ge=0.0)
REDUCED_AREA = Bounds("a number in (0, 1]", gt=0.0, le=1.0)
TOLERANCE = Bounds("a number in [1e-12, 0.1]", ge=1e-12, le=0.1)
