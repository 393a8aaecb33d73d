r"""Marching in time: adaptive or fixed steps, saved at given instants, with an explicit end.

`simulate` is one pure function (jit, vmap, jvp; with fixed steps also grad). Long runs call `advance`
on one stretch of saved times after the other, with everything between in a `State`.

Adaptive steps end at the saved instants instead of interpolating to them: the rate of change at a step's end
carries stiff components that no polynomial may be built on, and a step costs little more than what is saved.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from . import curve as geometry
from . import diagnostics, fourier, membrane, status
from .arrays import PerVesicle, Scalar, Status, as_float
from .curve import Curve
from .equation import Equation, Filter, Frozen, Motion, Unknowns, equation_for, verdict
from .interactions import AbstractCoupling
from .scene import Scene
from .steppers import ARK4, AbstractStepper

ROUGH = 3e-3  # top of the spectrum over its largest mode: beyond it nothing is resolved


class Window(eqx.Module):
    """Running integrals at the last steps that end at or before the two ends of the averaging window."""

    ends: Float[Array, "2"]
    reached: Float[Array, "2"]
    integrals: dict[str, Array]

    def passed(self, t: Scalar, integrals) -> "Window":
        """Also knows the step that ended at t."""
        before = t <= self.ends * (1 + 1e-14)
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
    angle: PerVesicle  # inclination at t, unwrapped
    window: Window | None
    steps: Int[Array, ""]
    rejected: Int[Array, ""]
    status: Int[Array, ""]


class Result(eqx.Module):
    """Saved instants (T,), states and diagnostics; rows after an early end hold NaN."""

    t: Float[Array, "T"]
    x: Float[Array, "T M N 2"]
    V_m: Float[Array, "T M N"] | None
    tension: Float[Array, "T M N"]
    diagnostics: dict[str, Array]
    averages: dict[str, Array] | None
    status: Int[Array, ""]
    state: State

    @property
    def word(self) -> str:
        """The status in a word (outside compiled code)."""
        return status.WORDS[int(self.status)]


class AbstractMarch(eqx.Module):
    """How steps are chosen. `projection=False` and `cut` exist to show what they are worth."""

    stepper: eqx.AbstractVar[AbstractStepper]
    projection: eqx.AbstractVar[bool]

    @abc.abstractmethod
    def first_step(self) -> Scalar:
        """The first step size to try."""

    @abc.abstractmethod
    def to(self, t_save: Scalar, state: State, equation: Equation, cache: "Cache", stops: Array):
        """Steps until `t_save`, or the end of the run."""

    def finish(self, equation: Equation, y: Unknowns, frozen: Frozen) -> Unknowns:
        """Filter and, unless switched off, project."""
        return equation.project(y, frozen.constraint) if self.projection else equation.filtered(y)


class Cache(eqx.Module):
    """The frozen part at the current state, if it is known."""

    frozen: Frozen
    known: Array


class Fixed(AbstractMarch):
    """Steps of at most `time_step`, an integer number of them between saved instants."""

    steps_per_save: int = eqx.field(static=True)
    stepper: AbstractStepper = ARK4()
    projection: bool = eqx.field(static=True, default=True)

    def first_step(self):
        return jnp.zeros(())

    def to(self, t_save, state, equation, cache, stops):
        h = (t_save - state.t) / self.steps_per_save

        def one(state, _):
            frozen = equation.freeze(state.t, state.y)
            y = self.finish(equation, self.stepper.step(equation, frozen, state.t, state.y, h).y, frozen)
            after = _accepted(state, equation, frozen, state.t + h, y)
            running = state.status == status.RUNNING
            return jax.tree.map(lambda new, old: jnp.where(running, new, old), after, state), None

        state, _ = lax.scan(one, state, length=self.steps_per_save)
        return eqx.tree_at(lambda s: s.t, state, jnp.where(state.status == status.RUNNING, t_save, state.t)), cache


class Adaptive(AbstractMarch):
    """Steps whose embedded error stays below `tolerance` in every node and component (PI controller)."""

    tolerance: Scalar = eqx.field(converter=as_float, default=1e-4)
    stepper: AbstractStepper = ARK4()
    projection: bool = eqx.field(static=True, default=True)
    largest: float = eqx.field(static=True, default=0.1)
    smallest: float = eqx.field(static=True, default=1e-11)
    max_steps: int = eqx.field(static=True, default=200_000)

    def first_step(self):
        return jnp.asarray(1e-4)

    def to(self, t_save, state, equation, cache, stops):
        def unfinished(carry):
            state, _ = carry
            return (state.status == status.RUNNING) & (state.t < t_save)

        def body(carry):
            state, cache = carry
            frozen = lax.cond(cache.known, lambda: cache.frozen, lambda: equation.freeze(state.t, state.y))
            state, known = self._attempt(state, equation, frozen, jnp.append(stops, t_save))
            return state, Cache(frozen, known)

        return lax.while_loop(unfinished, body, (state, cache))

    def _attempt(self, state: State, equation: Equation, frozen: Frozen, stops: Array):
        """One step, accepted or not; also whether `frozen` still holds."""
        t, y = state.t, state.y
        # Steps end at the next stop, and leave no sliver before it.
        stop = jnp.min(jnp.where(stops > t, stops, jnp.inf))
        room = stop - t
        h = jnp.where(state.h >= room, room, jnp.where(2 * state.h > room, 0.5 * room, state.h))
        t_new = jnp.where(state.h >= room, stop, t + h)
        step = self.stepper.step(equation, frozen, t, y, h)
        y_new = self.finish(equation, step.y, frozen)
        error = _max_norm((step.error.x, step.error.V_m)) / self.tolerance
        moved = _max_norm((y_new.x - y.x,))
        corrected = _max_norm((y_new.x - equation.filtered(step.y).x,))
        sound = jnp.isfinite(error) & jnp.isfinite(moved) & (moved < 1.0) & (corrected < 0.05)
        accepted = sound & (error <= 1.0)

        order = self.stepper.order
        e = jnp.maximum(error, 1e-8)
        grown = h * jnp.clip(0.9 * e ** (-0.7 / order) * state.last_error ** (0.4 / order), 0.2, 3.0)
        shrunk = jnp.where(sound, h * jnp.clip(0.9 * e ** (-1 / order), 0.2, 0.9), 0.25 * h)
        # A step cut short by a stop says little about the next one: return to the size before it.
        grown = jnp.where(h < state.h, jnp.maximum(grown, state.h), grown)
        after = _accepted(state, equation, frozen, t_new, y_new)
        after = eqx.tree_at(
            lambda s: (s.h, s.last_error), after, (jnp.minimum(grown, self.largest), jnp.maximum(e, 1e-4))
        )
        refused = eqx.tree_at(lambda s: (s.h, s.rejected), state, (shrunk, state.rejected + 1))
        new = jax.tree.map(lambda a, b: jnp.where(accepted, a, b), after, refused)
        code = jnp.where(new.status == status.RUNNING, self._limit(new, sound), new.status)
        solved = verdict(frozen.motion.residual)
        code = jnp.where(solved == status.CROWDED, solved, code)
        return eqx.tree_at(lambda s: s.status, new, code), ~accepted

    def _limit(self, state: State, sound):
        underflow = jnp.where(sound, status.STEP_UNDERFLOW, status.NOT_FINITE)
        out = jnp.where(state.h < self.smallest, underflow, status.RUNNING)
        return jnp.where(state.steps + state.rejected >= self.max_steps, status.TOO_MANY_STEPS, out)


def _max_norm(leaves) -> Scalar:
    """Largest entry; NaN when any is."""
    return jnp.max(jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(leaves)]))


def _turn(angle: PerVesicle, inclination: PerVesicle) -> PerVesicle:
    """The unwrapped angle nearest to `angle` that has this inclination (an axis has period π)."""
    return angle + jnp.mod(inclination - angle + 0.5 * jnp.pi, jnp.pi) - 0.5 * jnp.pi


def _inclinations(x) -> PerVesicle:
    return jax.vmap(lambda x: geometry.inclination(Curve.from_nodes(x)))(x)


def _accepted(state: State, equation: Equation, frozen: Frozen, t: Scalar, y: Unknowns) -> State:
    """The state after a step from `state` to (t, y)."""
    motion = frozen.motion
    code = verdict(motion.residual)
    code = jnp.where((code == status.RUNNING) & _is_rough(equation, motion, y), status.UNRESOLVED, code)
    # Crowded interactions make the step NaN: say why.
    finite = jnp.isfinite(_max_norm((y.x, y.V_m))) | (code == status.CROWDED)
    code = jnp.where(finite, code, status.NOT_FINITE)
    return State(
        t,
        y,
        state.h,
        state.last_error,
        _turn(state.angle, _inclinations(y.x)),
        None if state.window is None else state.window.passed(t, y.integrals),
        state.steps + 1,
        state.rejected,
        jnp.int32(code),
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


def initial_state(equation: Equation, march: AbstractMarch, average: Array | None = None) -> State:
    """The state at t = 0."""
    y = equation.start()
    zero = jnp.zeros(())
    window = None
    if average is not None:
        integrals = jax.tree.map(lambda leaf: jnp.zeros((2, *leaf.shape)), y.integrals)
        window = Window(as_float(average), jnp.zeros(2), integrals)
    count = jnp.int32(0)
    return State(
        zero, y, march.first_step(), jnp.ones(()), _inclinations(y.x), window, count, count, jnp.int32(status.RUNNING)
    )


def observe(equation: Equation, t: Scalar, y: Unknowns, angle: PerVesicle) -> dict[str, Array]:
    """What is saved of one instant, flat, by the names of the result file."""
    motion = equation.motion(t, y)
    tension = jax.vmap(membrane.physical_tension)(motion.surfaces.curves, motion.sigma, equation.scene.bending)
    out = {"t": t, "x": y.x, "tension": tension}
    if y.V_m is not None:
        out["V_m"] = y.V_m
    found = diagnostics.diagnose(equation, t, y, motion)
    found["inclination_unwrapped"] = _turn(angle, found["inclination"])
    return out | {f"diagnostics/{name}": value for name, value in found.items()}


class Checks(eqx.Module):
    """Limits beyond which a result is no result. `steady`: the speed below which a run may end.

    `film`: of the estimated relative error of the drainage of a film thinner than the node spacing.
    """

    tail: float = eqx.field(static=True, default=ROUGH)
    film: float = eqx.field(static=True, default=0.1)
    drift: float = eqx.field(static=True, default=1e-2)
    steady: Scalar | None = None

    def judge(self, equation: Equation, t: Scalar, y: Unknowns, row: dict[str, Array]) -> Status:
        """The status that one saved instant calls for."""
        code = jnp.int32(status.RUNNING)
        if self.steady is not None:
            motion = equation.motion(t, y)
            still = _speed_of_shape(motion, y) < self.steady
            code = jnp.where(still & (t > 0), status.STEADY, code)
        unresolved = jnp.max(row["diagnostics/spectral_tail"]) > self.tail
        code = jnp.where(unresolved, status.UNRESOLVED, code)
        area = jnp.max(jnp.abs(row["diagnostics/area"] / equation.area - 1))
        length = jnp.max(jnp.abs(row["diagnostics/length"] / (2 * np.pi * equation.speed) - 1))
        code = jnp.where(jnp.maximum(area, length) > self.drift, status.DRIFT, code)
        solved = verdict(row["diagnostics/residual"])
        code = jnp.where(solved == status.RUNNING, code, solved)
        crossed = jnp.any(jax.vmap(lambda x: diagnostics.crosses_itself(Curve.from_nodes(x)))(y.x))
        code = jnp.where(crossed, status.SELF_CONTACT, code)
        if y.x.shape[0] > 1:
            curves = jax.vmap(Curve.from_nodes)(y.x)
            thin = row["diagnostics/min_gap"] < jnp.max(jax.vmap(lambda curve: curve.weights)(curves))
            unresolved = thin & (row["diagnostics/film_error"] > self.film)
            code = jnp.where((code < status.UNRESOLVED) & unresolved, status.UNRESOLVED, code)
            collided = diagnostics.collides(curves)
            code = jnp.where(collided, status.COLLISION, code)
        finite = jnp.isfinite(_max_norm((row["x"], row["tension"])))
        return jnp.where(finite, code, status.NOT_FINITE)


def _speed_of_shape(motion, y: Unknowns) -> Scalar:
    """How fast shape and potential change at fixed places on the outline; tank-treading alone gives zero."""
    curves = motion.surfaces.curves
    weights = curves.weights[..., None] / jnp.sum(curves.weights, axis=1)[:, None, None]
    relative = motion.velocity - jnp.sum(weights * motion.velocity, axis=1, keepdims=True)
    speed = jnp.max(jnp.abs(jnp.sum(relative * curves.normal, axis=-1)))
    if y.V_m is None:
        return speed
    carried = jnp.sum(relative * curves.tangent, axis=-1) * motion.surfaces.d_ds(y.V_m)
    return jnp.maximum(speed, jnp.max(jnp.abs(motion.V_rate - carried)))


def advance(
    equation: Equation,
    march: AbstractMarch,
    state: State,
    times: Float[Array, "K"],
    stops: Float[Array, "S"],
    checks: Checks,
) -> tuple[State, dict[str, Array]]:
    """Marches over the saved instants `times`; returns the state and what was saved, (K, ...).

    Rows after the end of a run are NaN. `stops` are instants at which steps must end.
    """
    frozen = jax.tree.map(
        lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), eqx.filter_eval_shape(equation.freeze, state.t, state.y)
    )

    def to_save(carry, t_save):
        state, cache = carry
        ended = state.status != status.RUNNING
        state, cache = march.to(t_save, state, equation, cache, stops)
        row = observe(equation, state.t, state.y, state.angle)
        code = checks.judge(equation, state.t, state.y, row)
        code = jnp.where(state.status == status.RUNNING, code, state.status)
        broken = ended | (state.t < t_save)
        row = jax.tree.map(lambda leaf: jnp.where(broken, jnp.nan, leaf), row)
        return (eqx.tree_at(lambda s: s.status, state, jnp.int32(code)), cache), row

    (state, _), rows = lax.scan(to_save, (state, Cache(frozen, jnp.array(False))), times)
    return state, rows


def stops_of(scene: Scene, t_end, average=None) -> Float[Array, "S"]:
    """Instants at which steps must end: kinks of the field's history, ends of the averaging window."""
    stops = [jnp.reshape(as_float(t_end), (1,))]
    if scene.field is not None and scene.field.history is not None:
        stops.append(scene.field.history.breakpoints())
    if average is not None:
        stops.append(as_float(average))
    return jnp.concatenate(stops)


