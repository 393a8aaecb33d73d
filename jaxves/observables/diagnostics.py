r"""Computes the diagnostics of a state. `quantities` has their names, units and axes.

Particle stress, with the force f_hd that membranes exert on the fluid:

    Σ_ab = -(1/A) Σ ∮ (f_hd)_a x_b ds,   A the total area,   [μ] = Σ_12 / Ca in shear

In a field Σ is not symmetric, because the field exerts a torque. Energy balance at every instant:

    dE_b/dt = power of the flow + power of the field - dissipation,     E_b = ½ ∮ κ_B κ² ds
    dissipation = ∮ f_hd · S[f_hd] ds,  flow = -∮ f_hd · v_∞ ds,  field = -∮ f_el · dx/dt ds

The tension drives the drainage of the film between two membranes. Errors of the tension matter more for thinner films.
If the gap d is smaller than the node spacing, the relative error of the drainage rate is about τ/(2d)². Here τ is the
top of the spectrum of the tension, divided by its largest mode (measured in `experiments/film.py`).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..equation.equation import Equation
from ..equation.state import Motion, Unknowns
from ..geometry import curve as geometry
from ..geometry import extremes
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain
from ..numerics import fourier
from ..operators.interactions import over_pairs
from ..physics import membrane
from ..physics.scene import Scene

_AT_REST = 1e-6  # in units of κ_B/L²: smaller forces are round-off and count as balanced


def tank_treading_speed(curve: Curve, velocity: Array) -> Array:
    """Returns ∮ (v - v̄)·t ds / L with the mean velocity v̄. It is -Ca/2 for a circle in shear."""
    weights = curve.weights / jnp.sum(curve.weights)
    return jnp.sum(weights * jnp.sum((velocity - weights @ velocity) * curve.tangent, axis=-1))


def stress(motion: Motion) -> Array:
    """Returns the particle stress tensor (2, 2). Its value does not depend on the origin of the positions."""
    curves = motion.surfaces.curves
    centers = jax.vmap(geometry.centroid)(curves)
    arm = (curves.x - jnp.mean(centers, axis=0)) * curves.weights[..., None]
    return -jnp.einsum("mna,mnb->ab", motion.f_hd, arm) / jnp.sum(jax.vmap(geometry.area)(curves))


def _crossings(first: Curve, second: Curve) -> Array:
    """Returns which edges of the polygon of nodes of one curve intersect which edges of another, (N, N)."""

    def ends(curve):
        return curve.x, jnp.roll(curve.x, -1, axis=0)

    def side(a, b, c):
        """Returns twice the signed area of the triangle a, b, c for all edges (a, b) and all points c."""
        u, v = (b - a)[:, None], c[None] - a[:, None]
        return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]

    (p, q), (r, s) = ends(first), ends(second)
    return (side(p, q, r) * side(p, q, s) < 0) & (side(r, s, p) * side(r, s, q) < 0).T


def crosses_itself(curve: Curve) -> Array:
    """Returns whether two edges of the polygon of nodes intersect."""
    # Neighbouring edges share an end, so their products are zero up to round-off. They are left out.
    N = curve.x.shape[0]
    steps = jnp.abs(jnp.arange(N)[:, None] - jnp.arange(N)[None])
    return jnp.any(_crossings(curve, curve) & (jnp.minimum(steps, N - steps) > 1))


def _is_inside(point: Array, curve: Curve) -> Array:
    """Returns whether the polygon of nodes encloses a point or has it on an edge, by the angle it turns about it."""
    a, b = curve.x - point, jnp.roll(curve.x, -1, axis=0) - point
    cross, dot = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], jnp.sum(a * b, axis=-1)
    nothing = (cross == 0) & (dot == 0)
    turned = jnp.sum(jnp.arctan2(jnp.where(nothing, 0.0, cross), jnp.where(nothing, 1.0, dot)))
    return jnp.abs(turned) > 0.5 * jnp.pi


def collides(curves: Curve) -> Array:
    """Returns whether the polygons of any two vesicles intersect or coincide, or one contains the other."""

    def of_pair(first, second):
        return jnp.any(_crossings(first, second)) | _is_inside(first.x[0], second) | _is_inside(second.x[0], first)

    return jnp.any(over_pairs(of_pair, curves))


def _angle(vector: Array) -> Array:
    """Returns the angle of a vector from x, in (-π, π]; 0 with derivative 0 for the zero vector."""
    nothing = jnp.all(vector == 0)
    return jnp.arctan2(jnp.where(nothing, 0.0, vector[1]), jnp.where(nothing, 1.0, vector[0]))


def _of_many(domain: AbstractDomain, curves: Curve, center: Array, tension_tail: Array) -> dict[str, Array]:
    least = jnp.min(over_pairs(extremes.gap, curves))
    out = {"min_gap": least, "film_error": jnp.max(tension_tail) / (2 * least) ** 2}
    if center.shape[0] == 2:
        line = domain.displacement(center[0], center[1])
        return out | {"separation": jnp.hypot(line[0], line[1]), "line_angle": _angle(line)}
    apart2 = jnp.sum(domain.displacement(center[:, None], center[None]) ** 2, axis=-1)
    itself = jnp.eye(center.shape[0], dtype=bool)
    return out | {"neighbor_distance": jnp.sqrt(jnp.min(jnp.where(itself, jnp.inf, apart2), axis=1))}


def powers(equation: Equation, t: Array, y: Unknowns, motion: Motion) -> dict[str, Array]:
    """Returns the terms of the energy balance at one instant."""
    scene, curves = equation.scene, motion.surfaces.curves
    weights = curves.weights[..., None]

    def energy(x):
        return jnp.sum(jax.vmap(lambda x, k: membrane.bending_energy(Curve.from_nodes(x), k))(x, scene.bending))

    _, energy_rate = jax.jvp(energy, (y.x,), (motion.velocity,))
    out = {}
    disturbance = motion.velocity
    if scene.flow is not None:
        imposed = scene.flow.velocity(y.x, t)
        disturbance = disturbance - imposed
        out["power_flow"] = -jnp.sum(weights * motion.f_hd * imposed)
    if scene.field is not None:
        out["power_electric"] = -jnp.sum(weights * motion.electric.traction * motion.velocity)
    supplied = sum(out.values(), start=jnp.zeros(()))
    out["dissipation"] = jnp.sum(weights * motion.f_hd * disturbance)
    out["power_balance"] = energy_rate + out["dissipation"] - supplied
    return out


def _of_shape(equation: Equation, curve: Curve, x, velocity, sigma, bending, speed) -> dict[str, Array]:
    cut = equation.filter
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


def _of_field(curve: Curve, q, V_m, f_el) -> dict[str, Array]:
    arm = curve.x - geometry.centroid(curve)
    weights = curve.weights
    tangential = jnp.abs(jnp.sum(f_el * curve.tangent, axis=-1))
    across = jnp.sum(jnp.abs(jnp.sum(f_el * curve.normal, axis=-1)) * weights)
    dipole = jnp.sum((q[:, None] * arm - V_m[:, None] * curve.normal) * weights[:, None], axis=0)
    return {
        "dipole": dipole,
        "dipole_angle": _angle(dipole),
        "charge": jnp.sum(q * weights),
        "torque": jnp.sum(weights * (arm[:, 0] * f_el[:, 1] - arm[:, 1] * f_el[:, 0])),
        "traction_ratio": jnp.sum(tangential * weights) / jnp.where(across > 0, across, 1.0),
    }


def diagnose(equation: Equation, t: Array, y: Unknowns, motion: Motion) -> dict[str, Array]:
    """Returns all diagnostics of this scene by name, except the unwrapped inclination, which needs earlier times."""
    scene: Scene = equation.scene
    curves = motion.surfaces.curves

    def shape(*args):
        return _of_shape(equation, *args)

    out = jax.vmap(shape)(curves, y.x, motion.velocity, motion.sigma, scene.bending, equation.speed)
    out |= jax.vmap(extremes.over_membrane)(curves, motion.sigma, scene.bending, y.V_m)
    own = motion.f_hd if motion.electric is None else motion.f_hd + motion.electric.traction
    out |= jax.vmap(_balance)(curves, own, scene.bending)
    if scene.field is not None:
        field = scene.field
        out |= jax.vmap(_of_field)(curves, motion.electric.charge, y.V_m, motion.electric.traction)
        direction = field.unit_direction()
        out["deformation_along_field"] = jax.vmap(geometry.deformation, in_axes=(0, None))(curves, direction)
        tail = jax.vmap(lambda V_m: fourier.spectral_tail(V_m, equation.filter.surface))(y.V_m)
        # If V_m is constant along the membrane, as at the start, its spectrum is round-off and is not used.
        charged = jnp.ptp(y.V_m, axis=1) > 1e-8
        out["spectral_tail"] = jnp.maximum(out["spectral_tail"], jnp.where(charged, tail, 0.0))
    out["stress"] = stress(motion)
    if scene.flow is not None:
        out["effective_viscosity"] = scene.flow.effective_viscosity(out["stress"])
    if y.x.shape[0] > 1:
        out |= _of_many(equation.domain, curves, out["center"], out["tension_tail"])
    out |= powers(equation, t, y, motion)
    out["residual"] = motion.residual
    return out


def averaged(motion: Motion, scene: Scene, t: Array) -> dict[str, Array]:
    """Returns the integrands of the time averages by name.

    Inclinations θ are averaged by way of `director`, which has cos 2θ and sin 2θ.
    """
    curves = motion.surfaces.curves
    theta = jax.vmap(geometry.inclination)(curves)
    return {
        "stress": stress(motion),
        "tank_treading_speed": jax.vmap(tank_treading_speed)(curves, motion.velocity),
        "deformation": jax.vmap(geometry.deformation, in_axes=(0, None))(curves, jnp.array([0.0, 1.0])),
        "director": jnp.stack([jnp.cos(2 * theta), jnp.sin(2 * theta)], axis=-1),
    }


def averages(means: dict[str, Array], scene: Scene) -> dict[str, Array]:
    """Returns the time averages by the names of the diagnostics, from the means of the integrands `averaged`."""
    out = {name: means[name] for name in ("stress", "tank_treading_speed", "deformation")}
    director = means["director"]
    out["inclination"] = 0.5 * jnp.arctan2(director[..., 1], director[..., 0])
    if scene.flow is not None:
        out["effective_viscosity"] = scene.flow.effective_viscosity(means["stress"])
    return out
