r"""Derivatives of a run whose accepted steps are recorded: the linearised steps, one after the other.

A loop with a data-dependent length has no reverse mode. Its derivative does not need the decisions of the step-size
control. A run that is differentiated therefore records its accepted steps (`Tape`), and tangents satisfy

    dy_{n+1} = d step(equation, t_n, y_n, t_{n+1}) [d equation, dt_n, dy_n, dt_{n+1}]

in a loop of fixed length, which JAX can transpose for reverse mode. Each step is recomputed, forward or backward, so
that only the states are stored. The end of a step at a stop (a saved time, a kink of the field, an end of the averaging
window) moves with the stop. All other steps keep their size.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Int, PyTree

from ..equation import tracking
from ..numerics.batching import greatest
from . import periods
from .state import State, Tape, Window


def filled(tree: PyTree, tangents: PyTree) -> PyTree:
    """Returns the tangents with zeros in place of None for all floating-point leaves."""

    def fill(leaf, d):
        return jnp.zeros_like(leaf) if d is None and eqx.is_inexact_array(leaf) else d

    return jax.tree.map(fill, tree, tangents)


def _only(tree: PyTree, where, values) -> PyTree:
    """Returns tangents of a tree that are `values` at these places and None elsewhere."""
    return eqx.tree_at(where, jax.tree.map(lambda _: None, tree), values, is_leaf=lambda leaf: leaf is None)


def along(march, equation, d_equation, tape: Tape, d_stops: Array, d_start: State) -> Tape:
    """Returns the tangents of all states of the tape; those after its end repeat the last."""

    # The branch is inside the recomputed function. Outside, the intermediate results of its branches would be stored.
    @eqx.filter_checkpoint
    def linear(made, primals, tangents):
        return lax.cond(made, lambda: eqx.filter_jvp(march.step, primals, tangents)[1], lambda: tangents[2])

    def body(tangent, slot):
        d_t, d_y = tangent
        i, t, y, t_new, stop = slot
        active = i < tape.count
        d_t_new = jnp.where(stop >= 0, d_stops[stop], d_t)
        # If only another batch element is still stepping, this one makes a valid step, so that no derivative is NaN.
        primals = (equation, t, y, jnp.where(active, t_new, t + march.first_step()))
        d_y_new = linear(i < length, primals, (d_equation, d_t, d_y, d_t_new))
        tangent = jax.tree.map(lambda new, old: jnp.where(active, new, old), (d_t_new, d_y_new), tangent)
        return tangent, tangent

    length = greatest(tape.count)  # the same for all batch elements, so that a step is made for all or for none
    before = jax.tree.map(lambda leaf: leaf[:-1], tape.y)
    slots = (jnp.arange(tape.stop.shape[0]), tape.t[:-1], before, tape.t[1:], tape.stop)
    start = (d_start.t, d_start.y)
    _, later = lax.scan(body, start, slots)
    d_t, d_y = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, later)
    return _only(tape, lambda tape: (tape.t, tape.y), (d_t, d_y))


def of_each(observe, equation, d_equation, tape: Tape, d_tape: Tape, places: Int[Array, "K"]):
    """Returns the tangents of observe(equation, t, y) at these states of the tape, (K, ...)."""

    @eqx.filter_checkpoint
    def linear(primals, tangents):
        return eqx.filter_jvp(observe, primals, tangents)[1]

    def at(points):
        (t, y), (d_t, d_y) = points
        return linear((equation, t, y), (d_equation, d_t, d_y))

    return lax.map(at, jax.tree.map(lambda leaf: leaf[places], ((tape.t, tape.y), (d_tape.t, d_tape.y))))


def of_periods(equation, d_equation, tape: Tape, d_tape: Tape, places: Int[Array, "K"]):
    """Returns the tangents of the diagnostics of the last whole period at these states of the tape, (K, ...)."""

    def of_one(place):
        def found(equation, times, y):
            return periods.of_steps(equation, times, y, place, times[place])

        primals, tangents = (equation, tape.t, tape.y), (d_equation, d_tape.t, d_tape.y)
        return eqx.filter_jvp(found, primals, tangents)[1]

    return lax.map(of_one, places)


def of_state(state: State, start: State, d_start: State, tape: Tape, d_tape: Tape) -> State:
    """Returns the tangents of the state at the end of the tape, which begins at `start`."""
    y, d_t, d_y = jax.tree.map(lambda leaf: leaf[tape.count], (tape.y, d_tape.t, d_tape.y))
    _, d_angle = jax.jvp(tracking.inclinations, (y,), (d_y,))
    d_window = d_start.window
    if d_window is not None:
        reached = jnp.arange(len(tape.stop))[:, None] < tape.count
        last = jnp.sum(start.window.includes(tape.t[1:]) & reached, axis=0)

        def at_ends(points, before):
            entered = (last > 0).reshape(2, *[1] * (points.ndim - 1))
            return jnp.where(entered, points[last], before)

        integrals = jax.tree.map(at_ends, d_tape.y.integrals, d_window.integrals)
        d_window = Window(d_window.ends, at_ends(d_tape.t, d_window.reached), integrals)
    return _only(state, lambda s: (s.t, s.y, s.angle, s.window), (d_t, d_y, d_angle, d_window))
