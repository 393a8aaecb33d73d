r"""First and second derivatives of diagnostics with respect to the numbers of a scene, for runs and steady shapes.

`AtEnd` and `AtRest` are functions {name of a number: value} -> {diagnostic: array}. Any other function of this kind can
be used as well, such as `OverHalfTurns` (`half_turns`). If it has a method `forwards`, this gives the function for
forward mode. With P numbers and Q outputs, a Jacobian costs P forward passes of about 1.5 to 3 runs each, or Q reverse
passes of about 5 runs each. Use forward mode for a few numbers, and reverse mode for many numbers and one output. Every
pass is the same compiled program with another direction, so memory does not grow with P and Q.

    jacobian   ∂Q/∂p                    second_order   ∂²Q/∂p∂p'
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from ..base.arguments import refusal, require
from ..base.bounds import POSITIVE
from ..equation.state import Unknowns
from ..inputs.scene_files import Readable
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import SENSITIVITY
from ..numerics.arrays import ScalarLike, as_float
from ..runs.case import Case
from ..stepping.march import AbstractMarch
from .steady import steady_shape

Outcome = Callable[[Mapping[str, ScalarLike]], dict[str, Array]]


def names_of(quantities: Sequence[str]) -> tuple[str, ...]:
    """Returns the names of diagnostics as a tuple; raises ValueError if there are none."""
    if isinstance(quantities, str) or not quantities:
        raise refusal("quantities", repr(quantities), "a list of names of diagnostics, at least one")
    return tuple(quantities)


def supported(scene_file: Readable) -> SceneFile:
    """Returns the scene file for sensitivities; raises SceneError if it has a key that they do not support."""
    return Case.of(scene_file, SENSITIVITY).scene_file


def chosen(found: Mapping[str, Array], quantities: Sequence[str]) -> dict[str, Array]:
    """Returns the diagnostics with these names; raises ValueError if one is unknown."""
    for name in quantities:
        if name not in found:
            raise ValueError(f"quantities: {name!r}, expected some of {', '.join(sorted(found))}.")
    return {name: found[name] for name in quantities}


class AtEnd(eqx.Module):
    """Diagnostics at the end of a run of `scene_file`, or their time averages, as functions of its numbers.

    Vesicles are relaxed first if the file asks for it. Values are NaN if a run breaks down. `t_end` and `march` are
    those of the file by default. `averaged` asks for the averages over the window `average` of the file.

    Raises:
        SceneError: the file has a key that sensitivities do not support, such as `nodes = "auto"` or `[stop]`.
        ValueError: a diagnostic is unknown, or averages are asked for and the file has no `average`.
    """

    scene_file: SceneFile = eqx.field(static=True, converter=supported)
    quantities: tuple[str, ...] = eqx.field(static=True, converter=names_of)
    t_end: float | None = eqx.field(static=True, default=None)  # the file's
    averaged: bool = eqx.field(static=True, default=False)
    march: AbstractMarch | None = eqx.field(default=None)  # the file's

    def __check_init__(self):
        if self.t_end is not None:
            require("t_end", self.t_end, POSITIVE)
        if self.averaged and self.scene_file.average is None:
            raise ValueError("averaged = True, expected a scene file with `average`, the window of the averages.")
        if self.averaged and self.t_end is not None and self.t_end < self.scene_file.average[1]:
            raise refusal("t_end", self.t_end, f"at least {self.scene_file.average[1]}, the end of the window")

    def _march(self) -> AbstractMarch:
        return Case(self.scene_file).march(self.t_end, 1) if self.march is None else self.march

    def forwards(self) -> "AtEnd":
        """Returns the same function for forward mode only, which does not have to record the steps."""
        return dataclasses.replace(self, march=self._march().forwards())

    def __call__(self, values):
        result = Case(self.scene_file).simulate(
            values, t_end=self.t_end, saves=1, march=self._march(), averaged=self.averaged
        )
        if self.averaged:
            return chosen(result.averages, self.quantities)
        return chosen({name: history[-1] for name, history in result.diagnostics.items()}, self.quantities)


class AtRest(eqx.Module):
    """Diagnostics of the steady shape near `start`, as functions of the numbers of `scene_file`.

    Derivatives follow from the implicit function theorem (`steady`) and need no run. Only first derivatives are
    correct. The end of a run is a good `start`.

    Raises:
        SceneError: as for `AtEnd`.
    """

    scene_file: SceneFile = eqx.field(static=True, converter=supported)
    quantities: tuple[str, ...] = eqx.field(static=True, converter=names_of)
    start: Unknowns

    def __call__(self, values):
        case = Case(self.scene_file)
        scene = case.scene(values)
        solver, _ = case.solved_by(scene)
        return chosen(steady_shape(scene, self.start, solver=solver).diagnostics, self.quantities)


def _traced(values: Mapping[str, ScalarLike]) -> dict[str, Array]:
    return {name: as_float(value) for name, value in values.items()}


def unit(like, i: int):
    """Returns a pytree like `like` whose i-th entry is 1 and whose other entries are 0."""
    flat, unflatten = ravel_pytree(like)
    return unflatten(jnp.zeros_like(flat).at[i].set(1.0))


def _forwards(outcome: Outcome) -> Outcome:
    return outcome.forwards() if hasattr(outcome, "forwards") else outcome


@eqx.filter_jit
def pushed(outcome: Outcome, values, tangent):
    """Returns the outputs and their derivative in the direction `tangent`."""
    outcome = _forwards(outcome)
    return jax.jvp(outcome, (values,), (tangent,))


@eqx.filter_jit
def pulled(outcome: Outcome, values, weights):
    """Returns the outputs and the derivative of their sum with `weights` with respect to every number."""
    outputs, pull = jax.vjp(outcome, values)
    return outputs, pull(weights)[0]


@eqx.filter_jit
def _curved(outcome: Outcome, values, first, second):
    outcome = _forwards(outcome)

    def slope(values):
        return jax.jvp(outcome, (values,), (first,))[1]

    return jax.jvp(slope, (values,), (second,))[1]


@eqx.filter_jit
def hessian_product(outcome: Outcome, values, weights, tangent):
    """Returns the Hessian of the outputs' sum with `weights`, applied to `tangent`; forward over reverse mode."""

    def gradient(values):
        return jax.vjp(outcome, values)[1](weights)[0]

    return jax.jvp(gradient, (values,), (tangent,))[1]


