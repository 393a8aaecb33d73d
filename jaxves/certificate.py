"""How many digits of a result to trust: what should hold exactly, and by how much it does not.

Every link is the error, at worst over all saved times and vesicles, of something known: of one step against the
embedded method, of the finest modes against the coarsest, of a conserved quantity, of a balance. Digits are
-log₁₀ of it; a chain is as strong as its weakest link. Only the link "run", from a second run with another
tolerance, sees how a scene amplifies errors: where close starts part from each other, so does the computed history
from the true one, and digits are lost at that rate.

Nothing here imports JAX.
"""

from typing import NamedTuple

import numpy as np


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
_KEPT = {"area": "relative change of an enclosed area", "length": "relative change of a perimeter"}
_POWERS = ("power_flow", "power_electric", "dissipation")


def certificate(diagnostics: dict[str, np.ndarray], error: float | None = None) -> dict[str, Link]:
    """The links of a result by name, from its diagnostics with the saved times as first axis, at least one.

    `error` is that of the whole run, where it was estimated. A method without an embedded one has no link "time";
    without a field there is no "charge".
    """
    links = {} if error is None or np.isnan(error) else {"run": Link(error, "a", "estimated error of the whole run")}
    links |= {
        name: Link(float(np.max(np.abs(diagnostics[source]))), units, long_name)
        for name, (source, units, long_name) in _DIRECT.items()
        if source in diagnostics
    }
    for name, long_name in _KEPT.items():
        values = diagnostics[name]
        links[name] = Link(float(np.max(np.abs(values / values[0] - 1))), "1", long_name)
    powers = np.max([np.max(np.abs(diagnostics[name])) for name in _POWERS if name in diagnostics])
    balance = float(np.max(np.abs(diagnostics["power_balance"])) / max(powers, np.finfo(float).tiny))
    links["energy"] = Link(balance, "1", "what the balance of powers lacks over the greatest of them")
    return links


def weakest(links: dict[str, Link]) -> str:
    """The name of the link with the fewest digits; one that is not a number comes first."""
    return min(links, key=lambda name: -np.inf if np.isnan(links[name].value) else links[name].digits)
