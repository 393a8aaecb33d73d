r"""Optimal control: the field E(t) with which a run ends as wanted, with a bound on |V_m|.

`steer` first brings the quantity to its wanted value, without the bound. It reduces the cost J of `control` with L-BFGS
directions (`optax.scale_by_lbfgs`) in the coordinates √w_k u_k, where w_k are the weights of the trapezoidal rule. The
directions then do not depend on where the knots are dense. J is a square whose least value is zero. No step therefore
goes further than to the place where the linearised residual vanishes, 2J/|slope|; steps are halved until J decreases,
and a run that breaks down is a step too long.

If |V_m| is then above its bound, the search goes on along fields that give the same quantity. Each step has a part
across, which corrects the quantity to first order, and a part along, which reduces the excess of |V_m| over a limit
just below the bound. The search ends when the quantity is within its tolerance and |V_m| is within the bound itself at
all saved times.
"""

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, ArrayLike, Float

from ..base import status
from ..base.arguments import is_known, refusal, require, require_count
from ..base.bounds import FINITE, POSITIVE
from ..base.progress import Progress, silent
from ..inputs.scene_files import Readable
from ..inputs.uses import CONTROL
from ..numerics.arrays import as_float
from ..physics.scene import Scene
from ..physics.waveform import AC, PiecewiseLinear
from ..runs.case import Case
from ..stepping.adaptive import Adaptive
from ..stepping.march import AbstractMarch
from ..stepping.marching import Result
from .control import Controlled, Evaluation, Goal, Quantity, greatest_potential, with_gradient
from .line_search import Trial, capped, step_along

MARGIN = 0.01  # relative distance of the limit of |V_m| in the cost from the bound
_FIRST = 0.5  # longest first step of a value, relative to the largest one
_ALONG = 0.07  # the same for steps that keep the quantity


class Steering(NamedTuple):
    """The field that `steer` found. `waveform` is its factor of time, `result` a run with it."""

    word: str  # "met", or why the search ended before
    quantity: float
    wanted: float
    max_V_m: float  # at the saved times of `result`
    bound: float  # infinite if there is none
    waveform: PiecewiseLinear
    result: Result
    history: tuple[Evaluation, ...]  # every gradient evaluation

    @property
    def values(self) -> Float[np.ndarray, "K"]:
        """The values at the knots."""
        return np.asarray(self.waveform.values)

    @property
    def scene(self) -> Scene:
        """The scene with this field."""
        return self.result.scene

    def table(self) -> dict[str, object]:
        """Returns the table `[field.time]` with which a scene file has this field."""
        return {"kind": "table", "times": np.asarray(self.waveform.times).tolist(), "values": self.values.tolist()}

    def __repr__(self) -> str:
        bound = "" if self.bound == inf else f" (bound {self.bound:.6g})"
        return (
            f"<Steering: {self.word} after {len(self.history)} gradient evaluations with {len(self.values)} knots; "
            f"quantity {self.quantity:.6g}, wanted {self.wanted:.6g}; largest |V_m| = {self.max_V_m:.6g}{bound}>"
        )