def jacobian(
    outcome: Outcome, values: Mapping[str, ScalarLike], *, reverse: bool = False
) -> tuple[dict[str, Array], dict[str, dict[str, np.ndarray]]]:
    """Returns the outputs and their derivatives, by output and number, at these values of the numbers.

    With `reverse` there is one pass for each entry of the outputs, otherwise one for each number.
    """
    values = _traced(values)
    if not reverse:
        columns = {name: pushed(outcome, values, unit(values, i)) for i, name in enumerate(sorted(values))}
        outputs = next(iter(columns.values()))[0]
        return outputs, {key: {name: np.asarray(columns[name][1][key]) for name in values} for key in outputs}
    outputs = eqx.filter_jit(outcome)(values)
    flat, _ = ravel_pytree(outputs)
    rows = [pulled(outcome, values, unit(outputs, i))[1] for i in range(flat.size)]
    return outputs, _from_rows(outputs, rows, values)


def _from_rows(outputs, rows, values):
    _, unflatten = ravel_pytree(outputs)
    by_name = {name: unflatten(jnp.stack([row[name] for row in rows])) for name in values}
    return {key: {name: np.asarray(by_name[name][key]) for name in values} for key in outputs}


def gradient(outcome: Outcome, values: Mapping[str, ScalarLike]) -> dict[str, float]:
    """Returns the derivatives of a single output number with respect to all `values`, with one reverse pass.

    Raises:
        ValueError: `outcome` has more than one output number.
    """
    values = _traced(values)
    shapes = jax.tree.leaves(eqx.filter_eval_shape(outcome, values))
    if sum(leaf.size for leaf in shapes) != 1:
        raise ValueError(f"outcome: gives shapes {[leaf.shape for leaf in shapes]}, expected one number.")
    one = jax.tree.map(jnp.ones_like, eqx.filter_eval_shape(outcome, values))
    _, found = pulled(outcome, values, one)
    return {name: float(slope) for name, slope in found.items()}


def second_order(outcome: Outcome, values: Mapping[str, ScalarLike]) -> dict[str, dict[tuple[str, str], np.ndarray]]:
    """Returns all second derivatives by output and pair of numbers, forward over forward mode; not for `AtRest`."""
    values = _traced(values)
    names = sorted(values)
    out: dict[str, dict[tuple[str, str], np.ndarray]] = {}
    for i, first in enumerate(names):
        for j, second in enumerate(names[: i + 1]):
            for key, value in _curved(outcome, values, unit(values, i), unit(values, j)).items():
                out.setdefault(key, {})[first, second] = out.setdefault(key, {})[second, first] = np.asarray(value)
    return out
