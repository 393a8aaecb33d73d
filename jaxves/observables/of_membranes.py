"""Diagnostics of every membrane by itself: size, shape, motion, tension, and how well its nodes resolve it."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..base.resolution import SMALL_POTENTIAL
from ..geometry import curve as geometry
from ..geometry import extremes
from ..geometry.curve import Curve
from ..numerics import fourier
from ..physics import membrane
from .registry import Instant, gives

_AT_REST = 1e-6  # in units of κ_B/L²: smaller forces are round-off and count as balanced


def tank_treading_speed(curve: Curve, velocity: Array) -> Array:
    """Returns ∮ (v - v̄)·t ds / L with the mean velocity v̄. It is -Ca/2 for a circle in shear."""
    weights = curve.weights / jnp.sum(curve.weights)
    return jnp.sum(weights * jnp.sum((velocity - weights @ velocity) * curve.tangent, axis=-1))


@gives(
    "area",
    "length",
    "center",
    "deformation",
    "inclination",
    "tank_treading_speed",
    "bending_energy",
    "spectral_tail",
    "tension_tail",
    "metric_error",
    "self_gap",
)
def of_shapes(instant: Instant, found) -> dict[str, Array]:
    """Measures of the curves, and the spectra of x and of the tension; with a field also that of V_m."""
    equation, y, motion = instant.equation, instant.y, instant.motion
    cut = equation.filter

    def shape(curve: Curve, x, velocity, sigma, bending, speed):
        # If the tension is constant along the membrane, its spectrum is round-off and is not used.
        uneven = jnp.ptp(sigma) > _AT_REST * bending / geometry.length(curve) ** 2
        return {
            "area": geometry.area(curve),
            "length": geometry.length(curve),
            "center": geometry.centroid(curve),
            "deformation": geometry.deformation(curve, jnp.array([0.0, 1.0])),
            "inclination": geometry.inclination(curve),
            "tank_treading_speed": tank_treading_speed(curve, velocity),
            "bending_energy": membrane.bending_energy(curve, bending),
            "spectral_tail": fourier.spectral_tail(x, cut.x),
            "tension_tail": jnp.where(uneven, fourier.spectral_tail(sigma, cut.surface), 0.0),
            "metric_error": jnp.max(jnp.abs(curve.speed / speed - 1)),
            "self_gap": extremes.self_gap(curve),
        }

    curves = motion.surfaces.curves
    out = jax.vmap(shape)(curves, y.x, motion.velocity, motion.sigma, instant.scene.bending, equation.speed)
    for scalar in jax.tree.leaves(y.scalars):
        tail = jax.vmap(lambda scalar: fourier.spectral_tail(scalar, cut.surface, SMALL_POTENTIAL))(scalar)
        out["spectral_tail"] = jnp.maximum(out["spectral_tail"], tail)
    return out


@gives("tension_min", "tension_max", "max_curvature", "max_V_m")
def of_extremes(instant: Instant, found) -> dict[str, Array]:
    """Extremes of the interpolants along the membranes."""
    motion = instant.motion
    V_m = None if motion.electric is None else motion.electric.greatest_potential(instant.y.scalars)
    values = motion.surfaces.curves, motion.sigma, instant.scene.bending, V_m
    return jax.vmap(extremes.over_membrane)(*values)


@gives("force_residual", "torque_residual")
def of_balance(instant: Instant, found) -> dict[str, Array]:
    """Net force and torque of bending and tension, relative to the integrals of their absolute values."""
    motion = instant.motion
    own = motion.f_hd if motion.electric is None else motion.f_hd + motion.electric.traction
    return jax.vmap(_balance)(motion.surfaces.curves, own, instant.scene.bending)


def _balance(curve: Curve, f: Array, bending: Array) -> dict[str, Array]:
    """Returns net force and net torque of one membrane, relative to the integrals of their absolute values."""
    arm, length = curve.x - geometry.centroid(curve), geometry.length(curve)
    size = jnp.sum(jnp.abs(f), axis=-1)
    # The forces of a membrane at rest are round-off. Less than a millionth of the bending force counts as zero.
    least = _AT_REST * bending / length**2
    force = jnp.sum(jnp.abs(curve.weights @ f)) / (curve.weights @ size + least)
    turning = jnp.abs(curve.weights @ (arm[:, 0] * f[:, 1] - arm[:, 1] * f[:, 0]))
    torque = turning / (curve.weights @ (jnp.sum(jnp.abs(arm), axis=-1) * size) + least * length)
    return {"force_residual": force, "torque_residual": torque}
