"""The inclination angle of each vesicle during a run, without jumps of π."""

import jax
import jax.numpy as jnp

from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics.arrays import PerVesicle
from .state import Unknowns


def inclinations(y: Unknowns) -> PerVesicle:
    """Returns the angle between the x axis and the major axis of each vesicle, (M,)."""
    return jax.vmap(lambda x: geometry.inclination(Curve.from_nodes(x)))(y.x)


def turned(angle: PerVesicle, inclination: PerVesicle) -> PerVesicle:
    """Returns the unwrapped angle nearest to `angle` that has this inclination; an axis has the period π."""
    return angle + jnp.mod(inclination - angle + 0.5 * jnp.pi, jnp.pi) - 0.5 * jnp.pi


def followed(angle: PerVesicle, y: Unknowns) -> PerVesicle:
    """Returns the unwrapped inclinations at y; `angle` are those after the step before."""
    return turned(angle, inclinations(y))
