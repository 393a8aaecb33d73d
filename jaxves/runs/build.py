"""Builds a scene from a scene file: nodes on curves, radians instead of degrees, arrays instead of numbers.

The tables of the file may contain traced arrays instead of numbers (`inputs/parameters.py`).
"""

import math
from collections.abc import Callable, Mapping
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.arguments import is_known
from ..base.physical_numbers import PER_VESICLE
from ..base.resolution import DEFAULT_NODES, nodes_for_modes
from ..geometry import curve, outlines, shapes
from ..geometry.domain import Cell
from ..inputs.cell_tables import CellTable
from ..inputs.checking import SceneError
from ..inputs.parameters import with_numbers
from ..inputs.scene_tables import (
    AcTime,
    ExtensionFlow,
    FieldTable,
    FlowTable,
    FluidTable,
    LinearFlow,
    PoiseuilleFlow,
    PulseTime,
    SceneFile,
    ShearFlow,
    SineTime,
    TabulatedTime,
    TimeTable,
)
from ..inputs.vesicle_tables import (
    CircleVesicle,
    DeformableVesicle,
    EllipseVesicle,
    PointsVesicle,
    UndulationTable,
    VesicleTable,
    undulation_modes,
)
from ..numerics.arrays import NodePoints, ScalarLike, as_float
from ..physics import flow, waveform
from ..physics.electric import Field
from ..physics.scene import Scene, make_scene
from .programs import compiled


def build(scene_file: SceneFile) -> Scene:
    """Returns the scene that the file describes. Vesicles with `relaxed = true` are not relaxed yet.

    Raises:
        SceneError: the thermal undulations of a vesicle need more length than its shape has.
    """
    vesicles = scene_file.vesicles(jnp)
    N = DEFAULT_NODES if scene_file.numerics.nodes is None else scene_file.numerics.nodes
    if N == "auto":
        N = nodes_for_modes(max(undulation_modes(vesicle) for vesicle in vesicles))
    return make_scene(
        [_nodes(vesicle, N) for vesicle in vesicles],
        bending=jnp.stack([as_float(vesicle.bending) for vesicle in vesicles]),
        viscosity_ratio=_viscosity_ratio(scene_file.fluid, vesicles),
        field=_field(scene_file.field, vesicles),
        flow=_flow(scene_file.flow),
        cell=_cell(scene_file.cell),
    )


def scene_of(scene_file: SceneFile, values: Mapping[str, ScalarLike]) -> Scene:
    """Returns the scene with `values` in place of the numbers of the file with these names.

    The function is pure, and differentiable and batchable in the values. Vesicles with `relaxed = true` are not relaxed
    yet (`Case.at_rest`). Values are not checked.

    Raises:
        SceneError: the scene has no number with such a name.
    """
    return build(with_numbers(scene_file, values))


def _nodes(vesicle: VesicleTable, N: int) -> NodePoints:
    angle = _radians(vesicle.angle)
    match vesicle:
        case EllipseVesicle():
            x = _made(shapes.ellipse, (N,), {}, reduced_area=vesicle.reduced_area, angle=angle, length=vesicle.length)
        case CircleVesicle():
            x = shapes.rotated(shapes.circle(N, length=vesicle.length), angle)
        case PointsVesicle():
            x = _resampled(N, outlines.smooth(np.array(vesicle.points), vesicle.modes), angle, vesicle.length)
    match vesicle.disturbance if isinstance(vesicle, DeformableVesicle) else None:
        case None:
            pass
        case UndulationTable() as thermal:
            numbers = {"temperature": thermal.temperature, "tension": thermal.tension}
            try:
                x = _made(_undulated, (x, np.int64(thermal.seed)), {"modes": thermal.modes}, **numbers)
            except ValueError as error:
                raise SceneError(f"vesicle.disturbance.{error}") from None
        case amplitude:
            x = shapes.disturbed(x, amplitude)
    return x + jnp.stack([as_float(component) for component in vesicle.center])


