"""Error estimates of a result: embedded errors, spectral tails, conserved quantities and balances.

Each estimate is called a link. It is the largest value over all saved times and vesicles. Its digits are -log₁₀ of this
value. The number of correct digits of a result is that of its weakest link. A result with less than one digit is
`inaccurate`.

Most links do not show how the flow amplifies errors. Only the link "run" does: it compares with a second run that has
other nodes and other steps. In a scene in which nearby states separate quickly, digits are lost at the same rate.

Links are computed from maxima over rows (`maxima`). The maximum of two such results is that of all their rows. NumPy
arrays from a file and traced arrays inside a run are both allowed. Nothing here imports JAX.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

LEAST_DIGITS = 1.0  # a result with fewer digits is inaccurate
# Relative to the bending energy: below this power per t_κ, a vesicle is at rest. What few nodes leave of the balance is
# a small part of it (3 % with 32 nodes), and means nothing.
_AT_REST = 1e-4


class Link(NamedTuple):
    """One error estimate: value, unit and meaning."""

    value: float
    units: str
    long_name: str

    @property
    def digits(self) -> float:
        """The number of correct decimal digits by this estimate, at most 16."""
        return float(-np.log10(np.clip(self.value, 1e-16, None)))


_DIRECT = {
    "time": ("time_error", "a", "sum of the estimated errors of all steps"),
    "space": ("spectral_tail", "1", "top of the spectrum of x and V_m over its largest mode"),
    "tension": ("tension_tail", "1", "top of the spectrum of the tension over its largest mode"),
    "averaging": ("averaged_swing", "a", "swing of the shape within a period of the field, which averaging leaves out"),
    "charge": ("charge", "E_inf a", "net charge of a membrane"),
    "force": ("force_residual", "1", "net force of a membrane over the integral of its size"),
    "torque": ("torque_residual", "1", "net torque of a membrane over the integral of its size"),
    "solves": ("residual", "1", "residual of the linear solves"),
}
_DERIVED = {
    "area": "relative change of an enclosed area",
    "length": "relative change of a perimeter",
    "energy": "what the balance of powers lacks over the greatest of them",
}
_POWERS = ("power_flow", "power_electric", "dissipation")


def maxima(diagnostics: Mapping[str, Any], first: Mapping[str, Any], xp: Any = np) -> dict[str, Any]:
    """Returns the maxima over these rows from which the links are computed, by name; one row or more.

    `first` has "area" and "length" (M,) at the start. `xp` is the array module, numpy or jax.numpy.
    """
    found = {name: xp.max(xp.abs(diagnostics[of])) for name, (of, *_) in _DIRECT.items() if of in diagnostics}
    found |= {name: xp.max(xp.abs(diagnostics[name] / first[name] - 1)) for name in ("area", "length")}
    found["powers"] = xp.max(xp.stack([xp.max(xp.abs(diagnostics[of])) for of in _POWERS if of in diagnostics]))
    found["lacking"] = xp.max(xp.abs(diagnostics["power_balance"]))
    found["bending"] = xp.max(diagnostics["bending_energy"])
    return found


def values(greatest: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the value of each link except "run", from the `maxima` of all rows."""
    found = {name: greatest[name] for name in (*_DIRECT, "area", "length") if name in greatest}
    return found | {"energy": greatest["lacking"] / (greatest["powers"] + _AT_REST * greatest["bending"])}


def is_inaccurate(greatest: Mapping[str, Any], xp: Any = np) -> Any:
    """Returns whether a link has less than one digit or is NaN; may be traced."""
    return ~(xp.max(xp.stack(list(values(greatest).values()))) < 10.0**-LEAST_DIGITS)


def has_enough_digits(links: Mapping[str, Link]) -> bool:
    """Returns whether every link of a `certificate` has at least one digit; a link that is NaN has none."""
    return bool(np.max([link.value for link in links.values()]) < 10.0**-LEAST_DIGITS)


def certificate(diagnostics: Mapping[str, np.ndarray], error: float | None = None) -> dict[str, Link]:
    """Returns the links of a result by name, from its diagnostics. Their first axis has at least one saved time.

    `error` is the estimated error of the whole run, None if it was not estimated. There is no link "time" for schemes
    without an embedded error, no link "charge" without a field, and a link "averaging" only in a field that is averaged
    over its period.
    """
    links = {} if error is None or np.isnan(error) else {"run": Link(error, "a", "estimated error of the whole run")}
    first = {name: diagnostics[name][0] for name in ("area", "length")}
    for name, value in values(maxima(diagnostics, first)).items():
        units, long_name = _DIRECT[name][1:] if name in _DIRECT else ("1", _DERIVED[name])
        links[name] = Link(float(value), units, long_name)
    return links


def weakest(links: Mapping[str, Link]) -> str:
    """Returns the name of the link with the fewest digits. A link that is NaN comes first."""
    return min(links, key=lambda name: -np.inf if np.isnan(links[name].value) else links[name].digits)
