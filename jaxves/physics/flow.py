"""Imposed flows v_∞(x, t), which are linear in position. Their strength is the capillary number Ca."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.arguments import Bounded, is_known, refusal, require
from ..base.bounds import FINITE
from ..base.physical_numbers import CAPILLARY_NUMBER
from ..numerics.arrays import Scalar, VesiclePoints, as_float


class AbstractFlow(Bounded):
    """v_∞ = ∇v·x. The gradient may depend on time."""

    @abc.abstractmethod
    def gradient(self, t: Scalar) -> Float[Array, "2 2"]:
        """Returns ∂v_a/∂x_b at time t."""

    def velocity(self, x: VesiclePoints, t: Scalar) -> VesiclePoints:
        """Returns v_∞ at the points x, (..., 2)."""
        return jnp.einsum("ab,...b->...a", self.gradient(t), x)

    @abc.abstractmethod
    def effective_viscosity(self, stress: Float[Array, "*batch 2 2"]) -> Float[Array, "*batch"]:
        """Returns the intrinsic viscosity [μ] from the particle stress tensor (`observables/diagnostics.py`)."""


class _OfStrength(AbstractFlow):
    """A flow whose strength is the capillary number. It must not be zero; use no flow (None) instead.

    Raises:
        ValueError: a known capillary number is zero or not finite.
    """

    bounds: ClassVar = {"capillary_number": CAPILLARY_NUMBER.bounds}

    capillary_number: Scalar = eqx.field(converter=as_float)

    def __check_init__(self):
        if self.capillary_number.shape != () or (
            is_known(self.capillary_number) and not np.any(np.asarray(self.capillary_number))
        ):
            wanted = "one finite number other than zero"
            raise refusal(f"{type(self).__name__}.capillary_number", self.capillary_number, wanted)


class Shear(_OfStrength):
    """v = Ca (y, 0)."""

    def gradient(self, t):
        return self.capillary_number * jnp.array([[0.0, 1.0], [0.0, 0.0]])

    def effective_viscosity(self, stress):
        """Returns [μ] = Σ₁₂/Ca."""
        return stress[..., 0, 1] / self.capillary_number


class Extension(_OfStrength):
    """v = Ca (x, -y)."""

    def gradient(self, t):
        return self.capillary_number * jnp.array([[1.0, 0.0], [0.0, -1.0]])

    def effective_viscosity(self, stress):
        """Returns [μ] = (Σ₁₁ - Σ₂₂)/4Ca, the particle stress divided by the stress of the fluid alone."""
        return (stress[..., 0, 0] - stress[..., 1, 1]) / (4 * self.capillary_number)


def _is_trace_free(gradient: Float[np.ndarray, "2 2"]) -> bool:
    return bool(np.abs(np.trace(gradient)) <= 1e-12 * np.max(np.abs(gradient)))


class LinearFlow(AbstractFlow):
    """v = ∇v·x with any trace-free gradient, (2, 2).

    Raises:
        ValueError: a known gradient has a trace. The flow of an incompressible fluid has none.
    """

    bounds: ClassVar = {"velocity_gradient": FINITE}

    velocity_gradient: Float[Array, "2 2"] = eqx.field(converter=as_float)

    def __check_init__(self):
        require("LinearFlow.velocity_gradient", self.velocity_gradient, FINITE)
        shape, known = self.velocity_gradient.shape, is_known(self.velocity_gradient)
        # A traced gradient may have a trace, because derivatives vary one entry at a time.
        if shape != (2, 2) or (known and not _is_trace_free(np.asarray(self.velocity_gradient))):
            wanted = "a trace-free gradient [[a, b], [c, -a]] of finite numbers"
            raise refusal("LinearFlow.velocity_gradient", self.velocity_gradient, wanted)

    def gradient(self, t):
        return self.velocity_gradient

    def effective_viscosity(self, stress):
        """Returns [μ] = Σ:D / 2D:D with the rate of strain D; NaN for a pure rotation, for which D = 0."""
        strain = 0.5 * (self.velocity_gradient + self.velocity_gradient.T)
        return jnp.einsum("...ab,ab->...", stress, strain) / (2 * jnp.sum(strain**2))
