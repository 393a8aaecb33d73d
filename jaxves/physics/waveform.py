"""Time dependence of the imposed field: a factor on E_∞, which is 1 for a constant field."""

import abc
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.arguments import Bounded, is_known, refusal
from ..base.bounds import FINITE
from ..base.own_functions import number, require_returned
from ..base.physical_numbers import AMPLITUDE, DURATION, FREQUENCY, OFFSET, PHASE, RISE, START
from ..numerics.arrays import Scalar, as_float


def later(t: Array) -> Array:
    """Returns a time slightly after t, by more than round-off, at which a kink at t is placed.

    A time that is saved at t then differs from the kink. If one step ended at both, the derivative of the saved values
    would include their motion with the kink.
    """
    return t + 1e-13 * (1 + jnp.abs(t))


class AbstractHistory(Bounded):
    """A factor that depends on time, and the times at which it is not smooth. Time steps end at these times."""

    @abc.abstractmethod
    def __call__(self, t: Scalar) -> Scalar:
        """Returns the factor at time t."""

    @abc.abstractmethod
    def breakpoints(self) -> Float[Array, "B"]:
        """Returns the times of kinks or jumps, in order."""

    def period(self) -> Scalar | None:
        """Returns the period of the factor in units of t_κ, None if it has none."""
        return None


def require_history(argument: str, history: Any, example: str) -> None:
    """Raises ValueError unless `history` is a factor of time, of the built-in ones or of the user's own.

    Args:
        argument: its name in the message.
        history: the factor.
        example: what is expected, such as "Sine(5.0)".
    """
    if not isinstance(history, AbstractHistory):
        raise refusal(argument, history, f"a factor of time, such as {example}")
    expected = "a factor of time in JAX that returns one number for the time t"
    require_returned(argument, history.__call__, number(), shapes=[()], expected=expected)


class Pulse(AbstractHistory):
    """0 before `start`, 1 after a linear rise of length `rise`, and 0 again from `start + duration + rise` on.

    It begins to fall at `start + duration`. Times are in t_κ.
    """

    bounds: ClassVar = {number.key: number.bounds for number in (START, DURATION, RISE)}

    start: Scalar = eqx.field(converter=as_float)
    duration: Scalar = eqx.field(converter=as_float)
    rise: Scalar = eqx.field(converter=as_float)

    def __call__(self, t):
        start, _, _, over = self.breakpoints()
        return jnp.clip(jnp.minimum(t - start, over - t) / self.rise, 0.0, 1.0)

    def breakpoints(self):
        end = self.start + self.duration
        return later(jnp.stack([self.start, self.start + self.rise, end, end + self.rise]))


class Sine(AbstractHistory):
    """offset + amplitude · sin(2π frequency t + phase); frequency in 1/t_κ, phase in radians."""

    bounds: ClassVar = {number.key: number.bounds for number in (FREQUENCY, AMPLITUDE, OFFSET, PHASE)}

    frequency: Scalar = eqx.field(converter=as_float)
    amplitude: Scalar = eqx.field(converter=as_float, default=AMPLITUDE.default)
    offset: Scalar = eqx.field(converter=as_float, default=OFFSET.default)
    phase: Scalar = eqx.field(converter=as_float, default=PHASE.default)

    def __call__(self, t):
        return self.offset + self.amplitude * jnp.sin(2 * jnp.pi * self.frequency * t + self.phase)

    def breakpoints(self):
        return jnp.zeros(0)

    def period(self):
        return 1 / self.frequency


class AC(AbstractHistory):
    """offset + amplitude · cos(2π frequency t + phase); frequency in 1/t_κ, phase in radians.

    With `averaged`, the electric quantities are complex envelopes and the force is its mean over a period
    (`equation/averaged_charging.py`). The factor is then the offset, and time steps may be longer than the period.
    """

    bounds: ClassVar = {number.key: number.bounds for number in (FREQUENCY, AMPLITUDE, OFFSET, PHASE)}

    frequency: Scalar = eqx.field(converter=as_float)
    amplitude: Scalar = eqx.field(converter=as_float, default=AMPLITUDE.default)
    offset: Scalar = eqx.field(converter=as_float, default=OFFSET.default)
    phase: Scalar = eqx.field(converter=as_float, default=PHASE.default)
    averaged: bool = eqx.field(static=True, default=False)

    def __call__(self, t):
        if self.averaged:
            return self.offset
        return self.offset + self.amplitude * jnp.cos(self.angular_frequency() * t + self.phase)

    def angular_frequency(self) -> Scalar:
        """Returns ω in units of 1/t_κ."""
        return 2 * jnp.pi * self.frequency

    def envelope(self) -> tuple[Scalar, Scalar]:
        """Returns the real and the imaginary part of Ê, where the factor is offset + Re[Ê e^{iωt}]."""
        return self.amplitude * jnp.cos(self.phase), self.amplitude * jnp.sin(self.phase)

    def breakpoints(self):
        return jnp.zeros(0)

    def period(self):
        return None if self.averaged else 1 / self.frequency


class PiecewiseLinear(AbstractHistory):
    """Piecewise linear through (times, values), constant before the first time and after the last.

    Raises:
        ValueError: known times do not increase, or the number of values differs from that of times.
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
        return later(self.times)
