"""Which membranes are near each other, in memory that grows with their number and not with its square.

For every target the sources whose circumscribed circles come nearest are candidates, a fixed number of them; the
distance of nodes then decides. What is found fills a list of fixed length, so that compiled code knows its size;
where candidates or list do not suffice, `overflow` says so.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from ..geometry.curve import Curve
from .interactions import is_near_curve

_CANDIDATES = 3  # for every pair that there is room for: circles of slender vesicles overlap where these do not


class NearPairs(eqx.Module):
    """Ordered pairs in need of close evaluation; rows that are not `valid` hold no pair."""

    target: Int[Array, "K"]
    source: Int[Array, "K"]
    valid: Bool[Array, "K"]
    overflow: Bool[Array, ""]

    @classmethod
    def of(cls, curves: Curve, per_vesicle: int, near: float) -> "NearPairs":
        """The pairs closer than `near` node spacings; room is for `per_vesicle` sources for each target on average."""
        curves = jax.lax.stop_gradient(curves)
        M = curves.x.shape[0]
        candidates = min(_CANDIDATES * per_vesicle, M - 1)
        center = jnp.mean(curves.x, axis=1)
        radius = jnp.sqrt(jnp.max(jnp.sum((curves.x - center[:, None]) ** 2, axis=-1), axis=1))
        reach = radius + (near + 1) * jnp.max(curves.weights, axis=1)

        def of_target(i):
            gap = jnp.sqrt(jnp.sum((center - center[i]) ** 2, axis=-1)) - radius[i] - reach
            gap = jnp.where(jnp.arange(M) == i, jnp.inf, gap)
            least, source = jax.lax.top_k(-gap, candidates)
            sources = jax.tree.map(lambda leaf: leaf[source], curves)
            close = jax.vmap(lambda source: is_near_curve(source, curves.x[i], near))(sources)
            return source, (least > 0) & close, jnp.sum(gap < 0) > candidates

        source, close, too_many = jax.lax.map(of_target, jnp.arange(M))
        room = min(per_vesicle, M - 1) * M
        target, place = jnp.nonzero(close, size=room, fill_value=0)
        found = jnp.sum(close)
        return cls(target, source[target, place], jnp.arange(room) < found, jnp.any(too_many) | (found > room))

    def sources_of(self, target: Int[Array, ""], M: int) -> Bool[Array, "M"]:
        """Which of the M membranes are near `target`."""
        return jnp.zeros(M, bool).at[self.source].max(self.valid & (self.target == target))
