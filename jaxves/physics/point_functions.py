"""Functions of one point and the time that users write for imposed flows and fields: evaluation, and checks."""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.arguments import refusal
from ..numerics.arrays import ScalarLike

PointFunction = Callable[[Array, Array], Array]

_POINTS = ((0.3, 0.2), (-1.1, 0.7), (0.6, -1.3), (-0.4, -0.9))


class OwnFunction(eqx.Module):
    """A function of one point (2,) and the time as part of a scene, with its arrays apart from the rest of it."""

    arrays: Any
    rest: Any = eqx.field(static=True)

    def __init__(self, function: PointFunction):
        self.arrays, self.rest = eqx.partition(function, eqx.is_array)

    @property
    def function(self) -> PointFunction:
        """The function of one point."""
        return eqx.combine(self.arrays, self.rest)


def at_points(function: PointFunction, x: Float[Array, "*batch 2"], t: ScalarLike) -> Float[Array, "*batch 2"]:
    """Returns the vectors that `function` gives at the points x (..., 2)."""
    points = jnp.reshape(x, (-1, 2))
    return jnp.reshape(jax.vmap(function, in_axes=(0, None))(points, t), x.shape)


def require_without(argument: str, function: PointFunction, kind: str, symbol: str, **sums: str) -> None:
    """Raises ValueError unless `function` gives two numbers, and sums of its derivatives vanish at a few points.

    Args:
        argument: its name in the message.
        function: the function of one point (2,) and the time.
        kind: what it gives, such as "velocity".
        symbol: the letter for it, such as "v".
        sums: "divergence" or "curl", with what is expected of a function that has none.
    """
    for t, points, gradient in _gradients(argument, function, kind, symbol):
        for name, expected in sums.items():
            parts = gradient if name == "divergence" else gradient[:, :, ::-1] * np.array([[1.0], [-1.0]])
            found = np.abs(np.trace(parts, axis1=1, axis2=2))
            worst = int(np.argmax(found))
            if not np.all(found <= 1e-8 * (1 + np.abs(gradient).max())):
                where = f"{name} {found[worst]:.3g} at x = {list(points[worst])}, t = {t}"
                raise refusal(argument, where, expected)


def _gradients(argument, function, kind, symbol) -> Iterator[tuple[float, tuple, np.ndarray]]:
    """Yields times, points (4, 2) and the derivatives (4, 2, 2) of the function there."""
    for t in (0.0, 0.37):
        try:
            gradient = jax.vmap(jax.jacfwd(function), in_axes=(0, None))(jnp.array(_POINTS), jnp.asarray(t))
        except (TypeError, IndexError) as error:
            raise refusal(argument, error, f"a function {symbol}(x, t) in JAX of one point (2,)") from None
        if gradient.shape != (4, 2, 2):
            raise refusal(argument, f"a function with values {gradient.shape[1:-1]}", f"the {kind} of one point, (2,)")
        yield t, _POINTS, np.asarray(gradient)