def _undulated(x: NodePoints, seed, **how) -> NodePoints:
    """Returns `shapes.undulated` with a seed that may be traced, so that all copies of a vesicle share one program."""
    return shapes.undulated(x, seed=jnp.asarray(seed), **how)


def _made(shape: Callable, given: tuple, counts: dict[str, int], **numbers: ScalarLike) -> NodePoints:
    """Returns shape(*given, **counts, **numbers). With known values it is a program that is compiled and kept."""
    if is_known(*given, *numbers.values()):
        known = {name: np.asarray(number, dtype=float) for name, number in numbers.items()}
        x = compiled(shape)(*given, **counts, **known)
        if np.all(np.isfinite(np.asarray(x))):
            return x
    return shape(*given, **counts, **numbers)  # if there is no such shape, this says so


def _radians(degrees: ScalarLike) -> ScalarLike:
    return degrees * (math.pi / 180)


@partial(jax.jit, static_argnums=0)
def _resampled(N: int, samples, angle, length) -> NodePoints:
    x = shapes.equispaced(samples, N)
    x = x - curve.centroid(curve.Curve.from_nodes(x))
    return shapes.rotated(shapes.scaled(x, length), angle)


def _field(table: FieldTable | None, vesicles: tuple[VesicleTable, ...]) -> Field | None:
    if table is None:
        return None

    def each(key: str) -> Float[Array, "M"]:
        own = [getattr(vesicle, key) for vesicle in vesicles]
        return jnp.stack([as_float(getattr(table, key) if value is None else value) for value in own])

    return Field(
        beta=table.beta,
        chi=table.chi,
        **{number.per_vesicle: each(number.key) for number in PER_VESICLE},
        direction=table.direction,
        history=_history(table.time),
        charge_relaxation=table.charge_relaxation,
    )


def _viscosity_ratio(table: FluidTable | None, vesicles: tuple[VesicleTable, ...]) -> Float[Array, "M"] | None:
    """Returns ν of each vesicle, or None if no viscosity differs."""
    own = [vesicle.viscosity_ratio for vesicle in vesicles]
    if table is None and all(value is None for value in own):
        return None
    usual = 1.0 if table is None else table.viscosity_ratio
    return jnp.stack([as_float(usual if value is None else value) for value in own])


def _cell(table: CellTable | None) -> Cell | None:
    if table is None:
        return None
    components = [number for vector in table.lattice for number in vector]
    if all(isinstance(number, float) for number in components):
        return Cell.of(table.lattice)
    return Cell.of(jnp.stack([as_float(number) for number in components]).reshape(2, 2))


def _history(table: TimeTable | None) -> waveform.AbstractHistory | None:
    match table:
        case PulseTime():
            return waveform.Pulse(table.start, table.duration, table.rise)
        case AcTime():
            numbers = table.frequency, table.amplitude, table.offset, _radians(table.phase)
            return waveform.AC(*numbers, averaged=table.averaged)
        case SineTime():
            return waveform.Sine(table.frequency, table.amplitude, table.offset, _radians(table.phase))
        case TabulatedTime():
            return waveform.PiecewiseLinear(table.times, table.values)
    return None


def _flow(table: FlowTable | None) -> flow.AbstractFlow | None:
    history = None if table is None else _history(table.time)
    steady = _steady_flow(table)
    return steady if history is None else flow.TimeDependent(steady, history)


def _steady_flow(table: FlowTable | None) -> flow.AbstractFlow | None:
    match table:
        case ShearFlow():
            return flow.Shear(table.capillary_number)
        case ExtensionFlow():
            return flow.Extension(table.capillary_number)
        case LinearFlow():
            return flow.LinearFlow(table.gradient)
        case PoiseuilleFlow():
            return flow.Poiseuille(table.capillary_number, table.half_width)
    return None
