"""Diagnostics of all vesicles together: distances, stress and viscosity, energy balance."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..equation.state import Motion
from ..geometry import curve as geometry
from ..geometry import extremes
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Cell
from ..operators.interactions import over_pairs
from ..operators.surfaces import Surfaces
from ..physics import membrane
from ..physics.scene import Scene
from .inner_stress import excess_viscous
from .of_field import angle_of
from .registry import Instant, gives


def stress(motion: Motion, scene: Scene) -> Array:
    """Returns the particle stress tensor (2, 2). Its value does not depend on the origin of the positions."""
    curves = motion.surfaces.curves
    centers = jax.vmap(geometry.centroid)(curves)
    arm = (curves.x - jnp.mean(centers, axis=0)) * curves.weights[..., None]
    moment = -jnp.einsum("mna,mnb->ab", motion.f_hd, arm)
    if scene.viscosity_ratio is not None:
        moment = moment + excess_viscous(motion, scene.viscosity_ratio)
    return moment / jnp.sum(jax.vmap(geometry.area)(curves))


def has_stress(scene: Scene) -> bool:
    """Returns whether the particle stress has a meaning.

    In a periodic cell with a field it has none: each vesicle carries a net electric force, so that the moment of the
    forces would depend on the image that is taken. In a field that is not uniform there is a net force on all of them.
    """
    return scene.field is None or (scene.cell is None and scene.field.is_uniform())


@gives("stress", "effective_viscosity", needed=has_stress)
def of_stress(instant: Instant, found) -> dict[str, Array]:
    """Particle stress, and the intrinsic viscosity in a flow that defines one."""
    out = {"stress": stress(instant.motion, instant.scene)}
    flow = instant.scene.flow
    viscosity = None if flow is None else flow.effective_viscosity(out["stress"])
    return out if viscosity is None else out | {"effective_viscosity": viscosity}


def least_gap(surfaces: Surfaces, domain: AbstractDomain) -> Array:
    """Returns the least distance of two membranes.

    In a periodic cell only near pairs are compared, an image of a vesicle near itself included. The result is infinite
    if there are none.
    """
    curves = surfaces.curves
    if not isinstance(domain, Cell):
        return jnp.min(over_pairs(extremes.gap, curves))
    near = surfaces.interactions.near

    def of_pair(k):
        def gap():
            target = jax.tree.map(lambda leaf: leaf[near.target[k]], curves)
            return extremes.gap(target, near.source_curve(k, curves, domain))

        return jax.lax.cond(near.valid[k], gap, lambda: jnp.asarray(jnp.inf))

    return jnp.min(jax.lax.map(of_pair, jnp.arange(near.valid.shape[0])))


@gives(
    "min_gap",
    "film_error",
    "separation",
    "line_angle",
    "neighbor_distance",
    needed=lambda scene: scene.x.shape[0] > 1 or scene.cell is not None,
)
def of_distances(instant: Instant, found) -> dict[str, Array]:
    """The thinnest film; the line of centres of two vesicles, the nearest neighbour of each of more."""
    domain, center = instant.equation.domain.at(instant.t), found["center"]
    least = least_gap(instant.motion.surfaces, domain)
    out = {"min_gap": least, "film_error": jnp.max(found["tension_tail"]) / (2 * least) ** 2}
    if center.shape[0] == 1:
        return out
    if center.shape[0] == 2:
        line = domain.displacement(center[0], center[1])
        return out | {"separation": jnp.hypot(line[0], line[1]), "line_angle": angle_of(line)}
    apart2 = jnp.sum(domain.displacement(center[:, None], center[None]) ** 2, axis=-1)
    itself = jnp.eye(center.shape[0], dtype=bool)
    return out | {"neighbor_distance": jnp.sqrt(jnp.min(jnp.where(itself, jnp.inf, apart2), axis=1))}


@gives("power_flow", "power_electric", "dissipation", "power_balance")
def of_powers(instant: Instant, found) -> dict[str, Array]:
    """The terms of the energy balance."""
    t, y, motion, scene = instant.t, instant.y, instant.motion, instant.scene
    curves = motion.surfaces.curves
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
        if scene.viscosity_ratio is not None:
            # The viscosity that the inner fluid has in excess resists the imposed rate of strain by this force.
            traction = scene.flow.traction(y.x, curves.normal, t)
            excess = (scene.viscosity_ratio - 1)[:, None, None] * traction
            resistance = jnp.sum(weights * excess * disturbance)
            out["power_flow"] = out["power_flow"] - resistance
    if scene.field is not None:
        out["power_electric"] = -jnp.sum(weights * motion.electric.traction * motion.velocity)
    supplied = sum(out.values(), start=jnp.zeros(()))
    out["dissipation"] = jnp.sum(weights * motion.f_hd * disturbance)
    if scene.flow is not None and scene.viscosity_ratio is not None:
        out["dissipation"] = out["dissipation"] - resistance
    out["power_balance"] = energy_rate + out["dissipation"] - supplied
    return out


@gives("residual")
def of_solves(instant: Instant, found) -> dict[str, Array]:
    """The worst residual of the linear solves."""
    return {"residual": instant.motion.residual}
