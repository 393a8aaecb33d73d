"""Diagnostics of membranes whose charge relaxes in a finite time: net charge, and the tension of the lipid."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..geometry import extremes
from .registry import Instant, gives


def has_relaxation(scene) -> bool:
    """Returns whether the scene has a field in which charge relaxes in a finite time."""
    return scene.field is not None and scene.field.charge_relaxation is not None


@gives("interfacial_charge", "lipid_tension_max", needed=has_relaxation)
def of_charge(instant: Instant, found) -> dict[str, Array]:
    """The charge of every interface, and the tension of the lipid.

    The stress of the membrane as a capacitor is that of the isotropic tension -½ C_m V_m². The tension λ of the motion
    contains it, so the lipid carries λ + ½ C_m V_m², which decides on poration.
    """
    motion, field = instant.motion, instant.scene.field
    own_relaxation = field.relaxation_time() / field.membrane_chi
    share = field.stress_scale() / (2 * own_relaxation[:, None]) * motion.electric.V_m_square
    values = motion.surfaces.curves, motion.sigma + share, instant.scene.bending
    tension = jax.vmap(lambda *one: extremes.over_membrane(*one, None))(*values)["tension_max"]
    net = jnp.sum(instant.y.scalars["Q"] * motion.surfaces.curves.weights, axis=1)
    return {"interfacial_charge": net, "lipid_tension_max": tension}
