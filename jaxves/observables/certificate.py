"""How many digits of a result to trust: what should hold exactly, and by how much it does not.

Every link is the error, at worst over all saved times and vesicles, of something known: of one step against the
embedded method, of the finest modes against the coarsest, of a conserved quantity, of a balance. Digits are
-log₁₀ of it; a chain is as strong as its weakest link. Only the link "run", from a second run with other nodes and
other steps, sees how a scene amplifies errors: where close starts part from each other, so does the computed history
from the true one, and digits are lost at that rate. A result with less than one digit is `inaccurate`.

The links are made of maxima over rows (`maxima`), which combine by maximum: for NumPy arrays of a file, and for traced
arrays inside a run. Nothing here imports JAX.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

LEAST_DIGITS = 1.0  # below which a result is inaccurate
_AT_REST = 1e-6  # of the bending energy: powers per t_κ below this are those of a vesicle at rest


class Link(NamedTuple):
    """One estimate: its value, unit and meaning."""

    value: float
    units: str
    long_name: str

    @property
    def digits(self) -> float:
        """Decimal digits that it leaves; at most 16."""
        return float(-np.log10(np.clip(self.value, 1e-16, None)))


_DIRECT = {
    "time": ("time_error", "a", "sum of the estimated errors of all steps"),
    "space": ("spectral_tail", "1", "top of the spectrum of x and V_m over its largest mode"),
    "tension": ("tension_tail", "1", "top of the spectrum of the tension over its largest mode"),
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
    """What the links are made of, by name: the greatest values in these rows, of which there may be one or many.

    `first` has "area" and "length" (M,) at the start. `xp` has the functions for the arrays: numpy or jax.numpy.
    """
    found = {name: xp.max(xp.abs(diagnostics[of])) for name, (of, *_) in _DIRECT.items() if of in diagnostics}
    found |= {name: xp.max(xp.abs(diagnostics[name] / first[name] - 1)) for name in ("area", "length")}
    found["powers"] = xp.max(xp.stack([xp.max(xp.abs(diagnostics[of])) for of in _POWERS if of in diagnostics]))
    found["lacking"] = xp.max(xp.abs(diagnostics["power_balance"]))
    found["bending"] = xp.max(diagnostics["bending_energy"])
    return found


def values(greatest: Mapping[str, Any]) -> dict[str, Any]:
    """The value of every link but "run", from the `maxima` of all rows."""
    found = {name: greatest[name] for name in (*_DIRECT, "area", "length") if name in greatest}
    return found | {"energy": greatest["lacking"] / (greatest["powers"] + _AT_REST * greatest["bending"])}


def is_inaccurate(greatest: Mapping[str, Any], xp: Any = np) -> Any:
    """Whether a link leaves less than one digit, or is not a number; may be traced."""
    return ~(xp.max(xp.stack(list(values(greatest).values()))) < 10.0**-LEAST_DIGITS)


def certificate(diagnostics: Mapping[str, np.ndarray], error: float | None = None) -> dict[str, Link]:
    """The links of a result by name, from its diagnostics with the saved times as first axis, at least one.

    `error` is that of the whole run, where it was estimated. A method without an embedded one has no link "time";
    without a field there is no "charge".
    """
    links = {} if error is None or np.isnan(error) else {"run": Link(error, "a", "estimated error of the whole run")}
    first = {name: diagnostics[name][0] for name in ("area", "length")}
    for name, value in values(maxima(diagnostics, first)).items():
        units, long_name = _DIRECT[name][1:] if name in _DIRECT else ("1", _DERIVED[name])
        links[name] = Link(float(value), units, long_name)
    return links


def weakest(links: Mapping[str, Link]) -> str:
    """The name of the link with the fewest digits; one that is not a number comes first."""
    return min(links, key=lambda name: -np.inf if np.isnan(links[name].value) else links[name].digits)