def steer(
    scene: Scene | Readable,
    quantity: Quantity,
    wanted: float,
    *,
    knots: int = 24,
    max_V_m: float | None = None,
    t_end: float | None = None,
    start: ArrayLike | Sequence[float] | None = None,
    evaluations: int = 50,
    tolerance: float = 1e-3,
    saves: int | None = None,
    march: AbstractMarch | None = None,
    progress: Progress = silent,
) -> Steering:
    """Returns a field E(t) with which a quantity at the end of a run is `wanted`, and |V_m| stays within its bound.

    The factor on E_∞ is linear between `knots` equally spaced times from 0 to `t_end`. Its values are found with
    gradients in reverse mode. They are not unique; the search ends at the first ones that meet the goal, near `start`.
    A scene that is symmetric stays so: a `start` at which the gradient is zero by symmetry cannot be left.

    Args:
        scene: a scene with a field, or a scene file: read, or as a path, a built-in name or tables. `[field.time]` is
            replaced.
        quantity: the name of a diagnostic that is one number, such as "deformation" of one vesicle or "separation" of
            two, of which the value at `t_end` counts; or a function of the result in JAX.
        wanted: the value it should have, in the units of the quantity (angles in radians).
        knots: the number of values to be found, from 2.
        max_V_m: the bound on |V_m| in units of a |E_∞|, over all membranes and times; none by default.
        t_end: the end of the run, in t_κ; needed for a scene, that of the file by default.
        start: one value or (knots,), from which the search begins; what the field of the scene has by default.
        evaluations: the largest number of runs with gradient.
        tolerance: the allowed |quantity - wanted|, relative to |wanted|, or absolute if `wanted` is zero.
        saves: the number of saved times, at which the bound counts; by default two for each interval between knots.
        march: how runs advance in time; `Adaptive()`, or what the scene file says, by default.
        progress: called after each gradient evaluation with their number, their largest number, and a text.

    Raises:
        ValueError: an argument cannot be used, or the run with `start` does not reach its end.
        SceneError: the scene file has a key that this use does not support, such as `[stop]`.
    """
    for name, value, bounds in (("wanted", wanted, FINITE), ("tolerance", tolerance, POSITIVE)):
        _require_number(name, value, bounds)
    if max_V_m is not None:
        _require_number("max_V_m", max_V_m, POSITIVE)
    if not isinstance(quantity, str) and not callable(quantity):
        raise refusal("quantity", quantity, "the name of a diagnostic, or a function of the result")
    require_count("knots", knots, 2)
    require_count("evaluations", evaluations)
    saves = 2 * (knots - 1) if saves is None else saves
    require_count("saves", saves)
    controlled = _controlled(scene, quantity, knots, t_end, saves, march)
    values = _start(controlled, start)
    # This checks `quantity`.
    eqx.filter_eval_shape(lambda values: controlled.measured(controlled.run(values, saves)), values)
    search = _Search(
        controlled, float(wanted), inf if max_V_m is None else max_V_m, tolerance, saves, evaluations, progress
    )
    return search.from_values(values)


def _require_number(name: str, value, bounds) -> None:
    if not is_known(value) or np.shape(value) != ():
        raise refusal(name, value, "one known number")
    require(name, value, bounds)


def _controlled(scene, quantity, knots, t_end, saves, march) -> Controlled:
    solved_by = None, None
    if not isinstance(scene, Scene):
        case = Case.of(scene, CONTROL)
        scene, code = eqx.filter_jit(lambda: case.at_rest(case.scene({})))()
        if int(code) != status.RUNNING:
            raise refusal("vesicle.relaxed", "true", f"a shape that relaxes, not {status.WORDS[int(code)]}")
        t_end = case.scene_file.t_end if t_end is None else t_end
        _require_number("t_end", t_end, POSITIVE)
        march = case.march(t_end, saves) if march is None else march
        solved_by = case.solved_by(scene)
    if t_end is None:
        raise refusal("t_end", t_end, "the end of the run")
    _require_number("t_end", t_end, POSITIVE)
    if scene.field is None:
        raise refusal("scene.field", scene.field, "a field, which is what is steered")
    if isinstance(scene.field.history, AC) and scene.field.history.averaged:
        raise refusal("scene.field.history.averaged", True, "a field that is not averaged over its period")
    march = Adaptive() if march is None else march
    if not isinstance(march, AbstractMarch) or (isinstance(march, Adaptive) and march.recorded is None):
        raise refusal("march", march, "a march that reverse mode can follow, such as Adaptive() or Fixed(4)")
    times = jnp.linspace(0.0, t_end, knots)
    return Controlled(scene, times, march, quantity, *solved_by)


def _start(controlled: Controlled, start: ArrayLike | Sequence[float] | None) -> Float[Array, "K"]:
    knots = len(controlled.times)
    if start is None:
        history = controlled.scene.field.history
        start = 1.0 if history is None else jax.vmap(history)(controlled.times)
    if not is_known(start) or np.shape(start) not in ((), (knots,)):
        raise refusal("start", start, f"one number, or {knots}, one for each knot")
    require("start", start, FINITE)
    return jnp.broadcast_to(as_float(start), (knots,))


