"""Diagnostics of the membranes in a field: dipole, charge, electric torque, deformation along the field."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics.arrays import PerVesicle
from ..physics.electric import Field
from .registry import Instant, gives


def angle_of(vector: Array) -> Array:
    """Returns the angle of a vector from x, in (-π, π]; 0 with derivative 0 for the zero vector."""
    nothing = jnp.all(vector == 0)
    return jnp.arctan2(jnp.where(nothing, 0.0, vector[1]), jnp.where(nothing, 1.0, vector[0]))


def deformation_along(field: Field, curves: Curve) -> PerVesicle:
    """Returns the deformation D of each of the `curves` (M,) along a uniform field."""
    return jax.vmap(geometry.deformation, in_axes=(0, None))(curves, field.unit_direction())


@gives(
    "dipole",
    "dipole_angle",
    "charge",
    "torque",
    "traction_ratio",
    "deformation_along_field",
    needed=lambda scene: scene.field is not None,
)
def of_field(instant: Instant, found) -> dict[str, Array]:
    """What the field does to every membrane. Only a uniform field has one direction to be deformed along."""
    curves, electric = instant.motion.surfaces.curves, instant.motion.electric
    V_m = electric.potential(instant.y.scalars)
    out = jax.vmap(_of_membrane)(curves, electric.charge, V_m, electric.traction)
    if instant.scene.field.is_uniform():
        out["deformation_along_field"] = deformation_along(instant.scene.field, curves)
    return out


@gives(
    "mean_current",
    "effective_conductivity",
    needed=lambda scene: scene.field is not None and scene.cell is not None,
)
def of_cell(instant: Instant, found) -> dict[str, Array]:
    """The mean current in a periodic cell, E + p/A with the dipole p of all vesicles in it and its area A."""
    E_inf = instant.scene.field.E_inf(instant.t)
    current = E_inf + jnp.sum(found["dipole"], axis=0) / instant.equation.domain.at(instant.t).area()
    square = jnp.sum(E_inf**2)
    # without a field there is no conductivity to tell
    return {
        "mean_current": current,
        "effective_conductivity": jnp.where(square > 0, current @ E_inf, jnp.nan) / jnp.where(square > 0, square, 1.0),
    }


def _of_membrane(curve: Curve, q, V_m, f_el) -> dict[str, Array]:
    arm = curve.x - geometry.centroid(curve)
    weights = curve.weights
    tangential = jnp.abs(jnp.sum(f_el * curve.tangent, axis=-1))
    across = jnp.sum(jnp.abs(jnp.sum(f_el * curve.normal, axis=-1)) * weights)
    dipole = jnp.sum((q[:, None] * arm - V_m[:, None] * curve.normal) * weights[:, None], axis=0)
    return {
        "dipole": dipole,
        "dipole_angle": angle_of(dipole),
        "charge": jnp.sum(q * weights),
        "torque": jnp.sum(weights * (arm[:, 0] * f_el[:, 1] - arm[:, 1] * f_el[:, 0])),
        "traction_ratio": jnp.sum(tangential * weights) / jnp.where(across > 0, across, 1.0),
    }
