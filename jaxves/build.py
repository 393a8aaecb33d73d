"""From a scene file to a scene: nodes on curves, radians for degrees, arrays for numbers."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import curve, flow, history, outlines, shapes
from .arrays import NodePoints
from .electric import Field
from .scene import Scene
from .scenetables import (
    ExtensionFlow,
    LinearFlow,
    PulseTime,
    SceneFile,
    ShearFlow,
    SineTime,
    TabulatedTime,
    TimeTable,
)
from .vesicletables import CircleVesicle, EllipseVesicle, PointsVesicle, VesicleTable

_NODES = 64  # to begin with, where the number is found while running ("auto")


def build(scene_file: SceneFile) -> Scene:
    """The scene as the file describes it; vesicles to be relaxed first are not relaxed yet."""
    N = _NODES if scene_file.numerics.nodes == "auto" else scene_file.numerics.nodes
    vesicles = scene_file.vesicles
    return Scene(
        jnp.stack([_nodes(vesicle, N) for vesicle in vesicles]),
        jnp.array([vesicle.bending for vesicle in vesicles]),
        _field(scene_file),
        _flow(scene_file),
    )


def _nodes(vesicle: VesicleTable, N: int) -> NodePoints:
    angle = math.radians(vesicle.angle)
    match vesicle:
        case EllipseVesicle():
            x = shapes.ellipse(N, vesicle.reduced_area, angle=angle, length=vesicle.length)
        case CircleVesicle():
            x = shapes.rotated(shapes.circle(N, length=vesicle.length), angle)
        case PointsVesicle():
            x = _resampled(N, outlines.smooth(np.array(vesicle.points)), angle, vesicle.length)
    return x + np.array(vesicle.center)


@partial(jax.jit, static_argnums=0)
def _resampled(N: int, samples, angle, length) -> NodePoints:
    x = shapes.equispaced(samples, N)
    x = x - curve.centroid(curve.Curve.from_nodes(x))
    return shapes.rotated(shapes.scaled(x, length), angle)


def _field(scene_file: SceneFile) -> Field | None:
    table = scene_file.field
    if table is None:
        return None

    def each(key: str) -> Float[Array, "M"]:
        own = [getattr(vesicle, key) for vesicle in scene_file.vesicles]
        return jnp.array([getattr(table, key) if value is None else value for value in own])

    return Field(
        beta=table.beta,
        chi=table.chi,
        conductivity_ratio=each("conductivity_ratio"),
        membrane_conductance=each("membrane_conductance"),
        membrane_chi=each("chi"),
        permittivity_ratio=each("permittivity_ratio"),
        direction=table.direction,
        history=_history(table.time),
    )


def _history(table: TimeTable | None) -> history.AbstractHistory | None:
    match table:
        case PulseTime():
            return history.Pulse(table.start, table.duration, table.rise)
        case SineTime():
            return history.Sine(table.frequency, table.amplitude, table.offset, math.radians(table.phase))
        case TabulatedTime():
            return history.Table(table.times, table.values)
    return None


def _flow(scene_file: SceneFile) -> flow.AbstractFlow | None:
    table = scene_file.flow
    match table:
        case ShearFlow():
            return flow.Shear(table.capillary_number)
        case ExtensionFlow():
            return flow.Extension(table.capillary_number)
        case LinearFlow():
            return flow.Linear(table.gradient)
    return None
