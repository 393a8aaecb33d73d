"""`advance`: steps through the saved times. Its derivative is that of the accepted steps.

A run that is not differentiated records nothing. A run that is differentiated records its accepted steps, and `replay`
differentiates them.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..equation.equation import Equation
from ..observables.checks import Checks
from ..observables.observing import observe
from ..observables.rows import Row
from . import replay
from .loop import march_through
from .march import AbstractMarch
from .state import State, Tape


def advance(
    equation: Equation,
    march: AbstractMarch,
    state: State,
    times: Float[Array, "K"],
    stops: Float[Array, "S"],
    checks: Checks,
) -> tuple[State, Row]:
    """Advances through the saved times; returns the state and the rows (K, ...).

    Rows after the end of a run are NaN. `stops` are further times at which steps must end.
    """
    run = _marched if march.recorded is None else _differentiable
    return run(equation, march, state, times, stops, checks)


def _marched(equation, march, state, times, stops, checks):
    journey, rows, _ = march_through(march.begin(state, equation), equation, march, times, stops, checks)
    return journey.state, rows


@eqx.filter_custom_jvp
def _differentiable(equation, march, state, times, stops, checks):
    return _marched(equation, march, state, times, stops, checks)


@_differentiable.def_jvp
def _differentiable_jvp(primals, tangents):
    (*out, _, _), (*d_out, _, _) = eqx.filter_jvp(recorded, primals, tangents)
    return tuple(out), tuple(d_out)


@eqx.filter_custom_jvp
def recorded(equation, march, state, times, stops, checks):
    """Does the same as `advance`, and also returns the tape and the number of its steps before each row, (K,)."""
    journey = march.begin(state, equation)
    journey = eqx.tree_at(
        lambda j: j.tape, journey, Tape.blank(state.t, state.y, march.recorded), is_leaf=lambda leaf: leaf is None
    )
    journey, rows, counts = march_through(journey, equation, march, times, stops, checks)
    return journey.state, rows, journey.tape, counts


@recorded.def_jvp
def _recorded_jvp(primals, tangents):
    equation, march, start, times, stops, _ = primals
    d_equation, _, d_start, d_times, d_stops, _ = tangents
    state, rows, tape, counts = recorded(*primals)
    d_stops = jnp.concatenate([replay.filled(stops, d_stops), replay.filled(times, d_times)])
    d_start = replay.filled(start, d_start)
    d_tape = replay.along(march, equation, d_equation, tape, d_stops, d_start)

    def row(equation, t, y):
        # Neither the number of turns nor the estimated error has a derivative.
        motion = equation.motion(t, y)
        return observe(equation, t, y, motion, jnp.zeros_like(start.angle), start.time_error)

    d_rows = replay.of_each(row, equation, d_equation, tape, d_tape, counts)
    if start.period is not None:
        d_found = replay.of_periods(equation, d_equation, tape, d_tape, counts)
        d_rows = d_rows._replace(diagnostics=d_rows.diagnostics | d_found)
    d_rows = jax.tree.map(lambda row, d: jnp.where(jnp.isnan(row), 0.0, d), rows, replay.filled(rows, d_rows))
    d_state = replay.of_state(state, start, d_start, tape, d_tape)
    return (state, rows, tape, counts), (d_state, d_rows, d_tape, None)
