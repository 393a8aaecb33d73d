r"""A run as a function of the values that the field takes at given times, and the cost that `steer` reduces.

The field is E_∞ times a factor that is linear between the knots (t_k, u_k). The cost is a sum of squares,

    J(u) = ½ ((Q(u) - Q_wanted)/s)² + ½ ⟨max(0, max|V_m|/limit - 1)²⟩

with the quantity Q of the run, its scale s, and the mean over the saved times. It is zero if and only if the quantity
is the wanted one and no |V_m| is above the limit. No multiplier is needed for the limit then. Reverse mode gives the
derivatives with respect to all values at about the cost of five runs.
"""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..base import status
from ..base.arguments import refusal
from ..base.own_functions import require_returned
from ..numerics.arrays import Scalar, Status
from ..numerics.linear import AbstractSolver
from ..operators.interactions import AbstractCoupling
from ..physics.scene import Scene
from ..physics.waveform import PiecewiseLinear
from ..stepping.march import AbstractMarch
from ..stepping.marching import Result, simulate

Quantity = str | Callable[[Result], Array]


class Outcome(eqx.Module):
    """The cost of a run, its quantity, the largest |V_m| over the saved times, and its status."""

    cost: Scalar
    quantity: Scalar
    max_V_m: Scalar
    status: Status


class Evaluation(NamedTuple):
    """One gradient evaluation: the cost, the quantity, the largest |V_m|, and the status word of the run."""

    cost: float
    quantity: float
    max_V_m: float
    word: str

    def __str__(self) -> str:
        end = "" if self.word == status.WORDS[status.COMPLETE] else f", the run ended as {self.word}"
        return f"quantity {self.quantity:.6g}, largest |V_m| {self.max_V_m:.4g}, cost {self.cost:.3g}{end}"


class Controlled(eqx.Module):
    """A scene whose field is a function of its values at the knots.

    `quantity` is the name of a diagnostic, of which the value at the end counts, or a function of a `Result`.
    """

    scene: Scene
    times: Float[Array, "K"]  # of the knots, in t_κ
    march: AbstractMarch
    quantity: Quantity
    solver: AbstractSolver | None
    coupling: AbstractCoupling | None

    def waveform(self, values: Float[Array, "K"]) -> PiecewiseLinear:
        """Returns the time dependence of the field with these values."""
        return PiecewiseLinear(self.times, values)

    def with_values(self, values: Float[Array, "K"]) -> Scene:
        """Returns the scene with the field that has these values at the knots."""
        return eqx.tree_at(
            lambda scene: scene.field.history, self.scene, self.waveform(values), is_leaf=lambda leaf: leaf is None
        )

    def run(self, values: Float[Array, "K"], saves: int) -> Result:
        """Runs the scene with these values to the time of the last knot."""
        return simulate(
            self.with_values(values),
            self.times[-1],
            saves=saves,
            march=self.march,
            solver=self.solver,
            coupling=self.coupling,
        )

    def measured(self, result: Result) -> Scalar:
        """Returns the quantity of a run.

        Raises:
            ValueError: there is no such diagnostic, or the quantity is not one number.
        """
        wanted = "one number: the name of such a diagnostic of one vesicle, or a function of the result"
        if isinstance(self.quantity, str):
            if self.quantity not in result.diagnostics:
                raise refusal("quantity", self.quantity, f"one of {', '.join(sorted(result.diagnostics))}")
            value = result.diagnostics[self.quantity][-1]
            value = jnp.reshape(value, ()) if value.size == 1 else value
        else:
            require_returned("quantity", lambda: self.quantity(result), shapes=[()], expected=wanted)
            value = jnp.asarray(self.quantity(result))
        if value.shape != () or not jnp.issubdtype(value.dtype, jnp.floating):
            raise refusal("quantity", f"{self.quantity} with shape {value.shape}", wanted)
        return value


def greatest_potential(result: Result) -> Float[Array, "T"]:
    """Returns the largest |V_m| of all vesicles at each saved time."""
    return jnp.max(result.diagnostics["max_V_m"], axis=1)


class Goal(eqx.Module):
    """The wanted quantity, its scale, and the largest |V_m| that costs nothing, which may be infinite."""

    wanted: Scalar
    scale: Scalar
    limit: Scalar

    def cost(self, quantity: Scalar, V_m: Float[Array, "T"]) -> Scalar:
        """Returns J for a quantity and the largest |V_m| at each saved time."""
        missed = (quantity - self.wanted) / self.scale
        return 0.5 * missed**2 + 0.5 * jnp.mean(jnp.maximum(V_m / self.limit - 1, 0.0) ** 2)


def outcome_of(controlled: Controlled, goal: Goal, values: Float[Array, "K"], saves: int) -> Outcome:
    """Returns the outcome of the run with these values; the cost is infinite if the run does not reach its end."""
    result = controlled.run(values, saves)
    quantity, V_m = controlled.measured(result), greatest_potential(result)
    cost = jnp.where(result.status == status.COMPLETE, goal.cost(quantity, V_m), jnp.inf)
    return Outcome(cost, quantity, jnp.max(V_m), result.status)


@eqx.filter_jit
def with_gradient(
    controlled: Controlled, goal: Goal, values: Float[Array, "K"], saves: int
) -> tuple[Outcome, Float[Array, "K"]]:
    """Returns the outcome of the run with these values, and ∂J/∂u by reverse mode."""

    def cost(values):
        outcome = outcome_of(controlled, goal, values, saves)
        return outcome.cost, outcome

    gradient, outcome = jax.grad(cost, has_aux=True)(values)
    return outcome, gradient
