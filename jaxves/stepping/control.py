r"""How steps follow one another: fixed, or chosen from their embedded error; the state between them.

Adaptive steps end at the saved instants instead of interpolating to them: the rate of change at a step's end
carries stiff components that no polynomial may be built on, and a step costs little more than what is saved.

At steps on the edge of what explicit stages bear, round-off in the highest modes grows until the error estimate sees
it: to the size of the tolerance, a thousand times what a smooth solution has there, and in curvature and tension far
more than that. Errors of the highest modes that are no small part of what these modes hold therefore count many
times. That costs next to no steps: the edge stays where it is, and is felt earlier.

Derivatives take the sequence of steps as given: which steps were tried, and how long those were that no stop cut
short, depends on the scene by way of error estimates only, and has no part in the derivative of the solution.
"""

import abc
import dataclasses
import math
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ..base import status
from ..base.arguments import Bounded, refusal, require_count
from ..base.bounds import TOLERANCE
from ..equation.equation import Equation
from ..equation.implicit import Frozen
from ..equation.state import Motion, Unknowns, verdict
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import PerVesicle, Scalar, as_float
from ..physics import membrane
from .schemes import ARK4, AbstractStepper

_HIGHEST = 0.25  # of the modes that the filter of x leaves
WEIGHT = 30.0  # of errors in those, as far as they exceed
_PART = 0.03  # of what is in them
ROUGH = 3e-3  # top of the spectrum over its largest mode: beyond it nothing is resolved


class Window(eqx.Module):
    """Running integrals at the last steps that end at or before the two ends of the averaging window."""

    ends: Float[Array, "2"]
    reached: Float[Array, "2"]
    integrals: dict[str, Array]

    def includes(self, t: Array) -> Array:
        """Which of the instants t, shape (...), come no later than each end, (..., 2)."""
        return t[..., None] <= self.ends * (1 + 1e-14)

    def passed(self, t: Scalar, integrals) -> "Window":
        """Also knows the step that ended at t."""
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
    """All that a continuation needs, and nothing that can be recomputed."""

    t: Scalar
    y: Unknowns
    h: Scalar
    last_error: Scalar  # of the last accepted step, in units of the tolerance
    time_error: Scalar | None  # sum of the embedded errors of all accepted steps, where the method has any
    angle: PerVesicle  # inclination at t, unwrapped
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

    def is_full(self) -> Array:
        """Whether another step would find no room."""
        return self.count == self.stop.shape[0]

    def with_step(self, accepted: Array, t: Scalar, y: Unknowns, stop: Int[Array, ""]) -> "Tape":
        """One step more, if it was accepted."""
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
    known: Array


class Journey(eqx.Module):
    """A state on its way, with what is kept beside it."""

    state: State
    cache: Cache | None = None
    tape: Tape | None = None


class AbstractMarch(eqx.Module):
    """How steps are chosen. `projection=False` exists to show what projecting is worth.

    `recorded`: how many steps are written down for a derivative, None when the derivative is that of the loop.
    """

    stepper: eqx.AbstractVar[AbstractStepper]
    projection: eqx.AbstractVar[bool]
    recorded: eqx.AbstractVar[int | None]

    @abc.abstractmethod
    def first_step(self) -> Scalar:
        """The first step size to try."""

    @abc.abstractmethod
    def begin(self, state: State, equation: Equation) -> Journey:
        """Sets out from a state."""

    @abc.abstractmethod
    def to(self, t_save: Scalar, journey: Journey, equation: Equation, stops: Array) -> Journey:
        """Steps until `t_save`, or the end of the run. `stops` are all instants, `t_save` included, to end steps at."""

    @abc.abstractmethod
    def with_tolerance(self, factor: float) -> "AbstractMarch":
        """The same with `factor` times the error allowed in a step, as near as this comes to it."""

    def forwards(self) -> "AbstractMarch":
        """The same for derivatives in forward mode alone, where those cost less."""
        return self

    def finish(self, equation: Equation, y: Unknowns, frozen: Frozen) -> Unknowns:
        """Filter and, unless switched off, project."""
        return equation.project(y, frozen.constraint) if self.projection else equation.filtered(y)

    def step(self, equation: Equation, t: Scalar, y: Unknowns, t_new: Scalar) -> Unknowns:
        """What a step from (t, y) to t_new arrives at."""
        frozen = equation.freeze(t, y)
        return self.finish(equation, self.stepper.step(equation, frozen, t, y, t_new - t).y, frozen)


