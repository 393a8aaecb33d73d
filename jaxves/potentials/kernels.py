r"""Free-space kernels at distinct points, without quadrature. Tests of quadrature rules compare with them.

    Laplace   G(r)      = -log|r| / 2π
    Stokes    G_ab(r)   = (-log|r| δ_ab + r_a r_b/|r|²) / 4π          (viscosity 1)
    pressure  p_b(r)    = r_b / (2π|r|²)

`r = x - y` points from the source y to the target x.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Separation = Float[Array, "*batch 2"]


def laplace(r: Separation) -> Float[Array, "*batch"]:
    """Returns G(r)."""
    return -0.25 * jnp.log(jnp.sum(r**2, axis=-1)) / jnp.pi


def laplace_gradient(r: Separation) -> Float[Array, "*batch 2"]:
    """Returns ∇_x G = -r/(2π|r|²)."""
    return -r / (2 * jnp.pi * jnp.sum(r**2, axis=-1, keepdims=True))


def stokeslet(r: Separation) -> Float[Array, "*batch 2 2"]:
    """Returns G_ab(r): the velocity component a caused by a unit point force in direction b."""
    r2 = jnp.sum(r**2, axis=-1)[..., None, None]
    return (-0.5 * jnp.log(r2) * jnp.eye(2) + r[..., :, None] * r[..., None, :] / r2) / (4 * jnp.pi)


def stokeslet_pressure(r: Separation) -> Float[Array, "*batch 2"]:
    """Returns p_b(r): the pressure caused by a unit point force in direction b."""
    return r / (2 * jnp.pi * jnp.sum(r**2, axis=-1, keepdims=True))
