"""Corrections of a state after every step: filter, projection to the constraints, symmetry."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..base.resolution import removed_modes
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import PerVesicle, VesiclePoints
from ..physics import membrane
from .inextensible import Constraint
from .state import Unknowns
from .symmetry import Symmetry


class Filter(eqx.Module):
    """The number of highest modes that are removed: from x, and from σ and the scalars (`surface`)."""

    x: int = eqx.field(static=True)
    surface: int = eqx.field(static=True, default=1)

    @classmethod
    def for_nodes(cls, N: int) -> "Filter":
        """Returns the default: max(2, N/16) modes of x, and only the Nyquist mode of σ and the scalars."""
        return cls(removed_modes(N))


def filtered(y: Unknowns, cut: Filter) -> Unknowns:
    """Returns y without the highest modes."""
    scalars = jax.tree.map(lambda scalar: fourier.low_pass(scalar, cut.surface), y.scalars)
    return Unknowns(fourier.low_pass(y.x, cut.x, axis=1), scalars, y.integrals)


def corrected(
    x: VesiclePoints, area: PerVesicle, speed: PerVesicle, constraint: Constraint, cut: Filter
) -> VesiclePoints:
    """Makes one Newton step from nodes (M, N, 2) towards the area (M,) and the uniform metric `speed` (M,)."""

    def correction(x, area, speed, constraint):
        curve = Curve.from_nodes(x)
        dx = ((area - geometry.area(curve)) / geometry.length(curve)) * curve.normal
        stretch = curve.speed * (membrane.stretch_rate(curve, dx) - (speed - curve.speed) / speed)
        mu = constraint.tension.solve(fourier.low_pass(stretch, cut.surface)).value
        return fourier.low_pass(dx + jnp.einsum("aij,j->ia", constraint.spread, mu), cut.x, axis=0)

    return x + jax.vmap(correction)(x, area, speed, constraint)


def symmetric(y: Unknowns, symmetry: Symmetry | None) -> Unknowns:
    """Returns y with the symmetries that a single vesicle had at the start; with None, y is not changed."""
    if symmetry is None:
        return y
    x, scalars = jax.tree.map(lambda leaf: leaf[0], (y.x, y.scalars))
    x, scalars = jax.tree.map(lambda leaf: leaf[None], symmetry.restored(x, scalars))
    return Unknowns(x, scalars, y.integrals)
