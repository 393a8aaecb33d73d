"""The state between two steps, and what accompanies it: integrals for averages, recorded steps, the linear part."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..equation.implicit import Frozen
from ..equation.state import Unknowns
from ..numerics.arrays import PerVesicle, Scalar
from .estimates import ErrorSum
from .periods import PeriodMeans


class Window(eqx.Module):
    """The running integrals after the last steps that end at or before the two ends of the averaging window."""

    ends: Float[Array, "2"]
    reached: Float[Array, "2"]
    integrals: dict[str, Array]

    def includes(self, t: Array) -> Array:
        """Returns which of the times t (...) are not later than each end, (..., 2)."""
        return t[..., None] <= self.ends * (1 + 1e-14)

    def passed(self, t: Scalar, integrals) -> "Window":
        """Returns the window after a step that ended at t with these integrals."""
        before = self.includes(t)
        reached = jnp.where(before, t, self.reached)
        stored = jax.tree.map(
            lambda old, new: jnp.where(before.reshape(2, *[1] * new.ndim), new, old), self.integrals, integrals
        )
        return Window(self.ends, reached, stored)

    def means(self) -> dict[str, Array]:
        """Returns the means over the window; NaN if it has not been reached."""
        return jax.tree.map(lambda pair: (pair[1] - pair[0]) / (self.reached[1] - self.reached[0]), self.integrals)


class State(eqx.Module):
    """Everything that is needed to continue a run, without what can be recomputed."""

    t: Scalar
    y: Unknowns
    h: Scalar  # length of the next step
    last_error: Scalar  # error of the last accepted step, in units of the tolerance
    time_error: Scalar | None  # of all accepted steps, from their embedded errors; None for schemes without any
    errors: ErrorSum | None  # from which `time_error` follows if field or flow have a period; otherwise it is a sum
    angle: PerVesicle  # unwrapped inclination at t
    window: Window | None
    period: PeriodMeans | None  # only in a field with a period
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    status: Int[Array, ""]


class Tape(eqx.Module):
    """The record of accepted steps: the states between them, and the stop at which each step ended (-1: none)."""

    t: Float[Array, "points"]
    y: Unknowns  # with `points` as first axis
    stop: Int[Array, "steps"]
    count: Int[Array, ""]

    @classmethod
    def blank(cls, t: Scalar, y: Unknowns, length: int) -> "Tape":
        """Returns an empty record for `length` steps from (t, y).

        Unused states are the start, so that steps from them are valid.
        """
        t, y = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (length + 1, *leaf.shape)), (t, y))
        return cls(t, y, jnp.full(length, -1, dtype=int), jnp.int32(0))

    def is_full(self) -> Bool[Array, ""]:
        """Returns whether there is no room for another step."""
        return self.count == self.stop.shape[0]

    def with_step(self, accepted: Array, t: Scalar, y: Unknowns, stop: Int[Array, ""]) -> "Tape":
        """Returns the record with one more step, if it was accepted."""
        after = self.count + accepted
        # Rejected steps are written out of bounds, where JAX drops them.
        place = jnp.where(accepted, self.count, self.stop.shape[0] + 1)

        def put(all_, new):
            return all_.at[place + 1].set(new, mode="drop")

        points = jax.tree.map(put, (self.t, self.y), (t, y))
        return Tape(*points, self.stop.at[place].set(stop, mode="drop"), after)


class Cache(eqx.Module):
    """The linear part at the current state, if it is known."""

    frozen: Frozen
    known: Bool[Array, ""]


class Journey(eqx.Module):
    """A state during a run, with the linear part and, if steps are recorded, the tape."""

    state: State
    cache: Cache | None = None
    tape: Tape | None = None
