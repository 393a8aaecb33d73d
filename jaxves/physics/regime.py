r"""Estimates for a laboratory vesicle in a field, and the limits of the model for it.

The formulas hold for a nearly round vesicle of reduced area Δ, with ε₀ = √(2(1-Δ)/3) and B = β/χ.

    inner field of a circle, over E_∞   c = 2 (1 - w (1 - u))/(1 + Λ),  u = e^{-t/t_c},  w = Λ/(1+Λ) / (G + Λ/(1+Λ))
    charging time                       t_c = χ/(G + Λ/(1+Λ)), in t_κ
    load on the prolate shape           P = (B/8) (3 + (1 - Λc)² - 3c²), negative: it compresses the membrane
    tension                             λ = 2P/(3 ε₀ (1 + 1.8 ε₀)), in κ_B/a²; 1 + 1.8 ε₀ is accurate to 2 % for Δ ≥ 0.9
    fastest wrinkle                     k* = √(|λ|/3) waves around the vesicle, growing at |λ|^{3/2}/(6√3) per t_κ
    nodes                               N = 3 √|λ_min| for wrinkles to 0.1 %, with λ_min ≈ 1.27 λ

The growth exponent X is the integral of that rate while the load compresses the membrane. The load changes its sign
when the membrane is charged. With a conducting membrane this may not happen; then the integral covers the time 3ε₀/|P|
in which the shape becomes oblate. Thermal wrinkles grow by the factor e^X. For X < 1 they remain invisible; for X > 5
they cover the whole contour.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..base.resolution import AUTO_NODES
from .units import LabQuantities, Numbers

DENSITY = 1000.0  # kg/m³, of water
_LEAST_NODES = 64


class Regime(NamedTuple):
    """Estimates for one vesicle. Times are in s. Quantities that belong to a field are None without one."""

    reynolds: float  # Reynolds number of the flow that the field or the shear drives
    voltage: float | None  # 1.5 E a, in V: potential difference across the charged membrane of a sphere
    flow_time: float | None  # μ/(εE²): time in which the field deforms the vesicle
    charged_after: float | None  # t_c
    relaxation_time: float | None  # 2ε/(σ_i + σ_e): time in which charge reaches the membrane; zero in the model
    wrinkles: float | None  # k*, zero if the field does not compress the membrane
    growth: float | None  # X
    nodes: int | None


def regime(physical: LabQuantities, reduced_area: float) -> Regime:
    """Returns the estimates for one vesicle with reduced area in (0, 1)."""
    numbers = physical.numbers()
    a, mu, E, epsilon = (float(value) for value in (physical.a, physical.mu, physical.E, physical.epsilon))
    stress = epsilon * E**2
    reynolds = DENSITY * a**2 * max(stress / mu, abs(float(physical.shear_rate))) / mu
    if stress == 0:
        return Regime(reynolds, None, None, None, None, None, None, None)
    t_kappa = float(physical.scales().time)
    tension, growth = _compression(numbers, math.sqrt(2 * (1 - reduced_area) / 3))
    wrinkles = math.sqrt(tension / 3)
    nodes = math.ceil(3 * math.sqrt(1.27 * tension)) if growth >= 1 else 0
    return Regime(
        reynolds=reynolds,
        voltage=1.5 * E * a,
        flow_time=mu / stress,
        charged_after=_charging_time(numbers) * t_kappa,
        relaxation_time=2 * epsilon / float(physical.sigma_i + physical.sigma_e),
        wrinkles=wrinkles,
        growth=growth,
        nodes=max(_LEAST_NODES, nodes + nodes % 2),
    )


def _charging_time(numbers: Numbers) -> float:
    ratio = float(numbers.conductivity_ratio)
    rate = float(numbers.membrane_conductance) + ratio / (1 + ratio)
    return float(numbers.chi) / rate if rate > 0 else math.inf


def _compression(numbers: Numbers, epsilon_0: float) -> tuple[float, float]:
    """Returns |λ| when the field is switched on, and the growth exponent X; both are zero without compression."""
    ratio, B = float(numbers.conductivity_ratio), float(numbers.beta / numbers.chi)
    if ratio >= 1:
        return 0.0, 0.0

    def load(c):
        return -(3 + (1 - ratio * c) ** 2 - 3 * c**2) * B / 8

    def tension(c):
        return 2 * np.maximum(load(c), 0) / (3 * epsilon_0 * (1 + 1.8 * epsilon_0))

    def rate(c):
        return tension(c) ** 1.5 / (6 * math.sqrt(3))

    start = 2 / (1 + ratio)
    through = ratio / (1 + ratio)
    rest = float(numbers.membrane_conductance) + through
    end = start * (1 - through / rest) if rest > 0 else start
    balance = (math.sqrt(12 - 3 * ratio**2) - ratio) / (3 - ratio**2)  # where the load vanishes
    if end >= balance:
        return float(tension(start)), float(rate(start) * 3 * epsilon_0 / load(start))
    u = np.linspace((balance - end) / (start - end), 1.0, 2001)
    growth = _charging_time(numbers) * np.trapezoid(rate(end + (start - end) * u) / u, u)
    return float(tension(start)), float(growth)


def limits(found: Regime) -> Iterator[str]:
    """Yields one sentence for each limit of the model, or of the number of nodes, that this vesicle exceeds."""
    if found.reynolds > 0.1:
        yield (
            f"Inertia: the Reynolds number is {found.reynolds:.2g}. The model neglects inertia and holds for Reynolds "
            "numbers far below 1."
        )
    if found.voltage is None:
        return
    if found.voltage > 1:
        yield (
            f"Poration: the charged membrane would carry {found.voltage:.2g} V. Lipid membranes porate at about 1 V, "
            "which the model does not describe: shorten the pulse or weaken the field."
        )
    fastest = min(found.flow_time, found.charged_after)
    if found.relaxation_time > 0.1 * fastest:
        yield (
            f"Charge relaxation: charge takes {found.relaxation_time:.2g} s to reach the membrane, against "
            f"{fastest:.2g} s for the fastest motion. The model assumes that it arrives at once."
        )
    if found.nodes > AUTO_NODES[-1]:
        yield (
            f"Wrinkles: the field compresses the membrane into about {found.wrinkles:.0f} waves, which need "
            f'{found.nodes} nodes. Runs with nodes = "auto" have at most {AUTO_NODES[-1]}. With too few a run ends as '
            "unresolved or, if the start is not disturbed, misses the wrinkles. A weaker field or a smaller vesicle "
            "needs fewer nodes."
        )
