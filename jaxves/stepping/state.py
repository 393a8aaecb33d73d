"""The state between two steps, and what is kept beside it during a run: averages, recorded steps, a frozen part."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..equation.implicit import Frozen
from ..equation.state import Unknowns
from ..numerics.arrays import PerVesicle, Scalar


class Window(eqx.Module):
    """Running integrals at the last steps that end at or before the two ends of the averaging window."""

    ends: Float[Array, "2"]
    reached: Float[Array, "2"]
    integrals: dict[str, Array]

    def includes(self, t: Array) -> Array:
        """Which of the instants t, shape (...), come no later than each end, (..., 2)."""
        return t[..., None] <= self.ends * (1 + 1e-14)

    def passed(self, t: Scalar, integrals) -> "Window":
        """The window after a step that ended at t with these integrals."""
        before = self.includes(t)
        reached = jnp.where(before, t, self.reached)
        stored = jax.tree.map(
            lambda old, new: jnp.where(before.reshape(2, *[1] * new.ndim), new, old), self.integrals, integrals
        )
        return Window(self.ends, reached, stored)

    def means(self) -> dict[str, Array]:
        """Means over the window; NaN when it has not been entered."""
        return jax.tree.map(lambda pair: (pair[1] - pair[0]) / (self.reached[1] - self.reached[0]), self.integrals)


class State(eqx.Module):
    """Everything that a continuation needs, and nothing that can be recomputed."""

    t: Scalar
    y: Unknowns
    h: Scalar  # length of the next step
    last_error: Scalar  # of the last accepted step, in units of the tolerance
    time_error: Scalar | None  # sum of the embedded errors of all accepted steps, where the method has any
    angle: PerVesicle  # what the equation follows without jumps: the unwrapped inclination at t
    window: Window | None
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    status: Int[Array, ""]


class Tape(eqx.Module):
    """The accepted steps: the points that they join, and the stop at which each of them ended (-1: none)."""

    t: Float[Array, "points"]
    y: Unknowns  # with `points` as first axis
    stop: Int[Array, "steps"]
    count: Int[Array, ""]

    @classmethod
    def blank(cls, t: Scalar, y: Unknowns, length: int) -> "Tape":
        """Room for `length` steps from (t, y); points not reached hold the start, from which a step can be made."""
        t, y = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (length + 1, *leaf.shape)), (t, y))
        return cls(t, y, jnp.full(length, -1, dtype=int), jnp.int32(0))

    def is_full(self) -> Bool[Array, ""]:
        """Whether another step would find no room."""
        return self.count == self.stop.shape[0]

    def with_step(self, accepted: Array, t: Scalar, y: Unknowns, stop: Int[Array, ""]) -> "Tape":
        """The tape with one step more, if that was accepted."""
        after = self.count + accepted
        # Refused steps are written out of bounds, which drops them.
        place = jnp.where(accepted, self.count, self.stop.shape[0] + 1)

        def put(all_, new):
            return all_.at[place + 1].set(new, mode="drop")

        points = jax.tree.map(put, (self.t, self.y), (t, y))
        return Tape(*points, self.stop.at[place].set(stop, mode="drop"), after)


class Cache(eqx.Module):
    """The frozen part at the current state, if it is known."""

    frozen: Frozen
    known: Bool[Array, ""]


class Journey(eqx.Module):
    """A state during a run, with what is kept beside it: the frozen part, and the tape of a run that is recorded."""

    state: State
    cache: Cache | None = None
    tape: Tape | None = None
