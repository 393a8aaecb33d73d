"""Step-size control: a PI controller for the embedded error.

[HW] E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, Springer 1996, section IV.2: the exponents 0.7/k
     and 0.4/k for a scheme of order k.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int

from ..base import status
from ..numerics.arrays import Scalar, Status
from .state import State

_SMALLEST_ERROR = 1e-8  # lower bound of the error, in units of the tolerance
_SMALLEST_MEMORY = 1e-4  # the same for the error that is stored for the next step


class Attempt(NamedTuple):
    """The end of a step that is tried, and whether it is at one of the stops."""

    t_new: Scalar
    stop: Int[Array, ""]
    at_stop: Bool[Array, ""]

    @classmethod
    def of(cls, state: State, stops: Array) -> "Attempt":
        """Returns the step to try from `state`. It ends at the next stop, or at most half way to it."""
        t = state.t
        stop = jnp.argmin(jnp.where(stops > t, stops, jnp.inf))
        room = stops[stop] - t
        at_stop = state.h >= room
        free = lax.stop_gradient(jnp.where(2 * state.h > room, 0.5 * room, state.h))
        return cls(jnp.where(at_stop, stops[stop], t + free), stop, at_stop)


class PIController(eqx.Module):
    """Computes step sizes from errors in units of the tolerance, for a scheme of this order, within limits."""

    order: int = eqx.field(static=True)
    largest: float = eqx.field(static=True)
    smallest: float | Scalar
    max_steps: int = eqx.field(static=True)

    def after_accepted(self, h: Scalar, error: Scalar, state: State) -> tuple[Scalar, Scalar]:
        """Returns the size of the step after an accepted step of size h from `state`, and the error to store."""
        e = jnp.maximum(error, _SMALLEST_ERROR)
        grown = h * jnp.clip(0.9 * e ** (-0.7 / self.order) * state.last_error ** (0.4 / self.order), 0.2, 3.0)
        # If a stop shortened the step, its error says little about the next one. The size before it is used again.
        grown = jnp.where(h < state.h, jnp.maximum(grown, state.h), grown)
        return jnp.minimum(grown, self.largest), jnp.maximum(e, _SMALLEST_MEMORY)

    def after_refused(self, h: Scalar, error: Scalar, sound: Bool[Array, ""]) -> Scalar:
        """Returns the step size to try instead of h. `sound` says whether the error estimate is reliable."""
        e = jnp.maximum(error, _SMALLEST_ERROR)
        return jnp.where(sound, h * jnp.clip(0.9 * e ** (-1 / self.order), 0.2, 0.9), 0.25 * h)

    def limit(self, state: State, sound: Bool[Array, ""], full: Bool[Array, ""]) -> Status:
        """Returns RUNNING, or the limit that `state` has reached: the least step size or the number of steps.

        `full` says that no further step can be recorded.
        """
        underflow = jnp.where(sound, status.STEP_UNDERFLOW, status.NOT_FINITE)
        out = jnp.where(state.h < self.smallest, underflow, status.RUNNING)
        return jnp.where(full | (state.steps + state.rejected >= self.max_steps), status.TOO_MANY_STEPS, out)
