"""The viscous stress of fluids inside of vesicles in excess of that of the outer fluid."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..equation.state import Motion
from ..numerics.arrays import PerVesicle


def excess_viscous(motion: Motion, ratio: PerVesicle) -> Float[Array, "2 2"]:
    """Returns Σ (ν - 1) ∮ (v ⊗ n + n ⊗ v) ds, the integral of 2 (ν - 1) e over the insides."""
    curves = motion.surfaces.curves
    excess = (ratio - 1)[:, None, None] * curves.normal * curves.weights[..., None]
    outer = jnp.einsum("mna,mnb->ab", motion.velocity, excess)
    return outer + outer.T
