r"""Motion of a circle: a membrane that encloses the largest area its perimeter allows cannot deform.

As Δ → 1 the mean tension grows without bound, and only the motion of a rigid body remains:

    v = U + Ω e_z × r.

The force that keeps the shape has no resultant and no torque. On a circle of radius R the single layer does not mix
Fourier modes: for f₁ + i f₂ = c e^{ikθ}, S f = R/4|k| f, except for the resultant (k = 0), the pressure and the torque
(k = 1). U and Ω are therefore means of the velocity that the other forces cause, and the force that keeps the shape
follows for each mode. With two viscosities, a force moves the fluid 2/(1 + ν) times as fast in all modes but the rigid
ones, which are the same for every ν.

This holds for a vesicle without others, because that force would move another vesicle.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodePoints, Nodes, Points, Scalar


class RigidMotion(eqx.Module):
    """The motion v = U + Ω e_z × (x - c), with `velocity` U, `rotation` Ω and `center` c."""

    velocity: Float[Array, "2"]
    rotation: Scalar
    center: Float[Array, "2"]

    @classmethod
    def nearest(cls, curve: Curve, velocity: NodePoints) -> "RigidMotion":
        """Returns the rigid motion that is nearest to a velocity at the nodes of a curve, by the mean square in ds."""
        weights = curve.weights / jnp.sum(curve.weights)
        center, mean = weights @ curve.x, weights @ velocity
        arm = curve.x - center
        turning = arm[:, 0] * velocity[:, 1] - arm[:, 1] * velocity[:, 0]
        return cls(mean, (weights @ turning) / (weights @ jnp.sum(arm**2, axis=-1)), center)

    def at(self, points: Points) -> Points:
        """Returns the velocity at points (P, 2)."""
        arm = points - self.center
        return self.velocity + self.rotation * jnp.stack([-arm[:, 1], arm[:, 0]], axis=-1)


def rigid_part(curve: Curve, velocity: NodePoints) -> NodePoints:
    """Returns U + Ω e_z × r on a circle; U is the mean of `velocity`, Ω comes from its mean tangential component."""
    turning = jnp.mean(jnp.sum(velocity * curve.tangent, axis=-1))
    return jnp.mean(velocity, axis=0) + turning * curve.tangent


def holding_force(curve: Curve, velocity: NodePoints) -> NodePoints:
    """Returns the force per unit length whose single layer on a circle is `velocity`, which has no rigid part."""
    radius = jnp.mean(curve.speed)
    return (4 / radius) * fourier.multiply(velocity, fourier.wavenumbers(velocity.shape[0]), axis=0)


def nearest_circle(x: NodePoints, radius: Scalar) -> NodePoints:
    """Returns equispaced nodes on the circle of this radius, with the centre and the phase of the nodes `x`."""
    alpha = fourier.grid(x.shape[0])
    cosine, sine = jnp.cos(alpha), jnp.sin(alpha)
    center = jnp.mean(x, axis=0)
    real = jnp.mean(x[:, 0] * cosine + x[:, 1] * sine)
    imaginary = jnp.mean(x[:, 1] * cosine - x[:, 0] * sine)
    scale = radius / jnp.sqrt(real**2 + imaginary**2)
    turned = jnp.stack([real * cosine - imaginary * sine, real * sine + imaginary * cosine], axis=-1)
    return center + scale * turned


def held(
    curve: Curve, sigma: Nodes, force: NodePoints, velocity: NodePoints, viscosity_ratio: Scalar | None = None
) -> tuple[Nodes, NodePoints, NodePoints]:
    """Returns tension, force and velocity of a circle, with the force that keeps its shape.

    The velocity is the rigid part of `velocity`. `viscosity_ratio` is ν, None for equal viscosities.
    """
    rigid = rigid_part(curve, velocity)
    holding = holding_force(curve, rigid - velocity)
    if viscosity_ratio is not None:
        holding = 0.5 * (1 + viscosity_ratio) * holding
    along = jnp.sum(holding * curve.tangent, axis=-1) * curve.speed
    return sigma + fourier.antiderivative(along), force + holding, rigid
