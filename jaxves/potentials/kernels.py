r"""Free-space kernels at separate points, pointwise and without quadrature: what every rule is tested against.

    Laplace   G(r)      = -log|r| / 2π
    Stokes    G_ab(r)   = (-log|r| δ_ab + r_a r_b/|r|²) / 4π          (viscosity 1)
    pressure  p_b(r)    = r_b / (2π|r|²)
    stress    T_abc(r)  = -r_a r_b r_c / (π|r|⁴)       traction on a surface element: T_abc n_c

`r = x - y` points from source to target.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

Separation = Float[Array, "*batch 2"]


def laplace(r: Separation) -> Float[Array, "*batch"]:
    """G(r)."""
    return -0.25 * jnp.log(jnp.sum(r**2, axis=-1)) / jnp.pi


def laplace_gradient(r: Separation) -> Float[Array, "*batch 2"]:
    """∇_x G = -r/(2π|r|²)."""
    return -r / (2 * jnp.pi * jnp.sum(r**2, axis=-1, keepdims=True))


def stokeslet(r: Separation) -> Float[Array, "*batch 2 2"]:
    """Velocity of a unit point force."""
    r2 = jnp.sum(r**2, axis=-1)[..., None, None]
    return (-0.5 * jnp.log(r2) * jnp.eye(2) + r[..., :, None] * r[..., None, :] / r2) / (4 * jnp.pi)


def stokeslet_pressure(r: Separation) -> Float[Array, "*batch 2"]:
    """Pressure of a unit point force."""
    return r / (2 * jnp.pi * jnp.sum(r**2, axis=-1, keepdims=True))
