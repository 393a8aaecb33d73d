r"""The critical value of a number, beyond which a steady state of one vesicle no longer exists, and its derivatives.

Where tank-treading ends at a critical viscosity ratio ν_c, the treading state meets an unstable one in a fold. There
the tangent t of the curve of steady states z = (u, λ) has no component along λ (`continuation`). The first order in
the other numbers p is

    R_z dz + R_p dp = 0,     t·dz = 0,     dλ_c/dp = the last component of dz

because a shift along t does not change λ. This is the implicit function theorem for the fold: the left null vector w
of R_u gives the same -(w·R_p)/(w·R_λ).
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import brentq

from ..base import status
from ..base.arguments import refusal
from ..equation.state import Unknowns
from ..geometry.curve import Curve
from ..inputs.parameters import numbers
from ..inputs.scene_files import Readable
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import FOLD
from ..numerics import fourier
from .continuation import (
    Family,
    Point,
    ahead,
    beginning,
    diagnosed,
    distance,
    follow,
    linearised,
    scales,
    solved,
    tangent_at,
)
from .critical import Discretisation, NoCriticalValue, finer, of_one, with_traced_numbers
from .steady import residuals

_NEAR = 0.02  # arclength within which the fold with more nodes is sought
_CLOSE = 1e-7  # arclength to which a fold is found; the error of λ is its square


class Fold(NamedTuple):
    """A critical value, the steady state there, and its diagnostics."""

    value: float
    y: Unknowns
    diagnostics: dict[str, np.ndarray]
    points: int  # steady states that were followed to it
    unit: float  # of the number, in which it and the state change equally fast at the start


def critical_value(
    scene_file: Readable, name: str, *, rising: bool = True, near: Unknowns | None = None, most: int = 200
) -> Fold:
    """Returns the value of the number `name` at which the steady states of a vesicle end, such as tank-treading.

    Steady states are followed from the value in the scene, towards larger values or smaller ones. With
    "fluid.viscosity_ratio" the result is the critical viscosity ratio ν_c, where tank-treading ends.

    Args:
        scene_file: the scene, read or as a path, a built-in name or tables. Its vesicle must come to rest in a flow or
            a constant field, except for a drift and the motion along its outline.
        name: a number of the scene, as in `jaxves.numbers`.
        rising: whether larger values are followed; otherwise smaller ones.
        near: a state near the steady one. Without it the scene is run to its end.
        most: the largest number of steady states.

    Raises:
        NoCriticalValue: there is no steady state at the start, or no fold within `most` states.
        SceneError: `scene_file` is no scene, or has a key that this use does not support.
        ValueError: the scene has no such number, or it is zero; or `near` has another number of nodes.
    """
    family = family_of(scene_file, name)
    value, N = float(family.values[name]), family.case.scene_file.numerics.nodes
    if near is not None and near.x.shape != (1, N, 2):
        raise refusal("near.x", f"shape {near.x.shape}", f"the shape (1, {N}, 2) of the nodes of the scene")
    near = _at_end(family, of_one(scene_file, FOLD).scene_file) if near is None else near
    family, start = beginning(family, value, near)
    before = None
    for count, point in enumerate(follow(family, start, rising=rising, most=most), start=1):
        if before is not None and before.tangent[-1] * point.tangent[-1] < 0:
            found = _root(family, before, 0.0, distance(family, before, point))
            told = diagnosed(family, found.y, jnp.asarray(found.value))
            return Fold(found.value, found.y, jax.tree.map(np.asarray, told), count, float(family.unit))
        before = point
    raise NoCriticalValue(f"{name}: no fold of steady states between {value:.6g} and {before.value:.6g}")


def family_of(scene_file: Readable, name: str) -> Family:
    """Returns the steady states of a scene along its number `name`.

    Raises:
        NoCriticalValue: there are several vesicles, a cell, or a time dependence.
        SceneError: `scene_file` is no scene, or has a key that this use does not support.
        ValueError: the scene has no such number, or it is zero.
    """
    case = of_one(scene_file, FOLD)
    file = case.scene_file
    for key, table in (("field", file.field), ("flow", file.flow)):
        history = None if table is None else table.time
        if history is not None and history.kind != "constant" and not getattr(history, "averaged", False):
            raise NoCriticalValue(f'{key}.time.kind = "{history.kind}", expected a constant {key}: no state is steady')
    known = numbers(file)
    if name not in known:
        raise refusal("name", repr(name), f"one of the numbers of the scene: {', '.join(known)}")
    if known[name] == 0:
        raise refusal(name, 0.0, "a value that is not zero, from which steady states are followed")
    case, values = with_traced_numbers(file)
    return Family(case, name, values, abs(known[name]))


def discretisation_error(scene_file: SceneFile, name: str, found: Fold) -> Discretisation:
    """Estimates the discretisation error of a critical value by computing it again with 1.5 times the nodes.

    Raises:
        NoCriticalValue: the steady states with more nodes have no fold near this one.
    """
    family = family_of(finer(of_one(scene_file, FOLD).scene_file).nodes, name).with_unit(found.unit)
    N = family.case.scene_file.numerics.nodes
    y = jax.tree.map(lambda leaf: fourier.resample(leaf, N, axis=1), found.y)
    start = ahead(family, Point(y, found.value, tangent_at(family, y, found.value)), 0.0)
    again = None if start is None else _root(family, start, -_NEAR, _NEAR)
    if again is None:
        raise NoCriticalValue(f"{name}: no fold near {found.value:.6g} with {N} nodes")
    return Discretisation(abs(again.value - found.value))


def slopes(scene_file: SceneFile, name: str, found: Fold, names: Sequence[str] | None = None) -> dict[str, float]:
    """Returns the derivatives of a critical value with respect to `names`, by default to all numbers but `name`."""
    family = family_of(scene_file, name)
    values = {key: value for key, value in family.values.items() if key != name}
    names = list(values) if names is None else list(names)
    for key in names:
        if key not in values:
            raise refusal("names", repr(key), f"some of {', '.join(values)}")
    units = scales(family, found.y)
    _, matrix = linearised(family, found.y, jnp.asarray(found.value), found.y)
    by_number = _by_numbers(family, found.y, jnp.asarray(found.value))
    sides = -np.stack([np.asarray(by_number[key]) for key in names], axis=1)
    change = solved(matrix, tangent_at(family, found.y, found.value), units, sides)
    return dict(zip(names, (units[-1] * change[-1]).tolist(), strict=True))


@eqx.filter_jit
def _by_numbers(family: Family, y: Unknowns, value) -> dict[str, Array]:
    """Returns the derivatives of the residuals with respect to all numbers."""
    outline = Curve.from_nodes(y.x[0])

    def of(values):
        return residuals(eqx.tree_at(lambda f: f.values, family, values).equation(value), y, outline)

    return jax.jacfwd(of)(family.values)


def _root(family: Family, point: Point, low: float, high: float) -> Point | None:
    """Returns the point between two arclengths from `point` where the tangent has no component along λ."""
    seen: dict[float, Point] = {}

    def along(arc: float) -> float:
        found = ahead(family, point, arc)
        if found is None:
            raise NoCriticalValue(f"{family.name}: the fold near {point.value:.6g} cannot be approached")
        seen[arc] = found
        return found.tangent[-1]

    if along(low) * along(high) > 0:
        return None
    arc = brentq(along, low, high, xtol=_CLOSE)
    along(arc)
    return seen[arc]


@eqx.filter_jit
def _run(family: Family, t_end, march):
    result = family.case.simulate(family.values, t_end=t_end, saves=1, march=march)
    return result.state.y, result.status


def _at_end(family: Family, scene_file: SceneFile) -> Unknowns:
    """Returns the state at the end of a run of the scene."""
    y, code = _run(family, jnp.asarray(scene_file.t_end), family.case.march(scene_file.t_end, 1).forwards())
    if int(code) != status.COMPLETE:
        raise NoCriticalValue(f"scene_file: the run to its steady state ended as {status.WORDS[int(code)]}")
    return Unknowns(y.x, y.scalars)