def simulate(
    scene: Scene,
    t_end,
    *,
    saves: int = 50,
    march: AbstractMarch | None = None,
    average=None,
    checks: Checks | None = None,
    filter: Filter | None = None,
    coupling: AbstractCoupling | None = None,
) -> Result:
    """Runs a scene to `t_end`, saving at `saves` equally spaced instants besides t = 0.

    `march` defaults to `Adaptive()`; `average` is a window (start, end) of time averages. Pure: use it
    under `jax.jit`, `jax.vmap`, `jax.jvp`, and with `Fixed` steps under `jax.grad`.
    """
    march = Adaptive() if march is None else march
    equation = equation_for(
        scene, filter=filter, coupling=coupling, integrands=None if average is None else diagnostics.averaged
    )
    checks = Checks() if checks is None else checks
    state = initial_state(equation, march, average)
    first = observe(equation, state.t, state.y, state.angle)
    times = as_float(t_end) * jnp.arange(1, saves + 1) / saves
    state, rows = advance(equation, march, state, times, stops_of(scene, t_end, average), checks)
    rows = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, rows)
    code = jnp.where(state.status == status.RUNNING, status.COMPLETE, state.status)
    found = {name.removeprefix("diagnostics/"): rows[name] for name in rows if name.startswith("diagnostics/")}
    means = None if average is None else diagnostics.averages(state.window.means(), scene)
    return Result(rows["t"], rows["x"], rows.get("V_m"), rows["tension"], found, means, jnp.int32(code), state)
