"""Observables of the user's own: functions of a row, computed for every saved time."""

from collections.abc import Callable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..base.arguments import refusal
from ..base.own_functions import require_returned
from .quantities import QUANTITIES
from .rows import Row

Observables = Mapping[str, Callable[[Row], Array]]


def require_observables(observables: Observables | None) -> None:
    """Raises ValueError unless these are functions with names of their own, or None."""
    if observables is None:
        return
    if not isinstance(observables, Mapping):
        raise refusal("observables", observables, "functions of a row by their names, such as {'height': height}")
    for name, function in observables.items():
        if not isinstance(name, str) or not name.isidentifier() or name in QUANTITIES:
            raise refusal("observables", repr(name), "names of your own, which are identifiers and no diagnostics")
        if not callable(function):
            raise refusal(f"observables[{name!r}]", function, "a function of a row")


def with_own(rows: Row, observables: Observables | None) -> Row:
    """Returns rows whose diagnostics also have the values of the functions, as NumPy arrays."""
    if not observables or not len(rows.t):
        return rows
    values = observed(observables, jax.tree.map(jnp.asarray, rows))
    return rows._replace(diagnostics=rows.diagnostics | {name: np.asarray(value) for name, value in values.items()})


@eqx.filter_jit
def observed(observables: Observables, rows: Row) -> dict[str, Array]:
    """Returns the values of the functions at every saved time, (T,) or (T, M).

    Raises:
        ValueError: JAX cannot trace a function, or it does not return one number, or one for each vesicle.
    """
    M = rows.x.shape[1]
    row = jax.tree.map(lambda a: jax.ShapeDtypeStruct(a.shape[1:], a.dtype), rows)
    for name, function in observables.items():
        expected = f"a function of a row in JAX that returns one number, or an array with one for each of {M} vesicles"
        require_returned(f"observables[{name!r}]", function, row, shapes=[(), (M,)], expected=expected)
    return {
        name: jax.lax.map(lambda row, function=function: jnp.asarray(function(row), float), rows)
        for name, function in observables.items()
    }
