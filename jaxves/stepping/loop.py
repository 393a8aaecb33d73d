"""The loop over saved times: the initial state, the times at which steps must end, and the saved rows."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ..base import status
from ..equation import tracking
from ..equation.equation import Equation
from ..numerics.arrays import Scalar, as_float
from ..observables.checks import Checks
from ..observables.observing import observe
from ..observables.rows import Row
from ..physics.scene import Scene
from .estimates import ErrorSum
from .march import AbstractMarch
from .periods import PeriodMeans
from .state import Journey, State, Window


def initial_state(equation: Equation, march: AbstractMarch, average: Array | None = None) -> State:
    """Returns the state at t = 0. Its status is INVALID if a run cannot start from the scene."""
    y = equation.start()
    zero = jnp.zeros(())
    average = whole_periods(equation.scene, average)
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
        errors=ErrorSum.of(equation.scene, y) if march.stepper.has_error else None,
        angle=tracking.inclinations(y),
        window=window,
        period=PeriodMeans.of(equation.scene, y),
        steps=count,
        rejected=count,
        status=jnp.where(equation.scene.is_valid(), status.RUNNING, jnp.int32(status.INVALID)),
    )


def whole_periods(scene: Scene, average: Array | None) -> Array | None:
    """Returns the averaging window, shortened at its end to whole periods of field or flow, of the longer one."""
    periods = scene.periods()
    if average is None or not periods:
        return average
    period = functools.reduce(jnp.maximum, periods)
    start, end = as_float(average)
    count = jnp.floor((end - start) / period * (1 + 1e-12))
    return jnp.stack([start, jnp.where(count >= 1, start + count * period, end)])


def stops_of(scene: Scene, t_end, average=None) -> Float[Array, "S"]:
    """Returns the times at which steps must end: those of field and flow, ends of the averaging window, and `t_end`."""
    average = whole_periods(scene, average)
    stops = [jnp.reshape(as_float(t_end), (1,))]
    for part in (scene.field, scene.flow):
        if part is not None:
            stops += [times for times in (part.breakpoints(), part.steep_times(scene.x, t_end)) if times.size]
    if average is not None:
        stops.append(as_float(average))
    return jnp.concatenate(stops)


def march_through(
    journey: Journey,
    equation: Equation,
    march: AbstractMarch,
    times: Float[Array, "K"],
    stops: Float[Array, "S"],
    checks: Checks,
) -> tuple[Journey, Row, Int[Array, "K"] | None]:
    """Advances through the saved times.

    Returns the journey after the last of them, the rows (K, ...), which are NaN after the end of a run, and the number
    of steps recorded before each saved time (None without a tape).
    """
    stops = jnp.concatenate([stops, times])

    def to_next(journey, t_save):
        journey, row = to_save(journey, equation, march, t_save, stops, checks)
        return journey, (row, None if journey.tape is None else journey.tape.count)

    journey, (rows, counts) = lax.scan(to_next, journey, times)
    return journey, rows, counts


def to_save(
    journey: Journey,
    equation: Equation,
    march: AbstractMarch,
    t_save: Scalar,
    stops: Float[Array, "S"],
    checks: Checks,
) -> tuple[Journey, Row]:
    """Advances to one saved time; returns the journey and the row, which is NaN after the end of a run.

    The row of the time at which the journey begins is always computed. `stops` are all times at which steps must end,
    with `t_save`.
    """
    ended = (journey.state.status != status.RUNNING) & (journey.state.t < t_save)
    journey = march.to(t_save, journey, equation, stops)
    state = journey.state

    # Reverse mode recomputes the row instead of storing all intermediate results.
    @eqx.filter_checkpoint
    def row_of(state, cache):
        motion = march.motion(Journey(state, cache), equation)
        row = observe(equation, state.t, state.y, motion, state.angle, state.time_error)
        found = {} if state.period is None else state.period.diagnostics()
        return row._replace(diagnostics=row.diagnostics | found)

    row = row_of(state, journey.cache)
    code = checks.judge(equation, state.t, state.y, row)
    # The status that ended the run is kept. If it is UNRESOLVED, a more severe finding replaces it.
    found = jnp.where(state.status == status.UNRESOLVED, jnp.maximum(code, state.status), state.status)
    code = jnp.where(state.status == status.RUNNING, code, found)
    broken = ended | (state.t < t_save)
    row = jax.tree.map(lambda leaf: jnp.where(broken, jnp.nan, leaf), row)
    return eqx.tree_at(lambda j: j.state.status, journey, jnp.int32(code)), row