class _Search(NamedTuple):
    """One call of `steer` with checked arguments."""

    controlled: Controlled
    wanted: float
    bound: float
    tolerance: float
    saves: int
    evaluations: int
    progress: Progress

    @property
    def scale(self) -> float:
        return abs(self.wanted) or 1.0

    def is_met(self, quantity: float, max_V_m: float) -> bool:
        return max_V_m <= self.bound and abs(quantity - self.wanted) <= self.tolerance * self.scale

    def from_values(self, values: Float[Array, "K"]) -> Steering:
        """Returns the end of the search from these values."""
        history: list[Evaluation] = []
        here, word = self._descent(values, history)
        if word == "met" and here.rest[2].max_V_m > self.bound:
            here, word = self._brought_within(here, history)
        values = here.rest[0]
        result = self.controlled.run(values, self.saves)
        quantity, greatest = float(self.controlled.measured(result)), float(jnp.max(greatest_potential(result)))
        waveform = self.controlled.waveform(values)
        return Steering(word, quantity, self.wanted, greatest, self.bound, waveform, result, tuple(history))

    def _evaluated(self, values, history, goal: Goal | None = None) -> Trial | None:
        """Returns cost and residual with these values, with the gradient; None if there are too many evaluations.

        Without a `goal` the cost is that of the quantity alone.
        """
        if len(history) == self.evaluations:
            return None
        goal = Goal(as_float(self.wanted), as_float(self.scale), as_float(inf)) if goal is None else goal
        outcome, gradient = with_gradient(self.controlled, goal, values, self.saves)
        numbers = float(outcome.cost), float(outcome.quantity), float(outcome.max_V_m)
        found = Evaluation(*numbers, status.WORDS[int(outcome.status)])
        history.append(found)
        self.progress(len(history), self.evaluations, str(found))
        return Trial(found.cost, found.quantity - self.wanted, (values, gradient, found))

    def _brought_within(self, here: Trial, history) -> tuple[Trial, str]:
        """Returns the end of the search along values of equal quantity, to where |V_m| is within its bound."""
        only_bound = Goal(as_float(self.wanted), as_float(inf), as_float((1 - MARGIN) * self.bound))
        longest, best = _ALONG * max(float(jnp.max(jnp.abs(here.rest[0]))), 1.0), here
        along = across = jnp.zeros_like(here.rest[0])
        while True:
            values, gradient, found = here.rest
            if not abs(here.residual) <= self.scale:  # off the values of equal quantity, or broken down
                longest = longest / 3
                here = self._evaluated(best.rest[0] + capped(along, longest) + across, history)
            elif self.is_met(found.quantity, found.max_V_m):
                return here, "met"
            else:
                # The slope of the quantity over its scale, in the coordinates √w u.
                slope = gradient / _root(values) * self.scale / (here.residual or 1e-300)
                normal = slope / (slope @ slope)
                along, best = jnp.zeros_like(values), here
                if found.max_V_m > (1 - MARGIN) * self.bound:
                    beside = self._evaluated(values, history, only_bound)
                    if beside is None:
                        return best, "evaluations used up"
                    pull = beside.rest[1] / _root(values)
                    pull = pull - (pull @ slope) * normal
                    along = -2 * beside.cost * pull / (pull @ pull) / _root(values)
                across = -here.residual / self.scale * normal / _root(values)
                longest = 1.5 * longest
                here = self._evaluated(values + capped(along, longest) + across, history)
            if here is None:
                return best, "evaluations used up"

    def _descent(self, values, history) -> tuple[Trial, str]:
        """Returns the place at which the quantity is the wanted one, or the best one, and the word."""
        root = _root(values)
        here = self._evaluated(values, history)
        if here.cost == inf:
            wanted = f"values with which the run reaches its end, and not the status {here.rest[2].word}"
            raise refusal("start", values, wanted)
        method = optax.scale_by_lbfgs()
        state = method.init(values)
        longest = _FIRST * max(float(jnp.max(jnp.abs(values))), 1.0)
        while not abs(here.residual) <= self.tolerance * self.scale:
            values, gradient, _ = here.rest
            g, u = gradient / root, root * values
            direction, state = method.update(g, state, u)
            if not g @ direction > 0:  # J is concave along a step that is remembered; forget all of them
                direction, state = method.update(g, method.init(values), u)
            slope, direction = float(g @ direction), direction / root
            if not slope > 0:
                return here, "no further descent"
            most = longest / float(jnp.max(jnp.abs(direction)))
            share = min(2 * here.cost / slope, most, 1.0 if state.count > 1 else inf)
            step = step_along(here, slope, share, lambda s, u=values, d=direction: self._evaluated(u - s * d, history))
            if step is None:
                return here, "evaluations used up" if len(history) == self.evaluations else "no further descent"
            longest = 2 * longest * step[0] / most
            here = step[1]
        return here, "met"


def _root(values: Float[Array, "K"]) -> Float[Array, "K"]:
    """Returns the square roots of the weights of the knots in the trapezoidal rule."""
    return jnp.sqrt(jnp.ones_like(values).at[jnp.array([0, -1])].set(0.5))
