"""The interface of fixed and adaptive stepping, and the new state after an accepted step."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..base.arguments import refusal
from ..equation import norms, tracking
from ..equation.equation import Equation
from ..equation.implicit import Frozen
from ..equation.state import Motion, Unknowns
from ..numerics.arrays import Scalar
from .schemes import AbstractStepper
from .state import Journey, State


class AbstractMarch(eqx.Module):
    """A method of choosing the steps.

    `projection=False` leaves out the projection to the conserved area and metric; it is for experiments. `recorded` is
    the number of steps that can be recorded for a derivative, or None if the loop itself is differentiated. `rough` is
    the spectral tail of a shape above which a run ends as unresolved at any step. It also does with fewer
    `nodes_per_wave` of the fastest growing wrinkle, or, if that is None, without a mode for it.
    """

    stepper: eqx.AbstractVar[AbstractStepper]
    projection: eqx.AbstractVar[bool]
    recorded: eqx.AbstractVar[int | None]
    rough: eqx.AbstractVar[float]
    nodes_per_wave: eqx.AbstractVar[float | None]

    @abc.abstractmethod
    def first_step(self) -> Scalar:
        """Returns the first step size to try."""

    @abc.abstractmethod
    def begin(self, state: State, equation: Equation) -> Journey:
        """Begins stepping from a state."""

    @abc.abstractmethod
    def to(self, t_save: Scalar, journey: Journey, equation: Equation, stops: Array) -> Journey:
        """Steps until `t_save`, or to the end of the run.

        `stops` are all times at which steps must end, with `t_save`.
        """

    def motion(self, journey: Journey, equation: Equation) -> Motion:
        """Returns all quantities at the time that `to` has reached."""
        return equation.motion(journey.state.t, journey.state.y)

    @abc.abstractmethod
    def with_tolerance(self, factor: float) -> "AbstractMarch":
        """Returns the same method with about `factor` times the allowed error of a step."""

    def forwards(self) -> "AbstractMarch":
        """Returns the same method for forward mode only, if derivatives are then cheaper."""
        return self

    def finish(self, equation: Equation, y: Unknowns, frozen: Frozen) -> Unknowns:
        """Filters and, unless it is switched off, projects."""
        return equation.project(y, frozen.constraint) if self.projection else equation.filtered(y)

    def step(self, equation: Equation, t: Scalar, y: Unknowns, t_new: Scalar) -> Unknowns:
        """Returns the unknowns at t_new after one step from (t, y)."""
        frozen = equation.freeze(t, y)
        return self.finish(equation, self.stepper.step(equation, frozen, t, y, t_new - t).y, frozen)

    def accepted(
        self, state: State, equation: Equation, frozen: Frozen, t: Scalar, y: Unknowns, error: Unknowns | None
    ) -> State:
        """Returns the state after a step from `state` to (t, y).

        `frozen` is the linear part at the start of the step, and `error` its embedded error.
        """
        errors = None if state.errors is None else state.errors.after(error, y)
        total = None if error is None else state.time_error + norms.error_size(error)
        code = norms.step_status(equation, frozen, y, self.rough, self.nodes_per_wave)
        return State(
            t=t,
            y=y,
            h=state.h,
            last_error=state.last_error,
            time_error=total if errors is None else errors.total(),
            errors=errors,
            angle=tracking.followed(state.angle, y),
            window=None if state.window is None else state.window.passed(t, y.integrals),
            period=None if state.period is None else state.period.after(equation.scene, state.t, state.y, t, y),
            steps=state.steps + 1,
            rejected=state.rejected,
            status=jnp.int32(code),
        )


def check_stepper(march: AbstractMarch) -> None:
    """Raises ValueError unless the stepper of `march` is a scheme."""
    if not isinstance(march.stepper, AbstractStepper):
        raise refusal(f"{type(march).__name__}.stepper", march.stepper, "a scheme, such as ARK4()")


def chosen(condition, new, old):
    """Returns the tree `new` if the condition holds, otherwise `old`."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
