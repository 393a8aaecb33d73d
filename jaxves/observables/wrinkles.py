r"""Whether a run missed wrinkles, because its start had nothing that they could grow from. Nothing here imports JAX.

A membrane under the tension -λ, with the perimeter 2πρ, makes ρ √(λ/3κ_B) waves. They grow at κ_B (λ/κ_B)^{3/2}/(6√3)
per t_κ. A real membrane always undulates. A smooth start has only round-off, which is much smaller and not
reproducible.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

_WAVES = 7.0  # with fewer, the compressed shape turns as a whole and does not wrinkle
_GROWTH = 1.0  # logarithm of the growth below which thermal undulations remain invisible


def missed_wrinkles(tables: Mapping[str, Any], t, tension_min, length) -> str | None:
    """Returns a sentence if compression made wrinkles grow from a start that nothing disturbs, otherwise None.

    `tables` are those of the scene; nothing is known without vesicles there, as of a result made in Python.
    `tension_min` and `length` (T, M) belong to the saved times t (T,).
    """
    if "vesicle" not in tables:
        return None
    if any("disturbance" in table or table.get("shape") == "points" for table in tables["vesicle"]):
        return None
    bending = np.resize([table["bending"] for table in tables["vesicle"]], np.shape(tension_min)[1])
    compression = np.maximum(-np.asarray(tension_min), 0.0) / bending
    waves = float(np.max(np.asarray(length) / (2 * np.pi) * np.sqrt(compression / 3)))
    growth = float(np.max(np.trapezoid(bending * compression**1.5 / (6 * np.sqrt(3)), t, axis=0)))
    if waves < _WAVES or growth < _GROWTH:
        return None
    return (
        f"Compression made about {waves:.0f} wrinkles around the membrane grow by a factor of e^{growth:.2g}, and the "
        "start has nothing that they grow from but round-off. Real membranes undulate: set `disturbance` of the "
        "vesicle to thermal undulations."
    )
