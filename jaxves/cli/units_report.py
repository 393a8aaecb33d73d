"""The text that `jaxves units` prints: numbers, scales, the regime with the limits of the model, tables of a scene."""

import math
from collections.abc import Iterator

import equinox as eqx
import tomli_w
from rich.console import RenderableType
from rich.table import Table

from ..base.physical_numbers import BETA, CAPILLARY_NUMBER, CHI, CONDUCTIVITY_RATIO, MEMBRANE_CONDUCTANCE
from ..physics.regime import limits, regime
from ..physics.units import LabQuantities

_DISTURBANCE = 1e-4  # in units of a; thermal undulations of a giant vesicle are of this size
_NUMBERS = (BETA, CHI, CONDUCTIVITY_RATIO, MEMBRANE_CONDUCTANCE, CAPILLARY_NUMBER)
_SCALES = {
    "length": ("m", "a, lengths"),
    "time": ("s", "t_κ, times"),
    "velocity": ("m/s", "velocities"),
    "tension": ("N/m", "tensions"),
    "stress": ("Pa", "forces per area"),
    "energy": ("J/m", "energies, per depth"),
    "V_m": ("V", "transmembrane potentials"),
    "charge": ("V/m", "jumps of the normal field"),
    "maxwell_stress": ("Pa", "ε E²"),
    "charging_time": ("s", "χ t_κ = a C_m/σ_e"),
}
_REGIME = {
    "reynolds": ("", "Reynolds number; the model has no inertia"),
    "voltage": ("V", "1.5 E a, across the charged membrane"),
    "flow_time": ("s", "μ/(ε E²), time of deformation by the field"),
    "charged_after": ("s", "charging time of the membrane"),
    "relaxation_time": ("s", "time for charge to reach the membrane; neglected"),
    "wrinkles": ("", "number of waves on the compressed membrane"),
    "growth": ("", "ln of the growth of the waves; invisible below 1"),
    "nodes": ("", "nodes that resolve the waves, at least 64"),
}


def conversion(physical: LabQuantities, reduced_area: float) -> Iterator[RenderableType]:
    """Yields the dimensionless numbers, the units of results, the regime with a line for each limit, and scene tables.

    The reduced area, in (0, 1), is used for the regime only.
    """
    numbers, scales = _floats(physical.numbers()), _floats(physical.scales())
    table = Table("number", "", "meaning", box=None, padding=(0, 2, 0, 0))
    for number in _NUMBERS:
        formula = f": {number.in_laboratory_units}" if number.in_laboratory_units else ""
        table.add_row(number.key, f"{numbers[number.key]:.6g}", f"{number.description()}{formula}")
    yield table
    yield ""
    table = Table("scale", "", "unit", "of", box=None, padding=(0, 2, 0, 0))
    for name, (unit, meaning) in _SCALES.items():
        table.add_row(name, f"{scales[name]:.6g}", unit, meaning)
    yield table
    yield ""
    yield from _regime(physical, reduced_area)
    yield ""
    yield tomli_w.dumps(tables(numbers)).rstrip()


def _regime(physical: LabQuantities, reduced_area: float) -> Iterator[RenderableType]:
    found = regime(physical, reduced_area)
    table = Table("regime", "", "unit", "meaning", box=None, padding=(0, 2, 0, 0))
    if found.voltage is not None:
        B = float(physical.scales().maxwell_stress / physical.scales().stress)
        table.add_row("B", f"{B:.3g}", "", "β/χ, stress of the field / bending stress")
    for name, (unit, meaning) in _REGIME.items():
        value = getattr(found, name)
        if value is not None:
            table.add_row(name, str(value) if name == "nodes" else f"{value:.3g}", unit, meaning)
    yield table
    for sentence in limits(found):
        yield f"! {sentence}"


def _floats(tree: eqx.Module) -> dict[str, float]:
    return {name: float(value) for name, value in vars(tree).items()}


def scene_of_laboratory(physical: LabQuantities, reduced_area: float) -> dict:
    """Returns a scene with these quantities: an ellipse along the field, for ten times the slowest time.

    This is the longest of the times of deformation, charging and shear. Where wrinkles grow, the start is
    disturbed, because a smooth one would miss them. Without field and flow the vesicle relaxes for the time t_κ.
    """
    numbers, found = _floats(physical.numbers()), regime(physical, reduced_area)
    t_kappa = float(physical.scales().time)
    times = [] if found.flow_time is None else [found.flow_time / t_kappa]
    if found.charged_after is not None and math.isfinite(found.charged_after):
        times.append(found.charged_after / t_kappa)
    if numbers["capillary_number"] != 0:
        times.append(1 / abs(numbers["capillary_number"]))
    vesicle: dict = {"reduced_area": reduced_area, "angle": 90.0}
    if found.growth is not None and found.growth >= 1:
        vesicle["disturbance"] = _DISTURBANCE
    scene = {"t_end": 10 * max(times) if times else 1.0, "vesicle": [vesicle]}
    return scene | tables(numbers) | {"numerics": {"nodes": "auto"}}


def tables(numbers: dict[str, float]) -> dict[str, dict]:
    """Returns the tables [field] and [flow] of a scene file with these numbers, if they are not zero."""
    found = {}
    if numbers["beta"] != 0:
        found["field"] = {number.key: numbers[number.key] for number in _NUMBERS if number.table == "field"}
    if numbers["capillary_number"] != 0:
        found["flow"] = {"kind": "shear", "capillary_number": numbers["capillary_number"]}
    return found
