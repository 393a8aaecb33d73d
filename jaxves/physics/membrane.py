r"""Elastic forces that an inextensible membrane exerts on the fluid, per unit length.

    f_b = κ_B (κ_ss + κ³/2) n              bending
    f_λ = (λ x_s)_s                        tension λ, the multiplier of x_s · (dx/dt)_s = 0
    f_b + f_λ = -κ_B x_ssss + (σ x_s)_s,   λ = σ + (3/2) κ_B κ²

The code solves for σ, because the force is then linear in x. Results contain the physical tension λ.
"""

import jax.numpy as jnp

from ..geometry.curve import Curve, d_ds
from ..numerics.arrays import NodePoints, Nodes, Scalar


def linear_bending_force(curve: Curve, bending: Scalar) -> NodePoints:
    """Returns -κ_B x_ssss, (N, 2)."""
    f = curve.tangent
    for _ in range(3):
        f = d_ds(f, curve)
    return -bending * f


def linear_tension_force(curve: Curve, sigma: Nodes) -> NodePoints:
    """Returns (σ x_s)_s, (N, 2)."""
    return d_ds(sigma[:, None] * curve.tangent, curve)


def stretch_rate(curve: Curve, velocity: NodePoints) -> Nodes:
    """Returns x_s · v_s, the rate at which this velocity stretches the membrane, (N,)."""
    return jnp.sum(curve.tangent * d_ds(velocity, curve), axis=-1)


def physical_tension(curve: Curve, sigma: Nodes, bending: Scalar) -> Nodes:
    """Returns λ = σ + (3/2) κ_B κ², (N,)."""
    return sigma + 1.5 * bending * curve.curvature**2


def bending_force(curve: Curve, bending: Scalar) -> NodePoints:
    """Returns κ_B (κ_ss + κ³/2) n, (N, 2)."""
    kappa = curve.curvature
    return bending * (d_ds(d_ds(kappa, curve), curve) + 0.5 * kappa**3)[:, None] * curve.normal


def bending_energy(curve: Curve, bending: Scalar) -> Scalar:
    """Returns the bending energy (κ_B/2) ∮ κ² ds."""
    return 0.5 * bending * jnp.sum(curve.curvature**2 * curve.weights)


def fastest_wrinkle(curve: Curve, sigma: Nodes, bending: Scalar) -> Scalar:
    """Returns the number of waves along the membrane of the fastest growing wrinkle; 0 without compression.

    A wave q on a plane membrane grows at the rate (-σ q - κ_B q³)/4, which is largest at q² = -σ/3κ_B. The least σ on
    the membrane is used. `sigma` may also be the physical tension, which differs where the membrane is curved.
    """
    compression = jnp.maximum(-jnp.min(sigma), 0.0)
    return jnp.mean(curve.speed) * jnp.sqrt(compression / (3 * bending))


def wrinkle_growth(curve: Curve, sigma: Nodes, bending: Scalar) -> Scalar:
    """Returns the growth rate of the fastest growing wrinkle, per t_κ at equal viscosities; 0 without compression.

    At q² = -σ/3κ_B the rate of `fastest_wrinkle` is κ_B q³/2.
    """
    return 0.5 * bending * (fastest_wrinkle(curve, sigma, bending) / jnp.mean(curve.speed)) ** 3
