r"""Steps chosen from their embedded error.

Steps end at the saved times; results are not interpolated. An interpolating polynomial would need the rate of change at
the end of a step, which contains stiff components. A step costs little more than computing the saved quantities.

Derivatives keep the sequence of steps fixed. The sizes of the steps depend on the scene only through error estimates,
and they do not contribute to the derivative of the solution.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from ..base import status
from ..base.arguments import Bounded, refusal, require_count
from ..base.bounds import TOLERANCE
from ..base.time_steps import MOST_STEPS, STEPS_PER_PERIOD
from ..equation import norms
from ..equation.equation import Equation
from ..equation.implicit import Frozen
from ..equation.state import Unknowns
from ..numerics.arrays import Scalar, as_float
from ..numerics.batching import greatest
from .controller import Attempt, PIController
from .march import AbstractMarch, check_stepper, chosen
from .schemes import ARK4, AbstractStepper
from .state import Cache, Journey, State, Tape


class Adaptive(AbstractMarch, Bounded):
    """Steps whose embedded error is below `tolerance` in every node and component (PI controller).

    For a tight tolerance `stepper=ARK5()` is better. Scene files choose it automatically (`schemes.for_tolerance`).

    If stability limits the steps, round-off grows in the highest modes. Errors in the highest quarter of the modes that
    exceed 3 % of their content are therefore multiplied by `edge_weight`. This adds almost no steps, because the limit
    of stability is the same and is only noticed earlier.

    With `per_growth`, steps are at most this fraction of the time in which the fastest growing wrinkle of a compressed
    membrane grows by a factor of e. Implicit stages would damp wrinkles that grow faster, and the error estimate does
    not see wrinkles below the tolerance. `first` is the first step to try, 1e-4 by default. A run ends as "step
    underflow" if its steps fall below `smallest`, or below 1e-6 `first` if that is less. Scene files set `per_growth`
    and `first` if field or flow are strong.

    For a derivative, forward or reverse, up to `recorded` accepted steps are recorded and replayed. A run with more
    steps ends as "too many steps". With `recorded=None` nothing is recorded, and the loop itself is differentiated.
    This is a third cheaper for one direction, and does not allow reverse mode.

    Raises:
        ValueError: a known tolerance is out of its bounds, or the scheme has no error estimate.
    """

    bounds: ClassVar = {"tolerance": TOLERANCE}

    tolerance: Scalar = eqx.field(converter=as_float, default=1e-4)
    stepper: AbstractStepper = ARK4()
    projection: bool = eqx.field(static=True, default=True)
    largest: float = eqx.field(static=True, default=0.1)
    smallest: float = eqx.field(static=True, default=1e-11)
    max_steps: int = eqx.field(static=True, default=MOST_STEPS)
    recorded: int | None = eqx.field(static=True, default=1024)
    edge_weight: float = eqx.field(static=True, default=30.0)
    rough: float = eqx.field(static=True, default=norms.ROUGH)
    nodes_per_wave: float | None = eqx.field(static=True, default=None)
    per_growth: float | None = eqx.field(static=True, default=None)
    first: Scalar | None = eqx.field(converter=lambda h: None if h is None else as_float(h), default=None)

    def __check_init__(self):
        check_stepper(self)
        if not self.stepper.has_error:
            raise refusal("Adaptive.stepper", self.stepper, "a scheme with an error estimate: ARK4() or ARK5()")
        require_count("Adaptive.max_steps", self.max_steps)
        if self.recorded is not None:
            require_count("Adaptive.recorded", self.recorded)

    @property
    def controller(self) -> PIController:
        """The controller of the step size. The least step is far below the first, however fast the scene is."""
        smallest = self.smallest if self.first is None else jnp.minimum(self.smallest, 1e-6 * self.first)
        return PIController(self.stepper.order, self.largest, smallest, self.max_steps)

    def with_tolerance(self, factor):
        return eqx.tree_at(lambda march: march.tolerance, self, factor * self.tolerance)

    def forwards(self):
        return dataclasses.replace(self, recorded=None)

    def first_step(self):
        return jnp.asarray(1e-4) if self.first is None else self.first

    def begin(self, state, equation):
        shapes = eqx.filter_eval_shape(equation.freeze, state.t, state.y)
        frozen = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shapes)
        return Journey(state, Cache(frozen, jnp.array(False)))

    def to(self, t_save, journey, equation, stops):
        def is_short(journey):
            return (journey.state.status == status.RUNNING) & (journey.state.t < t_save)

        # The last turn makes no step. It only computes F and A at the end, which the saved row and the next step need.
        # F is therefore compiled for this place and for the stages of a step, and nowhere else.
        def turn(journey):
            state, cache = journey.state, journey.cache
            frozen = lax.cond(cache.known, lambda: cache.frozen, lambda: equation.freeze(state.t, state.y))
            short = is_short(journey)
            # If a batch element needs no step, its copy of the step is dropped. The linear part does not pass through
            # the branches, because each would copy it.
            state, known, tape = lax.cond(
                greatest(short),
                lambda: self._attempt(state, frozen, journey.tape, equation, stops, wanted=short),
                lambda: (state, jnp.array(True), journey.tape),
            )
            return Journey(state, Cache(frozen, known), tape)

        return lax.while_loop(lambda journey: is_short(journey) | ~journey.cache.known, turn, journey)

    def motion(self, journey, equation):
        return journey.cache.frozen.motion

    def _attempt(
        self,
        state: State,
        frozen: Frozen,
        tape: Tape | None,
        equation: Equation,
        stops: Array,
        *,
        wanted: Bool[Array, ""],
    ) -> tuple[State, Bool[Array, ""], Tape | None]:
        """Tries one step, and accepts or rejects it. If it is not `wanted`, nothing changes.

        Returns the state, whether `frozen` is still its linear part, and the tape.
        """
        for period in equation.scene.periods():  # the error estimate must see field and flow change
            longest = lax.stop_gradient(period) / STEPS_PER_PERIOD
            state = eqx.tree_at(lambda s: s.h, state, jnp.minimum(state.h, longest))
        if self.per_growth is not None:
            longest = self.per_growth / norms.fastest_growth(equation, frozen)  # infinite without compression
            state = eqx.tree_at(lambda s: s.h, state, jnp.minimum(state.h, longest))
        t, y = state.t, state.y
        attempt = Attempt.of(state, stops)
        h = attempt.t_new - t
        step = self.stepper.step(equation, frozen, t, y, h)
        y_new = self.finish(equation, step.y, frozen)
        error = self.weighted_error(equation, step.error, y_new) / self.tolerance
        moved = norms.displacement(y_new, y)
        corrected = norms.displacement(y_new, equation.filtered(step.y))
        sound = jnp.isfinite(error) & jnp.isfinite(moved) & (moved < 1.0) & (corrected < 0.05)
        full = jnp.array(False) if tape is None else tape.is_full()
        accepted = sound & (error <= 1.0) & ~full & wanted

        after = self.accepted(state, equation, frozen, attempt.t_new, y_new, step.error)
        next_step = self.controller.after_accepted(h, error, state)
        after = eqx.tree_at(lambda s: (s.h, s.last_error), after, next_step)
        shrunk = self.controller.after_refused(h, error, sound)
        refused = eqx.tree_at(lambda s: (s.h, s.rejected), state, (shrunk, state.rejected + 1))
        new = chosen(accepted, after, refused)
        code = jnp.where(new.status == status.RUNNING, self.controller.limit(new, sound, full), new.status)
        solved = norms.solve_status(equation, frozen)
        code = jnp.where(solved == status.CROWDED, solved, code)
        new = eqx.tree_at(lambda s: (s.h, s.status), new, (lax.stop_gradient(new.h), code))
        if tape is not None:
            tape = tape.with_step(accepted, attempt.t_new, y_new, jnp.where(attempt.at_stop, attempt.stop, -1))
        return chosen(wanted, new, state), ~accepted, tape

    def weighted_error(self, equation: Equation, error: Unknowns, y: Unknowns) -> Scalar:
        """Returns the error of a step to y that is compared with the tolerance."""
        return jnp.maximum(norms.error_size(error), self.edge_weight * norms.excess(equation, error, y))
