"""How the strength of the imposed field depends on time: a factor on E_∞, 1 for a constant field."""

import abc
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.arguments import Bounded, is_known, refusal
from ..base.bounds import FINITE, POSITIVE
from ..numerics.arrays import Scalar, as_float


def _later(t: Array) -> Array:
    """Where a kink at t is put: clearly after an instant that is saved at t, whatever the round-off of either.

    A step that ended at both would move with the kink, and so would what is saved, when differentiated.
    """
    return t + 1e-13 * (1 + jnp.abs(t))


class AbstractHistory(Bounded):
    """A factor of time, and the instants at which it is not smooth (steps are made to end there)."""

    @abc.abstractmethod
    def __call__(self, t: Scalar) -> Scalar:
        """The factor at time t."""

    @abc.abstractmethod
    def breakpoints(self) -> Float[Array, "B"]:
        """Instants of kinks or jumps, in order."""


class Pulse(AbstractHistory):
    """0, then 1 from `start` for `duration`, then 0 again, with linear flanks of length `rise`."""

    bounds: ClassVar = {"start": FINITE, "duration": POSITIVE, "rise": POSITIVE}

    start: Scalar = eqx.field(converter=as_float)
    duration: Scalar = eqx.field(converter=as_float)
    rise: Scalar = eqx.field(converter=as_float)

    def __call__(self, t):
        start, _, _, over = self.breakpoints()
        return jnp.clip(jnp.minimum(t - start, over - t) / self.rise, 0.0, 1.0)

    def breakpoints(self):
        end = self.start + self.duration
        return _later(jnp.stack([self.start, self.start + self.rise, end, end + self.rise]))


class Sine(AbstractHistory):
    """offset + amplitude · sin(2π frequency t + phase); frequency in 1/t_κ, phase in radians."""

    bounds: ClassVar = {"frequency": POSITIVE, "amplitude": FINITE, "offset": FINITE, "phase": FINITE}

    frequency: Scalar = eqx.field(converter=as_float)
    amplitude: Scalar = eqx.field(converter=as_float, default=1.0)
    offset: Scalar = eqx.field(converter=as_float, default=0.0)
    phase: Scalar = eqx.field(converter=as_float, default=0.0)

    def __call__(self, t):
        return self.offset + self.amplitude * jnp.sin(2 * jnp.pi * self.frequency * t + self.phase)

    def breakpoints(self):
        return jnp.zeros(0)


class PiecewiseLinear(AbstractHistory):
    """Piecewise linear through (times, values), constant before the first and after the last.

    Raises:
        ValueError: times do not increase, or there is not one value for each.
    """

    bounds: ClassVar = {"times": FINITE, "values": FINITE}

    times: Float[Array, "B"] = eqx.field(converter=as_float)
    values: Float[Array, "B"] = eqx.field(converter=as_float)

    def __check_init__(self):
        if (
            self.times.ndim != 1
            or len(self.times) < 2
            or (is_known(self.times) and not np.all(np.diff(np.asarray(self.times)) > 0))
        ):
            raise refusal("PiecewiseLinear.times", self.times, "two or more increasing times")
        if self.values.shape != self.times.shape:
            raise refusal(
                "PiecewiseLinear.values", self.values, f"{len(self.times)} numbers, one for each of the times"
            )

    def is_within_bounds(self):
        return super().is_within_bounds() & jnp.all(jnp.diff(self.times) > 0)

    def __call__(self, t):
        return jnp.interp(t, self.breakpoints(), self.values)

    def breakpoints(self):
        return _later(self.times)
