"""What `jaxves units` prints: numbers, scales, and the tables of a scene file, for one vesicle in SI."""

from collections.abc import Iterator

import equinox as eqx
import tomli_w
from rich.console import RenderableType
from rich.table import Table

from .units import Physical

_NUMBERS = {
    "beta": "β, field strength",
    "chi": "χ, charging time / t_κ",
    "conductivity_ratio": "Λ",
    "membrane_conductance": "G",
    "capillary_number": "Ca",
}
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
    "charging_time": ("s", "charging time of the membrane"),
}


def conversion(physical: Physical) -> Iterator[RenderableType]:
    """Dimensionless numbers, then what to multiply results by, then a [field] and a [flow]."""
    numbers, scales = _floats(physical.numbers()), _floats(physical.scales())
    table = Table("number", "", "meaning", box=None, padding=(0, 2, 0, 0))
    for name, meaning in _NUMBERS.items():
        table.add_row(name, f"{numbers[name]:.6g}", meaning)
    yield table
    yield ""
    table = Table("scale", "", "unit", "of", box=None, padding=(0, 2, 0, 0))
    for name, (unit, meaning) in _SCALES.items():
        table.add_row(name, f"{scales[name]:.6g}", unit, meaning)
    yield table
    yield ""
    yield tomli_w.dumps(tables(numbers)).rstrip()


def _floats(tree: eqx.Module) -> dict[str, float]:
    return {name: float(value) for name, value in vars(tree).items()}


def tables(numbers: dict[str, float]) -> dict[str, dict]:
    """The tables of a scene file that these numbers make; none for a field or a flow that is absent."""
    found = {}
    if numbers["beta"] != 0:
        found["field"] = {name: numbers[name] for name in _NUMBERS if name != "capillary_number"}
    if numbers["capillary_number"] != 0:
        found["flow"] = {"kind": "shear", "capillary_number": numbers["capillary_number"]}
    return found
