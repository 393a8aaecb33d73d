"""Imposed flows v_∞(x, t): linear in position, Poiseuille, any function of your own, and a time dependence of each.

The strength of a flow is the capillary number Ca. A flow must be divergence-free.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.arguments import Bounded, is_known, refusal, require
from ..base.bounds import FINITE
from ..base.physical_numbers import CAPILLARY_NUMBER, HALF_WIDTH
from ..numerics.arrays import Scalar, ScalarLike, VesiclePoints, as_float
from .point_functions import OwnFunction, at_points, require_vector, require_without
from .waveform import AbstractHistory, require_history


class AbstractFlow(Bounded):
    """An imposed flow."""

    @abc.abstractmethod
    def velocity(self, x: VesiclePoints, t: Scalar) -> VesiclePoints:
        """Returns v_∞ at the points x, (..., 2)."""

    @abc.abstractmethod
    def traction(self, x: VesiclePoints, normal: VesiclePoints, t: Scalar) -> VesiclePoints:
        """Returns (-p + ∇v + ∇vᵀ)·n of the imposed flow, for unit viscosity.

        Raises:
            ValueError: the pressure of the flow is not known.
        """

    def is_linear(self) -> bool:
        """Returns whether v_∞ is linear in position, so that it is symmetric about every point that moves with it."""
        return False

    def breakpoints(self) -> Float[Array | np.ndarray, "B"]:
        """Returns the times at which the flow is not smooth, in order. Time steps end there."""
        return jnp.zeros(0)

    def steep_times(self, x: VesiclePoints, t_end: ScalarLike) -> Float[Array | np.ndarray, "S"]:
        """Returns times that a function of the user changes at, found from samples (`OwnFunction.steep_times`)."""
        return np.zeros(0)

    def period(self) -> Scalar | None:
        """Returns the period of the flow in units of t_κ, None if it has none."""
        return None

    def effective_viscosity(self, stress: Float[Array, "*batch 2 2"]) -> Float[Array, "*batch"] | None:
        """Returns the intrinsic viscosity [μ] from the particle stress tensor (`observables/diagnostics.py`).

        It is None for a flow in which [μ] is not defined: without one constant rate of strain. Results then do not have
        this quantity.
        """
        return None


class AbstractLinearFlow(AbstractFlow):
    """v_∞ = ∇v·x."""

    @abc.abstractmethod
    def gradient(self, t: Scalar) -> Float[Array, "2 2"]:
        """Returns ∂v_a/∂x_b at time t."""

    def velocity(self, x, t):
        return jnp.einsum("ab,...b->...a", self.gradient(t), x)

    def traction(self, x, normal, t):
        gradient = self.gradient(t)
        return normal @ (gradient + gradient.T)

    def is_linear(self):
        return True


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


class Shear(_OfStrength, AbstractLinearFlow):
    """v = Ca (y, 0)."""

    def gradient(self, t):
        return self.capillary_number * jnp.array([[0.0, 1.0], [0.0, 0.0]])

    def effective_viscosity(self, stress):
        """Returns [μ] = Σ₁₂/Ca."""
        return stress[..., 0, 1] / self.capillary_number


class Extension(_OfStrength, AbstractLinearFlow):
    """v = Ca (x, -y)."""

    def gradient(self, t):
        return self.capillary_number * jnp.array([[1.0, 0.0], [0.0, -1.0]])

    def effective_viscosity(self, stress):
        """Returns [μ] = (Σ₁₁ - Σ₂₂)/4Ca, the particle stress divided by the stress of the fluid alone."""
        return (stress[..., 0, 0] - stress[..., 1, 1]) / (4 * self.capillary_number)


def _is_trace_free(gradient: Float[np.ndarray, "2 2"]) -> bool:
    return bool(np.abs(np.trace(gradient)) <= 1e-12 * np.max(np.abs(gradient)))


class LinearFlow(AbstractLinearFlow):
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


class Poiseuille(_OfStrength):
    """v = Ca (1 - (y/w)², 0), the flow between plates at y = ±w, which are not walls here.

    The pressure is -2 Ca x/w². Ca is the speed on the axis in a/t_κ. The rate of strain varies in space, so [μ] is not
    defined.
    """

    bounds: ClassVar = {"capillary_number": CAPILLARY_NUMBER.bounds, HALF_WIDTH.key: HALF_WIDTH.bounds}

    half_width: Scalar = eqx.field(converter=as_float, default=HALF_WIDTH.default)

    def velocity(self, x, t):
        profile = self.capillary_number * (1 - (x[..., 1] / self.half_width) ** 2)
        return jnp.stack([profile, jnp.zeros_like(profile)], axis=-1)

    def traction(self, x, normal, t):
        # -p + ∇v + ∇vᵀ has the diagonal 2 Ca x/w² and the off-diagonal entry -2 Ca y/w².
        slope = 2 * self.capillary_number / self.half_width**2
        along, across = slope * x[..., 0, None] * normal, -slope * x[..., 1, None] * normal[..., ::-1]
        return along + across


class FlowFunction(OwnFunction, AbstractFlow):
    """A flow of your own: a function v(x, t) in JAX from one point (2,) and the time to the velocity (2,).

    `make_scene(flow=v)` makes it from a function. Arrays in a function that is an `equinox.Module` can be traced,
    differentiated and batched. A plain function must be the same object in later calls, or JAX compiles again.

    Steps end where the flow changes most (`steep_times`), and at the times that a method `breakpoints()` of the
    function returns. A pulse shorter than `t_end`/1000 has to be stated there, or a step may pass over it.

    Raises:
        ValueError: JAX cannot trace the function, as with a Python `if` on the time; it does not return one array (2,);
            or it has a divergence at one of a few points.
    """

    bounds: ClassVar = {}

    def __check_init__(self):
        require_vector("flow", self.function, "velocity", "v")
        self.require_breakpoints("flow")
        if is_known(self.arrays):
            require_without("flow", self.function, divergence="a divergence-free flow, as the fluid is incompressible")

    def velocity(self, x, t):
        return at_points(self.function, x, t)

    def traction(self, x, normal, t):
        raise refusal("flow", "a function of your own", "a flow whose pressure is known where viscosities differ")


class TimeDependent(AbstractFlow):
    """A flow times a factor of time, such as `TimeDependent(Shear(10.0), Sine(5.0))` for oscillating shear.

    `Pulse` starts and ends a flow, `PiecewiseLinear` starts or reverses it. [μ] is not defined.
    """

    bounds: ClassVar = {}

    flow: AbstractFlow
    history: AbstractHistory

    def __check_init__(self):
        if not isinstance(self.flow, AbstractFlow):
            raise refusal("TimeDependent.flow", self.flow, "a flow, such as Shear(10.0)")
        require_history("TimeDependent.history", self.history, "Sine(5.0)")

    def is_within_bounds(self):
        return self.flow.is_within_bounds() & self.history.is_within_bounds()

    def velocity(self, x, t):
        return self.history(t) * self.flow.velocity(x, t)

    def traction(self, x, normal, t):
        return self.history(t) * self.flow.traction(x, normal, t)

    def is_linear(self):
        return self.flow.is_linear()

    def breakpoints(self):
        own, of_flow = self.history.breakpoints(), self.flow.breakpoints()
        return jnp.sort(jnp.concatenate([own, of_flow])) if of_flow.size else own

    def steep_times(self, x, t_end):
        return self.flow.steep_times(x, t_end)

    def period(self):
        return self.history.period()
