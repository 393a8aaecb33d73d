"""What is done to a state after every step: filter, return to the constraints, restore the symmetry."""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import PerVesicle, VesiclePoints
from ..physics import membrane
from .inextensible import Constraint
from .state import Unknowns
from .symmetry import Symmetry


class Filter(eqx.Module):
    """How many of the highest modes are removed: from x, and from σ and the scalars."""

    x: int = eqx.field(static=True)
    surface: int = eqx.field(static=True, default=1)

    @classmethod
    def for_nodes(cls, N: int) -> "Filter":
        """max(2, N/16) from x, Nyquist alone from σ and the scalars."""
        return cls(max(2, N // 16))


def filtered(y: Unknowns, cut: Filter) -> Unknowns:
    """y without the highest modes."""
    scalars = jax.tree.map(lambda scalar: fourier.low_pass(scalar, cut.surface), y.scalars)
    return Unknowns(fourier.low_pass(y.x, cut.x, axis=1), scalars, y.integrals)


def corrected(
    x: VesiclePoints, area: PerVesicle, speed: PerVesicle, constraint: Constraint, cut: Filter
) -> VesiclePoints:
    """One Newton step from nodes (M, N, 2) towards the area (M,) and the uniform metric `speed` (M,)."""

    def correction(x, area, speed, constraint):
        curve = Curve.from_nodes(x)
        dx = ((area - geometry.area(curve)) / geometry.length(curve)) * curve.normal
        stretch = curve.speed * (membrane.stretch_rate(curve, dx) - (speed - curve.speed) / speed)
        mu = constraint.tension.solve(fourier.low_pass(stretch, cut.surface)).value
        return fourier.low_pass(dx + jnp.einsum("aij,j->ia", constraint.spread, mu), cut.x, axis=0)

    return x + jax.vmap(correction)(x, area, speed, constraint)


def symmetric(y: Unknowns, symmetry: Symmetry | None) -> Unknowns:
    """y with the symmetries that a lone vesicle has had from the start; None keeps none."""
    if symmetry is None:
        return y
    x, scalars = jax.tree.map(lambda leaf: leaf[0], (y.x, y.scalars))
    x, scalars = jax.tree.map(lambda leaf: leaf[None], symmetry.restored(x, scalars))
    return Unknowns(x, scalars, y.integrals)