class AbstractEven(AbstractMarch):
    """Equal steps between saved instants: nothing is chosen on the way."""

    @property
    def recorded(self):
        return None

    def first_step(self):
        return jnp.zeros(())

    def begin(self, state, equation):
        return Journey(state)


class Fixed(AbstractEven):
    """`steps_per_save` equal steps between saved instants; raises ValueError unless that is a whole number >= 1."""

    steps_per_save: int = eqx.field(static=True)
    stepper: AbstractStepper = ARK4()
    projection: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        require_count("Fixed.steps_per_save", self.steps_per_save)
        _check_stepper(self)

    def with_tolerance(self, factor):
        steps = self.steps_per_save * factor ** (-1 / (self.stepper.order + 1))
        return dataclasses.replace(self, steps_per_save=math.ceil(steps))

    def to(self, t_save, journey, equation, stops):
        h = (t_save - journey.state.t) / self.steps_per_save

        # Reverse mode keeps the states alone and makes each step again.
        @eqx.filter_checkpoint
        def one(state):
            frozen = equation.freeze(state.t, state.y)
            step = self.stepper.step(equation, frozen, state.t, state.y, h)
            error = None if step.error is None else _size(step.error)
            after = _accepted(state, equation, frozen, state.t + h, self.finish(equation, step.y, frozen), error)
            return _where(state.status == status.RUNNING, after, state)

        state, _ = lax.scan(lambda state, _: (one(state), None), journey.state, length=self.steps_per_save)
        arrived = jnp.where(state.status == status.RUNNING, t_save, state.t)
        return Journey(eqx.tree_at(lambda s: s.t, state, arrived))


def _check_stepper(march: AbstractMarch) -> None:
    if not isinstance(march.stepper, AbstractStepper):
        raise refusal(f"{type(march).__name__}.stepper", march.stepper, "a scheme, such as ARK4()")


