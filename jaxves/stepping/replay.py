r"""Derivatives of a run whose steps are known: the linearised steps, one after the other.

A loop that runs until it is done has no reverse mode, and its derivative needs none of its decisions. A run that is
differentiated therefore records its accepted steps (`Tape`), and tangents follow

    dy_{n+1} = d step(equation, t_n, y_n, t_{n+1}) [d equation, dt_n, dy_n, dt_{n+1}]

in a loop of fixed length, which can be transposed. Each step is recomputed in it, forwards or backwards, so that memory
holds the states alone. Steps that end at a stop (a saved instant, a kink of the field's history, an end of
the averaging window) move with it; all others keep their length.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Int, PyTree

from ..equation import tracking
from ..numerics.batching import greatest
from .state import State, Tape, Window


def filled(tree: PyTree, tangents: PyTree) -> PyTree:
    """The tangents with zeros in place of None, where there could be some."""

    def fill(leaf, d):
        return jnp.zeros_like(leaf) if d is None and eqx.is_inexact_array(leaf) else d

    return jax.tree.map(fill, tree, tangents)


def _only(tree: PyTree, where, values) -> PyTree:
    """Tangents of a tree: `values` at these places, None elsewhere."""
    return eqx.tree_at(where, jax.tree.map(lambda _: None, tree), values, is_leaf=lambda leaf: leaf is None)


def along(march, equation, d_equation, tape: Tape, d_stops: Array, d_start: State) -> Tape:
    """Tangents of all points of the tape; those beyond its end repeat the last."""

    # The choice is inside what is recomputed: outside, everything that its branches hold would be stored.
    @eqx.filter_checkpoint
    def linear(made, primals, tangents):
        return lax.cond(made, lambda: eqx.filter_jvp(march.step, primals, tangents)[1], lambda: tangents[2])

    def body(tangent, slot):
        d_t, d_y = tangent
        i, t, y, t_new, stop = slot
        active = i < tape.count
        d_t_new = jnp.where(stop >= 0, d_stops[stop], d_t)
        # While another batch element still steps, this one makes a step that exists, so that no derivative is NaN.
        primals = (equation, t, y, jnp.where(active, t_new, t + march.first_step()))
        d_y_new = linear(i < length, primals, (d_equation, d_t, d_y, d_t_new))
        tangent = jax.tree.map(lambda new, old: jnp.where(active, new, old), (d_t_new, d_y_new), tangent)
        return tangent, tangent

    length = greatest(tape.count)  # of all batch elements: a step is made for all or for none
    before = jax.tree.map(lambda leaf: leaf[:-1], tape.y)
    slots = (jnp.arange(tape.stop.shape[0]), tape.t[:-1], before, tape.t[1:], tape.stop)
    start = (d_start.t, d_start.y)
    _, later = lax.scan(body, start, slots)
    d_t, d_y = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), start, later)
    return _only(tape, lambda tape: (tape.t, tape.y), (d_t, d_y))


def of_each(observe, equation, d_equation, tape: Tape, d_tape: Tape, places: Int[Array, "K"]):
    """Tangents of observe(equation, t, y) at these points of the tape, (K, ...)."""

    @eqx.filter_checkpoint
    def linear(primals, tangents):
        return eqx.filter_jvp(observe, primals, tangents)[1]

    def at(points):
        (t, y), (d_t, d_y) = points
        return linear((equation, t, y), (d_equation, d_t, d_y))

    return lax.map(at, jax.tree.map(lambda leaf: leaf[places], ((tape.t, tape.y), (d_tape.t, d_tape.y))))


def of_state(state: State, start: State, d_start: State, tape: Tape, d_tape: Tape) -> State:
    """Tangents of the state at the end of the tape, which began at `start`."""
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
