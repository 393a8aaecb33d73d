r"""How diagnostics depend on the numbers of a scene: first and second derivatives, of runs and of steady shapes.

`AtEnd` and `AtRest` are functions of the numbers (`parameters`), {name: value} -> {diagnostic: array}; any such
function will do. With P numbers and Q outputs a Jacobian costs P forward passes of about 1.5 to 3 runs each, or Q
reverse ones of 5: forward is the choice for a few numbers, reverse for many numbers and one output. Every pass is the
same compiled program with another direction, so that memory does not grow with P and Q.

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
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import SENSITIVITY
from ..numerics.arrays import ScalarLike, as_float
from ..runs.case import Case
from ..stepping.marching import AbstractMarch
from .steady import steady_shape

Outcome = Callable[[Mapping[str, ScalarLike]], dict[str, Array]]


def _names(quantities: Sequence[str]) -> tuple[str, ...]:
    if isinstance(quantities, str) or not quantities:
        raise refusal("quantities", repr(quantities), "a list of names of diagnostics, at least one")
    return tuple(quantities)


def _chosen(found: Mapping[str, Array], quantities: Sequence[str]) -> dict[str, Array]:
    for name in quantities:
        if name not in found:
            raise ValueError(f"quantities: {name!r}, expected some of {', '.join(sorted(found))}.")
    return {name: found[name] for name in quantities}


class AtEnd(eqx.Module):
    """Diagnostics at the end of a run of `scene_file`, or their averages over its window, as functions of its numbers.

    Vesicles that the file wants relaxed are relaxed first. Values are NaN where a run breaks down.

    Raises:
        SceneError: the file has a key that a sensitivity cannot honour, such as `nodes = "auto"` or `[stop]`.
        ValueError: an unknown diagnostic, or averages of a file without `average`.
    """

    scene_file: SceneFile = eqx.field(static=True)
    quantities: tuple[str, ...] = eqx.field(static=True, converter=_names)
    t_end: float | None = eqx.field(static=True, default=None)  # the file's
    averaged: bool = eqx.field(static=True, default=False)
    march: AbstractMarch | None = eqx.field(default=None)  # the file's

    def __check_init__(self):
        Case.of(self.scene_file, SENSITIVITY)
        if self.t_end is not None:
            require("t_end", self.t_end, POSITIVE)
        if self.averaged and self.scene_file.average is None:
            raise ValueError("averaged = True, expected a scene file with `average`, the window of the averages.")
        if self.averaged and self.t_end is not None and self.t_end < self.scene_file.average[1]:
            raise refusal("t_end", self.t_end, f"at least {self.scene_file.average[1]}, the end of the window")

    def _march(self) -> AbstractMarch:
        return Case(self.scene_file).march(self.t_end, 1) if self.march is None else self.march

    def forwards(self) -> "AtEnd":
        """The same for forward mode alone, whose steps need not be recorded."""
        return dataclasses.replace(self, march=self._march().forwards())

    def __call__(self, values):
        result = Case(self.scene_file).simulate(
            values, t_end=self.t_end, saves=1, march=self._march(), averaged=self.averaged
        )
        if self.averaged:
            return _chosen(result.averages, self.quantities)
        return _chosen({name: history[-1] for name, history in result.diagnostics.items()}, self.quantities)


class AtRest(eqx.Module):
    """Diagnostics of the steady shape near `start`; its derivatives are implicit, with no run behind them (`steady`).

    The end of a run is a good `start`. First derivatives only. Raises SceneError as `AtEnd` does.
    """

    scene_file: SceneFile = eqx.field(static=True)
    quantities: tuple[str, ...] = eqx.field(static=True, converter=_names)
    start: Unknowns

    def __check_init__(self):
        Case.of(self.scene_file, SENSITIVITY)

    def __call__(self, values):
        case = Case(self.scene_file)
        scene = case.scene(values)
        solver, _ = case.solved_by(scene)
        return _chosen(steady_shape(scene, self.start, solver=solver).diagnostics, self.quantities)


def _traced(values: Mapping[str, ScalarLike]) -> dict[str, Array]:
    return {name: as_float(value) for name, value in values.items()}


def unit(like, i: int):
    """The i-th unit vector of all entries of a pytree."""
    flat, unflatten = ravel_pytree(like)
    return unflatten(jnp.zeros_like(flat).at[i].set(1.0))


def _forwards(outcome: Outcome) -> Outcome:
    return outcome.forwards() if isinstance(outcome, AtEnd) else outcome


@eqx.filter_jit
def pushed(outcome: Outcome, values, tangent):
    """(outputs, their derivative in the direction `tangent`)."""
    outcome = _forwards(outcome)
    return jax.jvp(outcome, (values,), (tangent,))


@eqx.filter_jit
def pulled(outcome: Outcome, values, weights):
    """(outputs, the derivative of their sum with `weights` in every number)."""
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
    """The second derivative of the outputs' sum with `weights`, applied to `tangent`: forward over reverse."""

    def gradient(values):
        return jax.vjp(outcome, values)[1](weights)[0]

    return jax.jvp(gradient, (values,), (tangent,))[1]


def jacobian(
    outcome: Outcome, values: Mapping[str, ScalarLike], *, reverse: bool = False
) -> tuple[dict[str, Array], dict[str, dict[str, np.ndarray]]]:
    """(outputs, derivatives by output and number), at these values of the numbers.

    `reverse`: a pass for each entry of the outputs instead of one for each number.
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
    """The derivative of the one number that `outcome` gives in all `values`: one reverse pass.

    Raises:
        ValueError: it gives several.
    """
    values = _traced(values)
    shapes = jax.tree.leaves(eqx.filter_eval_shape(outcome, values))
    if sum(leaf.size for leaf in shapes) != 1:
        raise ValueError(f"outcome: gives shapes {[leaf.shape for leaf in shapes]}, expected one number.")
    one = jax.tree.map(jnp.ones_like, eqx.filter_eval_shape(outcome, values))
    _, found = pulled(outcome, values, one)
    return {name: float(slope) for name, slope in found.items()}


def second_order(outcome: Outcome, values: Mapping[str, ScalarLike]) -> dict[str, dict[tuple[str, str], np.ndarray]]:
    """All second derivatives by output and pair of numbers, forward over forward; not of `AtRest`."""
    values = _traced(values)
    names = sorted(values)
    out: dict[str, dict[tuple[str, str], np.ndarray]] = {}
    for i, first in enumerate(names):
        for j, second in enumerate(names[: i + 1]):
            for key, value in _curved(outcome, values, unit(values, i), unit(values, j)).items():
                out.setdefault(key, {})[first, second] = out.setdefault(key, {})[second, first] = np.asarray(value)
    return out
