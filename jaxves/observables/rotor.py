r"""The field strength beyond which a circular vesicle turns by itself (Quincke rotation). Nothing here imports JAX.

Charge that lags behind a turning vesicle exerts a torque in the direction of the turning. In a field of strength β, a
circle at rest is unstable to rotation, for every viscosity inside, if β exceeds

    β_Q = (1 + 1/G + 1/Λ)² / (1/G² - δ/G - δ/Λ + δ ε_i/ε_e /Λ²)

and is stable in every field if the denominator is not positive. Without charge relaxation, δ = 0, this is
(1 + G (1+Λ)/Λ)². An insulating membrane, G = 0, has β_Q = 1 whatever the fluids are.
"""

import math
from collections.abc import Mapping
from typing import Any


def rotor_threshold(
    conductivity_ratio: float, membrane_conductance: float, *, delta: float = 0.0, permittivity_ratio: float = 1.0
) -> float:
    """Returns β_Q for a capacitance that is the reference; infinite if rest is stable in every field."""
    G, ratio = membrane_conductance, conductivity_ratio
    if ratio == 0:
        return 1.0 if G == 0 else math.inf
    # Numerator and denominator times G², so that G = 0 is no special case.
    denominator = 1 - delta * G + delta * G**2 * (permittivity_ratio / ratio - 1) / ratio
    return (G + 1 + G / ratio) ** 2 / denominator if denominator > 0 else math.inf


def threshold_of(tables: Mapping[str, Any]) -> float | None:
    """Returns β_Q of the one vesicle of a scene, from its tables; None without a constant field."""
    field = tables.get("field")
    if field is None or field.get("time", {}).get("kind", "constant") != "constant":
        return None
    own = field | {key: value for key, value in tables["vesicle"][0].items() if key in field}
    capacity = own["chi"] / field["chi"]
    found = rotor_threshold(
        own["conductivity_ratio"],
        own["membrane_conductance"],
        delta=field.get("charge_relaxation", 0.0) / capacity,
        permittivity_ratio=own["permittivity_ratio"],
    )
    return found / capacity
