r"""How diagnostics depend on the numbers of a scene: first and second derivatives, of runs and of steady shapes.

`at_end` and `at_rest` are functions of the numbers (`parameters`), {name: value} -> {diagnostic: array}; any such
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

from .arrays import ScalarLike, as_float
from .marching import AbstractMarch, simulate
from .motion import Unknowns
from .parameters import scene_of
from .problem import march_of
from .scenetables import SceneFile
from .steady import steady

Outcome = Callable[[Mapping[str, ScalarLike]], dict[str, Array]]


def _chosen(found: Mapping[str, Array], quantities: Sequence[str]) -> dict[str, Array]:
    for name in quantities:
        if name not in found:
            raise ValueError(f"quantities: {name!r}, expected some of {', '.join(sorted(found))}.")
    return {name: found[name] for name in quantities}


class at_end(eqx.Module):
    """Diagnostics at the end of a run of `scene_file`, or their averages over its window, as functions of its numbers.

    Vesicles that the file wants relaxed first are not. Raises ValueError for a diagnostic that there is not.
    """

    scene_file: SceneFile = eqx.field(static=True)
    quantities: tuple[str, ...] = eqx.field(static=True, converter=tuple)
    t_end: float | None = eqx.field(static=True, default=None)  # the file's
    averaged: bool = eqx.field(static=True, default=False)
    march: AbstractMarch | None = eqx.field(default=None)  # the file's

    def forwards(self) -> "at_end":
        """The same for forward mode alone, whose steps need not be recorded."""
        march = march_of(self.scene_file) if self.march is None else self.march
        return dataclasses.replace(self, march=march.forwards())

    def __call__(self, values):
        file = self.scene_file
        t_end = file.t_end if self.t_end is None else self.t_end
        result = simulate(
            scene_of(file, values),
            t_end,
            saves=1,
            march=march_of(file) if self.march is None else self.march,
            average=file.average if self.averaged else None,
        )
        if self.averaged:
            return _chosen(result.averages, self.quantities)
        return _chosen({name: history[-1] for name, history in result.diagnostics.items()}, self.quantities)


class at_rest(eqx.Module):
    """Diagnostics of the steady shape near `start`; its derivatives are implicit, with no run behind them (`steady`).

    The end of a run is a good `start`. First derivatives only.
    """

    scene_file: SceneFile = eqx.field(static=True)
    quantities: tuple[str, ...] = eqx.field(static=True, converter=tuple)
    start: Unknowns

    def __call__(self, values):
        found = steady(scene_of(self.scene_file, values), self.start)
        return _chosen(found.diagnostics, self.quantities)


def _traced(values: Mapping[str, ScalarLike]) -> dict[str, Array]:
    return {name: as_float(value) for name, value in values.items()}


def unit(like, i: int):
    """The i-th unit vector of all entries of a pytree."""
    flat, unflatten = ravel_pytree(like)
    return unflatten(jnp.zeros_like(flat).at[i].set(1.0))


def _forwards(outcome: Outcome) -> Outcome:
    return outcome.forwards() if isinstance(outcome, at_end) else outcome


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
    """All second derivatives by output and pair of numbers, forward over forward; not of `at_rest`."""
    values = _traced(values)
    names = sorted(values)
    out: dict[str, dict[tuple[str, str], np.ndarray]] = {}
    for i, first in enumerate(names):
        for j, second in enumerate(names[: i + 1]):
            for key, value in _curved(outcome, values, unit(values, i), unit(values, j)).items():
                out.setdefault(key, {})[first, second] = out.setdefault(key, {})[second, first] = np.asarray(value)
    return out
