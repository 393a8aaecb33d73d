r"""A closed curve and its geometry at the nodes.

    t = x_α / |x_α|,  n = (t_y, -t_x) outward on a counter-clockwise curve,  κ = +1 on the unit circle
    ds = |x_α| dα

Every function takes one curve, with nodes `x` of shape (N, 2). Use `jax.vmap` for several curves.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics import fourier
from ..numerics.arrays import NodePoints, Nodes, Scalar


class Curve(eqx.Module):
    """Nodes with tangent, normal, |x_α| (`speed`) and curvature; build it with `Curve.from_nodes`."""

    x: NodePoints
    tangent: NodePoints
    normal: NodePoints
    speed: Nodes
    curvature: Nodes

    @classmethod
    def from_nodes(cls, x: NodePoints) -> "Curve":
        """Returns the curve that is the trigonometric interpolant of the nodes."""
        d1 = fourier.derivative(x, axis=0)
        return cls.from_derivatives(x, d1, fourier.derivative(d1, axis=0))

    @classmethod
    def from_derivatives(cls, x: NodePoints, d1: NodePoints, d2: NodePoints) -> "Curve":
        """Returns the curve with these x, x_α and x_αα at the nodes."""
        speed = jnp.sqrt(jnp.sum(d1**2, axis=-1))
        tangent = d1 / speed[:, None]
        normal = jnp.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
        curvature = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / speed**3
        return cls(x, tangent, normal, speed, curvature)

    @property
    def weights(self) -> Float[Array, "*batch N"]:
        """Quadrature weights of the trapezoidal rule in arc length, which is spectrally accurate."""
        return self.speed * (2 * np.pi / self.speed.shape[-1])


def d_ds(f: Float[Array, "N *rest"], curve: Curve) -> Float[Array, "N *rest"]:
    """Returns ∂f/∂s at the nodes."""
    speed = curve.speed.reshape((-1,) + (1,) * (f.ndim - 1))
    return fourier.derivative(f, axis=0) / speed


def length(curve: Curve) -> Scalar:
    """Returns the perimeter L = ∮ ds."""
    return jnp.sum(curve.weights)


def area(curve: Curve) -> Scalar:
    """Returns the enclosed area A = ½ ∮ x·n ds, which is positive for a counter-clockwise curve."""
    return 0.5 * jnp.sum(jnp.sum(curve.x * curve.normal, axis=-1) * curve.weights)


def reduced_area(curve: Curve) -> Scalar:
    """Returns the reduced area Δ = 4πA/L², which is 1 for a circle."""
    return 4 * jnp.pi * area(curve) / length(curve) ** 2


def centroid(curve: Curve) -> Float[Array, "2"]:
    """Returns the centroid of the enclosed area, ∫ x dA / A, by the divergence theorem."""
    moments = 0.5 * jnp.sum(curve.x**2 * (curve.normal * curve.weights[:, None]), axis=0)
    return moments / area(curve)


def second_moments(curve: Curve) -> Float[Array, "2 2"]:
    """Returns I_ab = ∫ (x - c)_a (x - c)_b dA about the centroid c. Its major axis defines that of the vesicle."""
    r = curve.x - centroid(curve)
    flux = jnp.sum(r * curve.normal, axis=-1) * curve.weights
    # ∇·(r r_a r_b) = 4 r_a r_b in two dimensions
    return 0.25 * jnp.einsum("na,nb,n->ab", r, r, flux)


def inclination(curve: Curve) -> Scalar:
    """Returns the angle from the x axis to the major axis, in radians in (-π/2, π/2]; 0 for a circle."""
    moment = second_moments(curve)
    sine, cosine = 2 * moment[0, 1], moment[0, 0] - moment[1, 1]
    # For a circle both vanish and arctan2 has no derivative. It is evaluated at (0, 1) instead.
    size = moment[0, 0] + moment[1, 1]
    round_ = sine**2 + cosine**2 < (1e-12 * size) ** 2
    return 0.5 * jnp.arctan2(jnp.where(round_, 0.0, sine), jnp.where(round_, 1.0, cosine))


def deformation(curve: Curve, axis: Float[Array, "2"]) -> Scalar:
    """Returns D = (√I_aa - √I_bb)/(√I_aa + √I_bb), with a along the unit vector `axis` and b perpendicular to it.

    D is positive if the vesicle is elongated along `axis`.
    """
    moment = second_moments(curve)
    along = jnp.sqrt(axis @ moment @ axis)
    across_axis = jnp.stack([-axis[1], axis[0]])
    across = jnp.sqrt(across_axis @ moment @ across_axis)
    return (along - across) / (along + across)
