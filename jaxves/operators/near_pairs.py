"""Search for close pairs of membranes, with memory that grows like their number and not like its square.

For every target, a fixed number of sources with the nearest circumscribed circles are candidates. The distance of their
nodes then decides. The pairs are stored in a list of fixed length, because compiled code needs a fixed size. `overflow`
says that there were too few candidates or that the list was too short.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Cell, Free
from .interactions import is_near_curve

_CANDIDATES = 3  # candidates per stored pair; circles of slender vesicles overlap more often than the vesicles


class NearPairs(eqx.Module):
    """The ordered pairs that need close evaluation; rows that are not `valid` are unused.

    In a periodic cell, the source is its image at x + m₁ a₁ + m₂ a₂ with the integers m of `image`.
    """

    target: Int[Array, "K"]
    source: Int[Array, "K"]
    valid: Bool[Array, "K"]
    overflow: Bool[Array, ""]
    image: Int[Array, "K 2"] | None = None

    @classmethod
    def of(cls, curves: Curve, per_vesicle: int, near: float, domain: AbstractDomain) -> "NearPairs":
        """Finds the pairs that are closer than `near` node spacings.

        There is room for `per_vesicle` sources per target on average.
        """
        curves, domain = jax.lax.stop_gradient((curves, domain))
        if isinstance(domain, Cell):
            return _in_cell(curves, per_vesicle, near, domain)
        M = curves.x.shape[0]
        candidates = min(_CANDIDATES * per_vesicle, M - 1)
        center = jnp.mean(curves.x, axis=1)
        radius = jnp.sqrt(jnp.max(jnp.sum((curves.x - center[:, None]) ** 2, axis=-1), axis=1))
        reach = radius + (near + 1) * jnp.max(curves.weights, axis=1)

        def of_target(i):
            gap = jnp.sqrt(jnp.sum(domain.displacement(center, center[i]) ** 2, axis=-1)) - radius[i] - reach
            gap = jnp.where(jnp.arange(M) == i, jnp.inf, gap)
            least, source = jax.lax.top_k(-gap, candidates)
            sources = jax.tree.map(lambda leaf: leaf[source], curves)
            close = jax.vmap(lambda source: is_near_curve(source, curves.x[i], near, domain))(sources)
            return source, (least > 0) & close, jnp.sum(gap < 0) > candidates

        source, close, too_many = jax.lax.map(of_target, jnp.arange(M))
        room = min(per_vesicle, M - 1) * M
        target, place = jnp.nonzero(close, size=room, fill_value=0)
        found = jnp.sum(close)
        return cls(target, source[target, place], jnp.arange(room) < found, jnp.any(too_many) | (found > room))

    def sources_of(self, target: Int[Array, ""], M: int) -> Bool[Array, "M"]:
        """Returns which of the M membranes are near `target`."""
        return jnp.zeros(M, bool).at[self.source].max(self.valid & (self.target == target))

    def source_curve(self, k: Int[Array, ""], curves: Curve, domain: AbstractDomain) -> Curve:
        """Returns the source of the pair k, moved to its image."""
        curve = jax.tree.map(lambda leaf: leaf[self.source[k]], curves)
        if self.image is None:
            return curve
        return eqx.tree_at(lambda curve: curve.x, curve, curve.x + self.image[k] @ domain.lattice)


def _in_cell(curves: Curve, per_vesicle: int, near: float, cell: Cell) -> NearPairs:
    """Finds the near pairs in a periodic cell, images of a vesicle near itself included."""
    M = curves.x.shape[0]
    candidates = min(_CANDIDATES * per_vesicle, 9 * M - 1)
    center = jnp.mean(curves.x, axis=1)
    radius = jnp.sqrt(jnp.max(jnp.sum((curves.x - center[:, None]) ** 2, axis=-1), axis=1))
    reach = radius + (near + 1) * jnp.max(curves.weights, axis=1)
    steps = np.stack(np.divmod(np.arange(9), 3), axis=-1).astype(np.int32) - 1

    def of_target(i):
        image = cell.nearest_image(center[i], center)[:, None] + steps
        apart = center[i] - center[:, None] - image @ cell.lattice
        gap = jnp.sqrt(jnp.sum(apart**2, axis=-1)) - radius[i] - reach[:, None]
        itself = (jnp.arange(M) == i)[:, None] & jnp.all(image == 0, axis=-1)
        gap = jnp.where(itself, jnp.inf, gap).reshape(-1)
        least, chosen = jax.lax.top_k(-gap, candidates)
        source, image = chosen // 9, image.reshape(-1, 2)[chosen]

        def is_close(source, image):
            curve = jax.tree.map(lambda leaf: leaf[source], curves)
            curve = eqx.tree_at(lambda curve: curve.x, curve, curve.x + image @ cell.lattice)
            return is_near_curve(curve, curves.x[i], near, Free())

        return source, image, (least > 0) & jax.vmap(is_close)(source, image), jnp.sum(gap < 0) > candidates

    source, image, close, too_many = jax.lax.map(of_target, jnp.arange(M))
    room = per_vesicle * M
    target, place = jnp.nonzero(close, size=room, fill_value=0)
    found = jnp.sum(close)
    overflow = jnp.any(too_many) | (found > room)
    return NearPairs(target, source[target, place], jnp.arange(room) < found, overflow, image[target, place])
