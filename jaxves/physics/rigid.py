r"""A membrane that encloses all the area its perimeter allows: a circle, which cannot deform.

As Δ → 1 the mean tension grows without bound, and what is left of the motion is that of a rigid body,

    v = U + Ω e_z × r.

Forces that hold a shape have no resultant and no torque, and on a circle the single layer keeps Fourier modes apart:
for f₁ + i f₂ = c e^{ikθ}, S f = R/4|k| f but for the resultant (k = 0), the pressure and the torque (k = 1). So U and
Ω are means of the velocity that other forces cause, and the holding force follows mode by mode.

This holds for a vesicle alone: another one would feel the holding force.
"""

import jax.numpy as jnp

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodePoints, Scalar


def rigid_part(curve: Curve, velocity: NodePoints) -> NodePoints:
    """U + Ω e_z × r with the mean of `velocity` and of its tangential part, on a circle."""
    turning = jnp.mean(jnp.sum(velocity * curve.tangent, axis=-1))
    return jnp.mean(velocity, axis=0) + turning * curve.tangent


def holding_force(curve: Curve, velocity: NodePoints) -> NodePoints:
    """The force per unit length whose single layer on a circle is `velocity`, which has no rigid part."""
    radius = jnp.mean(curve.speed)
    return (4 / radius) * fourier.multiply(velocity, fourier.wavenumbers(velocity.shape[0]), axis=0)


def nearest_circle(x: NodePoints, radius: Scalar) -> NodePoints:
    """Equispaced nodes on the circle of this radius, with the centre and the phase of the nodes `x`."""
    alpha = fourier.grid(x.shape[0])
    cosine, sine = jnp.cos(alpha), jnp.sin(alpha)
    center = jnp.mean(x, axis=0)
    real = jnp.mean(x[:, 0] * cosine + x[:, 1] * sine)
    imaginary = jnp.mean(x[:, 1] * cosine - x[:, 0] * sine)
    scale = radius / jnp.sqrt(real**2 + imaginary**2)
    turned = jnp.stack([real * cosine - imaginary * sine, real * sine + imaginary * cosine], axis=-1)
    return center + scale * turned