class Adaptive(AbstractMarch, Bounded):
    """Steps whose embedded error stays below `tolerance` in every node and component (PI controller).

    For a tight tolerance `stepper=ARK5()` is the better choice, which scene files make by themselves
    (`steppers.for_tolerance`).

    Errors in the highest quarter of the modes, beyond 3 % of what is there, count thirty times: at the edge of
    stability of the explicit stages round-off grows there.

    A derivative, in either mode, records the accepted steps, up to `recorded` of them (more end that run as "too many
    steps"), and follows them once more. `None` records nothing and differentiates the loop of steps itself:
    a third cheaper for the derivative along one direction, and without reverse mode.

    Raises:
        ValueError: the tolerance is known to be out of its bounds, or the scheme has no error estimate.
    """

    bounds: ClassVar = {"tolerance": TOLERANCE}

    tolerance: Scalar = eqx.field(converter=as_float, default=1e-4)
    stepper: AbstractStepper = ARK4()
    projection: bool = eqx.field(static=True, default=True)
    largest: float = eqx.field(static=True, default=0.1)
    smallest: float = eqx.field(static=True, default=1e-11)
    max_steps: int = eqx.field(static=True, default=200_000)
    recorded: int | None = eqx.field(static=True, default=1024)

    def __check_init__(self):
        _check_stepper(self)
        if not self.stepper.has_error:
            raise refusal("Adaptive.stepper", self.stepper, "a scheme with an error estimate: ARK4() or ARK5()")
        require_count("Adaptive.max_steps", self.max_steps)
        if self.recorded is not None:
            require_count("Adaptive.recorded", self.recorded)

    def with_tolerance(self, factor):
        return eqx.tree_at(lambda march: march.tolerance, self, factor * self.tolerance)

    def forwards(self):
        return dataclasses.replace(self, recorded=None)

    def first_step(self):
        return jnp.asarray(1e-4)

    def begin(self, state, equation):
        shapes = eqx.filter_eval_shape(equation.freeze, state.t, state.y)
        frozen = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        return Journey(state, Cache(frozen, jnp.array(False)))

    def to(self, t_save, journey, equation, stops):
        def unfinished(journey):
            return (journey.state.status == status.RUNNING) & (journey.state.t < t_save)

        return lax.while_loop(unfinished, lambda journey: self._attempt(journey, equation, stops), journey)

    def _attempt(self, journey: Journey, equation: Equation, stops: Array) -> Journey:
        """One step, accepted or not."""
        state, cache, tape = journey.state, journey.cache, journey.tape
        t, y = state.t, state.y
        frozen = lax.cond(cache.known, lambda: cache.frozen, lambda: equation.freeze(t, y))
        # Steps end at the next stop, and leave no sliver before it.
        stop = jnp.argmin(jnp.where(stops > t, stops, jnp.inf))
        room = stops[stop] - t
        at_stop = state.h >= room
        free = lax.stop_gradient(jnp.where(2 * state.h > room, 0.5 * room, state.h))
        t_new = jnp.where(at_stop, stops[stop], t + free)
        h = t_new - t
        step = self.stepper.step(equation, frozen, t, y, h)
        y_new = self.finish(equation, step.y, frozen)
        size = _size(step.error)
        error = self.felt(equation, step.error, y_new) / self.tolerance
        moved = _max_norm((y_new.x - y.x,))
        corrected = _max_norm((y_new.x - equation.filtered(step.y).x,))
        sound = jnp.isfinite(error) & jnp.isfinite(moved) & (moved < 1.0) & (corrected < 0.05)
        full = jnp.array(False) if tape is None else tape.is_full()
        accepted = sound & (error <= 1.0) & ~full

        order = self.stepper.order
        e = jnp.maximum(error, 1e-8)
        grown = h * jnp.clip(0.9 * e ** (-0.7 / order) * state.last_error ** (0.4 / order), 0.2, 3.0)
        shrunk = jnp.where(sound, h * jnp.clip(0.9 * e ** (-1 / order), 0.2, 0.9), 0.25 * h)
        # A step cut short by a stop says little about the next one: return to the size before it.
        grown = jnp.where(h < state.h, jnp.maximum(grown, state.h), grown)
        after = _accepted(state, equation, frozen, t_new, y_new, size)
        after = eqx.tree_at(
            lambda s: (s.h, s.last_error), after, (jnp.minimum(grown, self.largest), jnp.maximum(e, 1e-4))
        )
        refused = eqx.tree_at(lambda s: (s.h, s.rejected), state, (shrunk, state.rejected + 1))
        new = _where(accepted, after, refused)
        code = jnp.where(new.status == status.RUNNING, self._limit(new, sound, full), new.status)
        solved = verdict(frozen.motion.residual)
        code = jnp.where(solved == status.CROWDED, solved, code)
        new = eqx.tree_at(lambda s: (s.h, s.status), new, (lax.stop_gradient(new.h), code))
        if tape is not None:
            tape = tape.with_step(accepted, t_new, y_new, jnp.where(at_stop, stop, -1))
        return Journey(new, Cache(frozen, ~accepted), tape)

    def felt(self, equation: Equation, error: Unknowns, y: Unknowns) -> Scalar:
        """What of the error of a step to y is held against the tolerance."""
        return jnp.maximum(_size(error), WEIGHT * _excess(equation, error, y))

    def _limit(self, state: State, sound, full):
        underflow = jnp.where(sound, status.STEP_UNDERFLOW, status.NOT_FINITE)
        out = jnp.where(state.h < self.smallest, underflow, status.RUNNING)
        return jnp.where(full | (state.steps + state.rejected >= self.max_steps), status.TOO_MANY_STEPS, out)


