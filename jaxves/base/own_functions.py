"""Checks of functions that users write: that JAX can trace them, and that they return one array of the right shape."""

from collections.abc import Callable, Collection
from typing import Any

import jax
import jax.numpy as jnp

from .arguments import refusal

# What a function does that cannot be traced, and what to write instead. The first class that fits is taken.
_UNTRACEABLE = {
    jax.errors.TracerBoolConversionError: (
        "a function that decides in Python (if, while, and, or) by a traced value",
        "jax.numpy.where(condition, a, b) instead",
    ),
    jax.errors.NonConcreteBooleanIndexError: (
        "a function that selects entries by a traced condition",
        "jax.numpy.where(condition, a, b) instead",
    ),
    jax.errors.TracerArrayConversionError: (
        "a function that gives a traced value to NumPy",
        "the functions of jax.numpy instead of those of numpy",
    ),
    jax.errors.TracerIntegerConversionError: (
        "a function that uses a traced value as an index or a count in Python",
        "an index that does not depend on the arguments, or jax.numpy.take",
    ),
    jax.errors.ConcretizationTypeError: (
        "a function that makes a Python number (float, int, math) of a traced value",
        "the functions of jax.numpy instead, which take traced values",
    ),
}


def returned(argument: str, function: Callable, *given: Any, expected: str) -> Any:
    """Returns what `function` returns for such arguments, with shapes and types in place of arrays.

    Nothing is computed. Errors of the function itself, such as a name that does not exist, pass as they are.

    Args:
        argument: the name of the function in the message.
        function: the function.
        given: its arguments; arrays may be `jax.ShapeDtypeStruct`.
        expected: what the function should be, in words.

    Raises:
        ValueError: JAX cannot trace the function, or it cannot be called with such arguments.
    """
    try:
        return jax.eval_shape(function, *given)
    except tuple(_UNTRACEABLE) as error:
        what, instead = next(words for kind, words in _UNTRACEABLE.items() if isinstance(error, kind))
        raise refusal(argument, what, instead) from error
    except (TypeError, IndexError) as error:
        raise refusal(argument, error, expected) from error


def require_returned(
    argument: str, function: Callable, *given: Any, shapes: Collection[tuple[int, ...]], expected: str
) -> None:
    """Raises ValueError unless JAX can trace `function`, and it returns one array of real numbers of one of `shapes`.

    The other arguments are those of `returned`.
    """
    found = returned(argument, function, *given, expected=expected)
    if (
        not isinstance(found, jax.ShapeDtypeStruct)
        or found.shape not in shapes
        or not (jnp.issubdtype(found.dtype, jnp.floating) or jnp.issubdtype(found.dtype, jnp.integer))
    ):
        raise refusal(argument, f"a function that returns {_described(found)}", expected)


def number(*shape: int) -> jax.ShapeDtypeStruct:
    """Returns a placeholder for an array of floating-point numbers, for `require_returned`."""
    return jax.ShapeDtypeStruct(shape, jnp.result_type(float))


def _described(found: Any) -> str:
    if isinstance(found, jax.ShapeDtypeStruct):
        kind = (
            "" if jnp.issubdtype(found.dtype, jnp.number) and found.dtype.kind != "c" else f" of {found.dtype} values"
        )
        return f"an array{kind} of shape {found.shape}"
    if found is None:
        return "None"
    count = f" of {len(found)}" if isinstance(found, list | tuple | dict) else ""
    return f"a {type(found).__name__}{count}"
