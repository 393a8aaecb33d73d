"""Checks of the arguments of Python functions.

A value is called known if no transformation of JAX traces it. Known values are checked at once, with NumPy, because
inside `jit` the functions of JAX would trace them as well. Traced values are checked in the compiled program. Every
error is a ValueError whose message is one line. It names the argument, its value and what was expected.
"""

import operator
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from .bounds import Bounds
from .jax_parts import tracer_type

_TRACER = tracer_type()


def is_known(*values: Any) -> bool:
    """Returns whether no part of any value is traced."""
    return not any(isinstance(leaf, _TRACER) for leaf in jax.tree.leaves(values))


def refusal(argument: str, value: Any, expected: str) -> ValueError:
    """Returns the error that says which argument has which value, and what was expected."""
    text = " ".join(str(value).split())
    return ValueError(f"{argument} = {text if len(text) <= 80 else text[:77] + '...'}, expected {expected}.")


def require(argument: str, value: Any, bounds: Bounds) -> None:
    """Raises ValueError if a known `value`, a number or an array of numbers, has an entry out of bounds."""
    if not is_known(value):
        return
    entries = np.asarray(value)
    if entries.dtype.kind not in "iuf":
        raise refusal(argument, value, bounds.expected)
    out = np.argwhere(~np.asarray(bounds.hold(entries)))
    if len(out):
        place = f"[{', '.join(map(str, out[0]))}]" if entries.ndim else ""
        raise refusal(f"{argument}{place}", entries[tuple(out[0])], bounds.expected)


def require_count(argument: str, value: Any, least: int = 1) -> None:
    """Raises ValueError unless `value` is a whole number of at least `least`. True and False are refused."""
    try:
        counts = not isinstance(value, bool | np.bool_) and operator.index(value) >= least
    except (TypeError, jax.errors.TracerIntegerConversionError):
        counts = False
    if not counts:
        raise refusal(argument, value, f"a whole number >= {least}")


def require_instants(argument: str, value: Any) -> None:
    """Raises ValueError unless `value` is a flat list of times after 0; known ones must be finite and increase."""
    wanted = "a flat list of finite times that increase from above 0"
    try:
        shape = np.shape(value)
    except ValueError:
        raise refusal(argument, value, wanted) from None
    if len(shape) != 1 or shape[0] == 0:
        raise refusal(argument, value, wanted)
    if not is_known(value):
        return
    times = np.asarray(value)
    if times.dtype.kind not in "iuf":
        raise refusal(argument, value, wanted)
    wrong = np.flatnonzero(~(np.isfinite(times) & (np.diff(times, prepend=0) > 0)))
    if len(wrong):
        raise refusal(f"{argument}[{wrong[0]}]", times[wrong[0]], wanted)


def require_nodes(argument: str, value: Any) -> None:
    """Raises ValueError unless `value` is a possible number of nodes: even, and at least 4."""
    require_count(argument, value, 4)
    if value % 2:
        raise refusal(argument, value, "an even number of nodes")


class Bounded(eqx.Module):
    """A pytree whose numbers have bounds; `bounds` has them by the name of the field. A number may be None.

    Raises:
        ValueError: a known number is out of its bounds.
    """

    bounds: ClassVar[dict[str, Bounds]] = {}

    def __check_init__(self):
        for name, limits in self.bounds.items():
            if getattr(self, name) is not None:
                require(f"{type(self).__name__}.{name}", getattr(self, name), limits)

    def is_within_bounds(self) -> Bool[Array, ""]:
        """Returns whether all numbers are within their bounds; may be traced."""
        given = {name: limits for name, limits in self.bounds.items() if getattr(self, name) is not None}
        found = [jnp.all(limits.hold(getattr(self, name))) for name, limits in given.items()]
        return jnp.all(jnp.stack(found)) if found else jnp.array(True)
