"""How strong the field or the flow of a scene file is, and which steps a strong one needs."""

from typing import Any

import numpy as np

from ..inputs.scene_tables import FlowTable, LinearFlow, SceneFile

STRONG = 300.0  # stress in units of κ_B/a³; weaker ones make no wrinkle that grows much faster than the shape moves
_PER_GROWTH = 2.0  # implicit stages are accurate for waves that grow at less than this over the step
_FLOW = 4.0  # a flow loads the shape like a field with β/χ = 4 Ca
_FIRST = 1e-2  # the first step, relative to the time scales of the field and the flow


def stress(scene_file: SceneFile) -> float:
    """Returns the largest stress of field and flow in units of κ_B/a³: β/χ, or four times the capillary number."""
    field, flow = scene_file.field, scene_file.flow
    found = [0.0]
    if field is not None:
        found.append(field.beta / field.chi)
    if flow is not None:
        found.append(_FLOW * _rate(flow))
    return max(found)


def strong_steps(scene_file: SceneFile) -> dict[str, Any]:
    """Returns arguments of `Adaptive` for a strong field or flow; none for others.

    The first step is a fraction of the time in which the field or the flow deforms the vesicle, and of that in which
    the field charges it.
    """
    largest = stress(scene_file)
    if largest <= STRONG:
        return {}
    times = [1 / largest] + ([] if scene_file.field is None else [scene_file.field.chi])
    return {"per_growth": _PER_GROWTH, "first": min(1e-4, _FIRST * min(times))}


def _rate(flow: FlowTable) -> float:
    if isinstance(flow, LinearFlow):
        return float(np.max(np.abs(flow.gradient)))
    return abs(flow.capillary_number)
