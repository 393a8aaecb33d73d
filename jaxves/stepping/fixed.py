"""Steps of equal length between saved times."""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
from jax import lax

from ..base import status
from ..base.arguments import require_count
from ..equation import norms
from ..numerics.batching import greatest
from .march import AbstractMarch, check_stepper, chosen
from .schemes import ARK4, AbstractStepper
from .state import Journey


class AbstractEven(AbstractMarch):
    """Equal steps between saved times, which do not depend on an error."""

    @property
    def recorded(self):
        return None

    def first_step(self):
        return jnp.zeros(())

    def begin(self, state, equation):
        return Journey(state)


class Fixed(AbstractEven):
    """`steps_per_save` equal steps between saved times.

    Raises:
        ValueError: `steps_per_save` is not a whole number >= 1.
    """

    steps_per_save: int = eqx.field(static=True)
    stepper: AbstractStepper = ARK4()
    projection: bool = eqx.field(static=True, default=True)
    rough: float = eqx.field(static=True, default=norms.ROUGH)
    nodes_per_wave: float | None = eqx.field(static=True, default=None)

    def __check_init__(self):
        require_count("Fixed.steps_per_save", self.steps_per_save)
        check_stepper(self)

    def with_tolerance(self, factor):
        steps = self.steps_per_save * factor ** (-1 / (self.stepper.order + 1))
        return dataclasses.replace(self, steps_per_save=math.ceil(steps))

    def to(self, t_save, journey, equation, stops):
        room = t_save - journey.state.t
        # At the first saved time there is nothing to do. A step of length zero would divide by it.
        short = room > 0
        h = jnp.where(short, room, 1.0) / self.steps_per_save

        # Reverse mode stores only the states and recomputes each step.
        @eqx.filter_checkpoint
        def one(state):
            frozen = equation.freeze(state.t, state.y)
            step = self.stepper.step(equation, frozen, state.t, state.y, h)
            y = self.finish(equation, step.y, frozen)
            after = self.accepted(state, equation, frozen, state.t + h, y, step.error)
            return chosen(short & (state.status == status.RUNNING), after, state)

        def all_steps(state):
            return lax.scan(lambda state, _: (one(state), None), state, length=self.steps_per_save)[0]

        state = lax.cond(greatest(short), all_steps, lambda state: state, journey.state)
        arrived = jnp.where(state.status == status.RUNNING, t_save, state.t)
        return Journey(eqx.tree_at(lambda s: s.t, state, arrived))
