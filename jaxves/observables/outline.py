"""How fast shapes and scalars change at fixed places on the outlines."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..equation.state import Motion, Unknowns
from ..numerics.arrays import VesicleNodes


def rates_on_outline(motion: Motion, y: Unknowns) -> tuple[Float[Array, "M N"], dict[str, VesicleNodes]]:
    """Returns the normal velocity (M, N) relative to the mean, and the rates (M, N) of the scalars by name.

    The rates of `motion` are at material points. Here the part that the tangential motion carries along is subtracted,
    so that everything is zero for steady tank-treading.
    """
    curves = motion.surfaces.curves
    weights = curves.weights[..., None] / jnp.sum(curves.weights, axis=1)[:, None, None]
    relative = motion.velocity - jnp.sum(weights * motion.velocity, axis=1, keepdims=True)
    along = jnp.sum(relative * curves.tangent, axis=-1)
    rates = {name: rate - along * motion.surfaces.d_ds(y.scalars[name]) for name, rate in motion.rates.items()}
    return jnp.sum(relative * curves.normal, axis=-1), rates
