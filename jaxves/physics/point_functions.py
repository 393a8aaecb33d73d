"""Functions of one point and the time that users write for imposed flows and fields: evaluation, checks, steep times.

A time step that begins and ends outside of a short pulse does not see it. The built-in factors of time therefore state
their kinks, where steps end. A function of the user's own can state them as well. Its steepest changes are also found
from samples at equally spaced times, so that no step passes over a large part of all that changes.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..base.arguments import is_known, refusal
from ..base.own_functions import number, require_returned
from ..numerics.arrays import ScalarLike, VesiclePoints, as_float
from .waveform import later

PointFunction = Callable[[Array, Array], Array]

SAMPLES = 1009  # of a run; a prime, so that samples do not coincide with saved times
PARTS = 32  # of all changes in time; a step passes over at most one of them

_POINTS = ((0.3, 0.2), (-1.1, 0.7), (0.6, -1.3), (-0.4, -0.9))


class OwnFunction(eqx.Module):
    """A function of one point (2,) and the time as part of a scene, with its arrays apart from the rest of it.

    It may have a method `breakpoints()` that returns the times (B,) at which it is not smooth, like factors of time.
    """

    arrays: Any
    rest: Any = eqx.field(static=True)

    def __init__(self, function: PointFunction):
        self.arrays, self.rest = eqx.partition(function, eqx.is_array)

    @property
    def function(self) -> PointFunction:
        """The function of one point."""
        return eqx.combine(self.arrays, self.rest)

    def breakpoints(self) -> Float[Array, "B"]:
        """Returns the times at which the function says that it is not smooth. Time steps end there."""
        stated = getattr(self.function, "breakpoints", None)
        return jnp.zeros(0) if stated is None else later(as_float(stated()))

    def steep_times(self, x: VesiclePoints, t_end: ScalarLike) -> Float[Array, "S"]:
        """Returns times between 0 and `t_end` at which steps must end, so that they see how the function changes.

        It is sampled at `SAMPLES` + 1 equally spaced times at eight nodes of each vesicle. The changes from one time to
        the next, at the node where they are largest, are divided into `PARTS` equal parts. The times are the middles of
        these parts, and both ends of an interval with more than one part, such as that of a jump. All are zero, which
        is no end of a step, for a function that is constant in time. They have no derivatives.

        A pulse between two samples is not found, and one with less than one part of all changes may not be found.
        """
        function, x, t_end = lax.stop_gradient((self, as_float(x), as_float(t_end)))
        x = x[:, :: max(1, x.shape[1] // 8)]
        times = t_end * jnp.arange(SAMPLES + 1) / SAMPLES
        values = lax.map(lambda t: at_points(function.function, x, t), times)
        changes = jnp.max(jnp.abs(jnp.diff(values, axis=0)), axis=(1, 2, 3))
        changes = jnp.where(jnp.isfinite(changes), changes, 0.0)
        passed = jnp.cumsum(changes)
        ends = jnp.searchsorted(passed, passed[-1] * (jnp.arange(PARTS) + 0.5) / PARTS)
        begins = jnp.where(changes[ends] * PARTS > passed[-1], times[ends], 0.0)
        return jnp.where(passed[-1] > 0, jnp.concatenate([begins, times[ends + 1]]), 0.0)

    def require_breakpoints(self, argument: str) -> None:
        """Raises ValueError if the function states times that are no array (B,) of finite numbers."""
        stated = getattr(self.function, "breakpoints", None)
        times = None if stated is None else stated()
        if times is not None and is_known(times):
            found = np.asarray(times)
            if found.ndim != 1 or found.dtype.kind not in "iuf" or not np.all(np.isfinite(found)):
                raise refusal(f"{argument}.breakpoints()", times, "the times at which it is not smooth, (B,)")


def at_points(function: PointFunction, x: Float[Array, "*batch 2"], t: ScalarLike) -> Float[Array, "*batch 2"]:
    """Returns the vectors that `function` gives at the points x (..., 2)."""
    points = jnp.reshape(x, (-1, 2))
    return jnp.reshape(jax.vmap(function, in_axes=(0, None))(points, t), x.shape)


def require_vector(argument: str, function: PointFunction, kind: str, symbol: str) -> None:
    """Raises ValueError unless JAX can trace `function`, and it returns two numbers for one point and a time.

    Args:
        argument: its name in the message.
        function: the function of one point (2,) and the time.
        kind: what it gives, such as "velocity".
        symbol: the letter for it, such as "v".
    """
    returned = f"that returns the {kind} there as one array (2,), such as jax.numpy.array([{symbol}_x, {symbol}_y])"
    expected = f"a function {symbol}(x, t) in JAX of one point (2,) {returned}"
    require_returned(argument, function, number(2), number(), shapes=[(2,)], expected=expected)


def require_without(argument: str, function: PointFunction, **sums: str) -> None:
    """Raises ValueError unless sums of the derivatives of `function` vanish at a few points.

    Args:
        argument: its name in the message.
        function: a function that `require_vector` accepts.
        sums: "divergence" or "curl", with what is expected of a function that has none.
    """
    for t in (0.0, 0.37):
        with jax.ensure_compile_time_eval():  # a scene may be made in a function that is being compiled
            gradient = jax.vmap(jax.jacfwd(function), in_axes=(0, None))(jnp.array(_POINTS), jnp.asarray(t))
        gradient = np.asarray(gradient)
        for name, expected in sums.items():
            parts = gradient if name == "divergence" else gradient[:, :, ::-1] * np.array([[1.0], [-1.0]])
            found = np.abs(np.trace(parts, axis1=1, axis2=2))
            worst = int(np.argmax(found))
            if not np.all(found <= 1e-8 * (1 + np.abs(gradient).max())):
                where = f"{name} {found[worst]:.3g} at x = {list(_POINTS[worst])}, t = {t}"
                raise refusal(argument, where, expected)
