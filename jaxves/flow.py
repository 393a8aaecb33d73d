"""Imposed flows v_∞(x, t), linear in position; their strength is the capillary number Ca."""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .arrays import Scalar, VesiclePoints, as_float


class AbstractFlow(eqx.Module):
    """v_∞ = ∇v·x. The gradient may depend on time."""

    @abc.abstractmethod
    def gradient(self, t: Scalar) -> Float[Array, "2 2"]:
        """∂v_a/∂x_b."""

    def velocity(self, x: VesiclePoints, t: Scalar) -> VesiclePoints:
        """v_∞ at points x of any leading shape."""
        return jnp.einsum("ab,...b->...a", self.gradient(t), x)

    @abc.abstractmethod
    def effective_viscosity(self, stress: Float[Array, "*batch 2 2"]) -> Float[Array, "*batch"]:
        """Intrinsic viscosity [μ] from the particle stress tensor (`diagnostics`)."""


class Shear(AbstractFlow):
    """v = Ca (y, 0)."""

    capillary_number: Scalar = eqx.field(converter=as_float)

    def gradient(self, t):
        return self.capillary_number * jnp.array([[0.0, 1.0], [0.0, 0.0]])

    def effective_viscosity(self, stress):
        """[μ] = Σ₁₂/Ca: force along the flow times distance across it."""
        return stress[..., 0, 1] / self.capillary_number


class Extension(AbstractFlow):
    """v = Ca (x, -y)."""

    capillary_number: Scalar = eqx.field(converter=as_float)

    def gradient(self, t):
        return self.capillary_number * jnp.array([[1.0, 0.0], [0.0, -1.0]])

    def effective_viscosity(self, stress):
        """[μ] = (Σ₁₁ - Σ₂₂)/4Ca, the ratio of the stress to that of the bare fluid."""
        return (stress[..., 0, 0] - stress[..., 1, 1]) / (4 * self.capillary_number)


class Linear(AbstractFlow):
    """v = ∇v·x with any trace-free gradient, (2, 2)."""

    velocity_gradient: Float[Array, "2 2"] = eqx.field(converter=as_float)

    def gradient(self, t):
        return self.velocity_gradient

    def effective_viscosity(self, stress):
        """[μ] = Σ:D / 2D:D with the rate of strain D; NaN for a pure rotation, which strains nothing."""
        strain = 0.5 * (self.velocity_gradient + self.velocity_gradient.T)
        return jnp.einsum("...ab,ab->...", stress, strain) / (2 * jnp.sum(strain**2))