def initial_state(equation: Equation, march: AbstractMarch, average: Array | None = None) -> State:
    """The state at t = 0; its status is INVALID where the scene is none that can be started."""
    y = equation.start()
    zero = jnp.zeros(())
    window = None
    if average is not None:
        integrals = jax.tree.map(lambda leaf: jnp.zeros((2, *leaf.shape)), y.integrals)
        window = Window(as_float(average), jnp.zeros(2), integrals)
    count = jnp.int32(0)
    return State(
        t=zero,
        y=y,
        h=march.first_step(),
        last_error=jnp.ones(()),
        time_error=zero if march.stepper.has_error else None,
        angle=inclinations(y),
        window=window,
        steps=count,
        rejected=count,
        status=jnp.where(equation.scene.is_valid(), status.RUNNING, jnp.int32(status.INVALID)),
    )


def turned(angle: PerVesicle, inclination: PerVesicle) -> PerVesicle:
    """The unwrapped angle nearest to `angle` that has this inclination (an axis has period π)."""
    return angle + jnp.mod(inclination - angle + 0.5 * jnp.pi, jnp.pi) - 0.5 * jnp.pi


def inclinations(y: Unknowns) -> PerVesicle:
    """The angle of each vesicle's major axis from x."""
    return jax.vmap(lambda x: geometry.inclination(Curve.from_nodes(x)))(y.x)


def _where(condition, new, old):
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)


def _max_norm(leaves) -> Scalar:
    """Largest entry; NaN when any is."""
    return jnp.max(jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(leaves)]))


def _size(error: Unknowns) -> Scalar:
    """The largest error of any node in position or potential; no derivative is taken of it."""
    return lax.stop_gradient(_max_norm((error.x, error.V_m)))


def _excess(equation: Equation, error: Unknowns, y: Unknowns) -> Scalar:
    """By how much the error in the highest modes exceeds a small part of what y has in them; maybe negative."""
    N = y.x.shape[1]
    cut = N // 2 - round((1 - _HIGHEST) * (N // 2 - equation.filter.x))

    def highest(f):
        return jnp.max(jnp.abs(f - fourier.low_pass(f, cut, axis=1)))

    parts = lax.stop_gradient(((error.x, error.V_m), (y.x, y.V_m)))
    pairs = zip(*map(jax.tree.leaves, parts), strict=True)
    return jnp.max(jnp.stack([highest(e) - _PART * highest(f) for e, f in pairs]))


def _accepted(state: State, equation: Equation, frozen: Frozen, t: Scalar, y: Unknowns, error: Scalar | None) -> State:
    """The state after a step from `state` to (t, y)."""
    code = verdict(frozen.motion.residual)
    code = jnp.where((code == status.RUNNING) & _is_rough(equation, frozen.motion, y), status.UNRESOLVED, code)
    # Crowded interactions make the step NaN: say why.
    finite = jnp.isfinite(_max_norm((y.x, y.V_m))) | (code == status.CROWDED)
    code = jnp.where(finite, code, status.NOT_FINITE)
    return State(
        t=t,
        y=y,
        h=state.h,
        last_error=state.last_error,
        time_error=None if error is None else state.time_error + error,
        angle=turned(state.angle, inclinations(y)),
        window=None if state.window is None else state.window.passed(t, y.integrals),
        steps=state.steps + 1,
        rejected=state.rejected,
        status=jnp.int32(code),
    )


def _is_rough(equation: Equation, motion: Motion, y: Unknowns) -> Array:
    """Whether the shape has a rough spectrum, or wrinkles finer than the nodes resolve would grow in it.

    Wrinkles may come and go between saved instants, and leave a smooth shape that is not the right one.
    """
    cut, N = equation.filter.x, y.x.shape[1]

    def of_one(x, curve, sigma, bending):
        finest = membrane.fastest_wrinkle(curve, sigma, bending)
        return (fourier.spectral_tail(x, cut) > ROUGH) | (finest > N // 2 - cut)

    rough = jax.vmap(of_one)(y.x, motion.surfaces.curves, motion.sigma, equation.scene.bending)
    return lax.stop_gradient(jnp.any(rough))
