"""How strong the field or the flow of a scene file is, and which steps a strong one needs."""

from typing import Any

import numpy as np

from ..inputs.scene_tables import (
    FlowTable,
    LinearFlow,
    PoiseuilleFlow,
    SceneFile,
    SineTime,
    TabulatedTime,
    TimeTable,
)

STRONG = 300.0  # stress in units of κ_B/a³; weaker ones make no wrinkle that grows much faster than the shape moves
_PER_GROWTH = 2.0  # implicit stages are accurate for waves that grow at less than this over the step
_FLOW = 4.0  # a flow loads the shape like a field with β/χ = 4 Ca
_FIRST = 1e-2  # the first step, relative to the time scales of the field and the flow


def stress(scene_file: SceneFile) -> float:
    """Returns the largest stress of field and flow in units of κ_B/a³.

    It is β/χ times the largest squared factor of time, and times a permittivity ratio above one, because the inner
    field acts with it. For a flow it is four times the largest rate of strain. On a vesicle with another length and
    bending stiffness, a stress acts like a stress that is length³/bending times as large on a usual one.
    """
    loads = _loads(scene_file)
    return max(loads, default=0.0) * max(float(v.length**3 / v.bending) for v in scene_file.vesicles())


def strong_steps(scene_file: SceneFile) -> dict[str, Any]:
    """Returns arguments of `Adaptive` for a strong field or flow; none for others.

    The first step is a fraction of the time in which the field or the flow deforms the vesicle, and of that in which
    the field charges it.
    """
    if stress(scene_file) <= STRONG:
        return {}
    times = [1 / max(_loads(scene_file))] + ([] if scene_file.field is None else [scene_file.field.chi])
    return {"per_growth": _PER_GROWTH, "first": min(1e-4, _FIRST * min(times))}


def _loads(scene_file: SceneFile) -> list[float]:
    """Returns the stresses of field and flow in units of κ_B/a³; none if both are absent or zero."""
    field, flow = scene_file.field, scene_file.flow
    found = []
    if field is not None:
        own = [vesicle.permittivity_ratio for vesicle in scene_file.vesicles()]
        ratios = [field.permittivity_ratio if ratio is None else ratio for ratio in own]
        found.append(field.beta / field.chi * max(1.0, *ratios) * _largest_factor(field.time) ** 2)
    if flow is not None:
        found.append(_FLOW * _rate(flow) * _largest_factor(flow.time))
    return [load for load in found if load > 0]


def _largest_factor(time: TimeTable | None) -> float:
    match time:
        case SineTime():
            return abs(time.offset) + abs(time.amplitude)
        case TabulatedTime():
            return max(map(abs, time.values))
    return 1.0


def _rate(flow: FlowTable) -> float:
    match flow:
        case LinearFlow():
            return float(np.max(np.abs(flow.gradient)))
        case PoiseuilleFlow():
            return 2 * abs(flow.capillary_number) / flow.half_width**2
    return abs(flow.capillary_number)
