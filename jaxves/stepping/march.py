"""The interface of everything that chooses steps, and what an accepted step does to the state."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..base.arguments import refusal
from ..equation import norms, tracking
from ..equation.equation import Equation
from ..equation.implicit import Frozen
from ..equation.state import Unknowns
from ..numerics.arrays import Scalar
from .schemes import AbstractStepper
from .state import Journey, State


class AbstractMarch(eqx.Module):
    """How steps are chosen.

    `projection=False` leaves out the return to the kept area and metric; it exists to show what that is worth.
    `recorded` is the number of steps recorded for a derivative, or None when the derivative is that of the loop.
    `rough` is the spectral tail of a shape beyond which a run ends as unresolved, at any step.
    """

    stepper: eqx.AbstractVar[AbstractStepper]
    projection: eqx.AbstractVar[bool]
    recorded: eqx.AbstractVar[int | None]
    rough: eqx.AbstractVar[float]

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
        """The unknowns at t_new after one step from (t, y)."""
        frozen = equation.freeze(t, y)
        return self.finish(equation, self.stepper.step(equation, frozen, t, y, t_new - t).y, frozen)

    def accepted(
        self, state: State, equation: Equation, frozen: Frozen, t: Scalar, y: Unknowns, error: Scalar | None
    ) -> State:
        """The state after a step from `state`, where `frozen` holds, to (t, y); `error` is its embedded error."""
        code = norms.step_status(equation, frozen, y, self.rough)
        return State(
            t=t,
            y=y,
            h=state.h,
            last_error=state.last_error,
            time_error=None if error is None else state.time_error + error,
            angle=tracking.followed(state.angle, y),
            window=None if state.window is None else state.window.passed(t, y.integrals),
            steps=state.steps + 1,
            rejected=state.rejected,
            status=jnp.int32(code),
        )


def check_stepper(march: AbstractMarch) -> None:
    """Raises ValueError unless the stepper of `march` is a scheme."""
    if not isinstance(march.stepper, AbstractStepper):
        raise refusal(f"{type(march).__name__}.stepper", march.stepper, "a scheme, such as ARK4()")


def chosen(condition, new, old):
    """The tree `new` where the condition holds, else `old`."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), new, old)
