r"""Steady states of one vesicle along one number λ of its scene, followed through folds by pseudo-arclength.

The equations R(u, λ) = 0 of `steady` have one steady state u near the last one for each λ, except at a fold, where two
states meet and none exists beyond. The states and λ together are a smooth curve also there. With z = (u, λ), the next
point on it solves

    R(z) = 0,     t·(z - z₀ - h t) = 0

from the last point z₀, with the tangent t of the curve and the arclength h. In z, u is scaled so that its norm is the
root mean square, and λ so that both parts of t have the same size at the start. There are more equations than unknowns,
as in `steady`. Changes of z are the shortest ones orthogonal to t that solve them by least squares.
"""

from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..geometry.curve import Curve
from ..numerics.arrays import Scalar, as_float
from ..observables import diagnostics
from ..runs.case import Case
from .critical import NoCriticalValue
from .steady import residuals

_INSENSITIVE = 1e-3  # least size of the state's part of the tangent at the start that is scaled for
_SETTLED = 1e-9  # Newton's method has converged if its last change is smaller
_LOOSE = 1e-9  # relative singular values below this belong to directions that no equation fixes
_MOST = 15  # changes by Newton's method for one point
_BENT = 0.9  # least cosine between the tangents of neighbouring points
_LEAST = 1e-4  # least arclength between points


class Family(eqx.Module):
    """The steady states of a scene along its number λ called `name`; `values` has all numbers, `unit` is that of λ."""

    case: Case
    name: str = eqx.field(static=True)
    values: dict[str, Array]
    unit: Scalar = eqx.field(converter=as_float)

    def equation(self, value) -> Equation:
        """Returns the equation with λ = `value`. Pure."""
        return self.case.equation(self.case.scene(self.values | {self.name: value}))

    def with_unit(self, unit: float) -> "Family":
        """Returns the same family with another unit of λ."""
        return eqx.tree_at(lambda f: f.unit, self, as_float(unit))


class Point(NamedTuple):
    """A steady state, λ, and the tangent of the curve, which is NumPy and scaled."""

    y: Unknowns
    value: float
    tangent: Float[np.ndarray, "n"]


@eqx.filter_jit
def linearised(family: Family, y: Unknowns, value: Scalar, anchor: Unknowns) -> tuple[Array, Array]:
    """Returns R and (∂R/∂u, ∂R/∂λ) without scales, (R,) and (R, n). `anchor` defines centroid and first node."""
    flat, unflatten = ravel_pytree(y)
    outline = Curve.from_nodes(anchor.x[0])
    equation, slope = eqx.filter_jvp(family.equation, (value,), (jnp.ones(()),))
    R, by_value = eqx.filter_jvp(lambda equation: residuals(equation, y, outline), (equation,), (slope,))
    by_state = jax.jacfwd(lambda u: residuals(equation, unflatten(u), outline))(flat)
    return R, jnp.concatenate([by_state, by_value[:, None]], axis=1)


@eqx.filter_jit
def diagnosed(family: Family, y: Unknowns, value: Scalar) -> dict[str, Array]:
    """Returns the diagnostics of a steady state."""
    equation = family.equation(value)
    return diagnostics.diagnose(equation, jnp.zeros(()), y, equation.motion(jnp.zeros(()), y))


def scales(family: Family, y: Unknowns) -> Float[np.ndarray, "n"]:
    """Returns the units of (u, λ), by which z is multiplied."""
    flat, _ = ravel_pytree(y)
    return np.append(np.full(flat.size, np.sqrt(flat.size)), float(family.unit))


def solved(
    matrix: Array, tangent: Float[np.ndarray, "n"], units: Float[np.ndarray, "n"], sides: np.ndarray
) -> np.ndarray:
    """Returns the changes of z orthogonal to `tangent` that solve R_z dz = `sides`, (n, k)."""
    scaled = np.asarray(matrix) * units
    across = scaled - np.outer(scaled @ tangent, tangent)
    return np.linalg.lstsq(across, sides, rcond=_LOOSE)[0]


def tangent_at(family: Family, y: Unknowns, value: float) -> Float[np.ndarray, "n"]:
    """Returns the tangent of the curve near a point of it, in either sense."""
    _, matrix = linearised(family, y, jnp.asarray(value), y)
    return np.linalg.svd(np.asarray(matrix) * scales(family, y))[2][-1]


def distance(family: Family, first: Point, second: Point) -> float:
    """Returns the arclength h from the first point to the second."""
    apart = np.asarray(ravel_pytree(second.y)[0] - ravel_pytree(first.y)[0])
    return float(first.tangent @ (np.append(apart, second.value - first.value) / scales(family, first.y)))


def _moved(y: Unknowns, value: float, change: np.ndarray) -> tuple[Unknowns, float]:
    flat, unflatten = ravel_pytree(y)
    return unflatten(flat + change[:-1]), value + float(change[-1])


def ahead(family: Family, point: Point, arc: float) -> Point | None:
    """Returns the point of the curve at the arclength `arc` from `point`; None if Newton's method does not find it."""
    units = scales(family, point.y)
    y, value = _moved(point.y, point.value, arc * units * point.tangent)
    for _ in range(_MOST):
        R, matrix = linearised(family, y, jnp.asarray(value), point.y)
        if not np.all(np.isfinite(R)):
            return None
        along = np.asarray(matrix) @ (units * point.tangent)
        change, bend = solved(matrix, point.tangent, units, -np.stack([R, along], axis=1)).T
        y, value = _moved(y, value, units * change)
        size = np.linalg.norm(change)
        if size < _SETTLED:
            tangent = point.tangent + bend
            return Point(y, value, tangent / np.linalg.norm(tangent))
        if not size < 1.0:
            return None
    return None


def beginning(family: Family, value: float, near: Unknowns) -> tuple[Family, Point]:
    """Returns the steady state near `near` for λ = `value`, with the tangent towards larger λ, and the scaled family.

    Raises:
        NoCriticalValue: there is no steady state near it.
    """
    fixed = np.zeros(ravel_pytree(near)[0].size + 1)
    fixed[-1] = 1.0
    found = ahead(family, Point(near, value, fixed), 0.0)
    if found is None:
        raise NoCriticalValue(
            f"{family.name} = {value:.6g}: no steady state near the end of the run; a later t_end, or a value with "
            "which the vesicle comes to rest, may help"
        )
    part = np.linalg.norm(found.tangent[:-1]) / found.tangent[-1]
    part = max(part, _INSENSITIVE)
    family = family.with_unit(float(family.unit) / part)
    tangent = np.append(found.tangent[:-1], found.tangent[-1] * part)
    return family, found._replace(tangent=tangent / np.linalg.norm(tangent))


def follow(family: Family, start: Point, *, rising: bool = True, arc: float = 0.1, most: int = 200) -> Iterator[Point]:
    """Yields the points of the curve from `start`, towards larger λ or smaller λ, and through folds.

    Distances adapt to the curvature of the curve and to Newton's method, from `arc` on.

    Raises:
        NoCriticalValue: the curve cannot be followed further.
    """
    point = start if rising else start._replace(tangent=-start.tangent)
    for _ in range(most):
        yield point
        while True:
            found = ahead(family, point, arc)
            if found is not None and found.tangent @ point.tangent > _BENT:
                break
            arc = 0.5 * arc
            if arc < _LEAST:
                raise NoCriticalValue(f"{family.name}: steady states cannot be followed beyond {point.value:.6g}")
        if found.tangent @ point.tangent > 0.5 * (1 + _BENT):
            arc = 1.5 * arc
        point = found
