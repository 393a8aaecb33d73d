"""Search for close pairs of membranes, with memory that grows like their number and not like its square.

For every target, a fixed number of sources whose circumscribed circles come near are candidates. The distance of their
nodes then decides. The pairs are stored in a list of fixed length, because compiled code needs a fixed size. `overflow`
says that there were too few candidates or that the list was too short.
"""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int, PyTree

from ..ewald.lists import circles, images_near, packed
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Cell
from ..numerics.valid_rows import over_valid
from .interactions import is_near_curve

_CANDIDATES = 3  # candidates per stored pair; circles of slender vesicles overlap more often than the vesicles
_CHUNK = 16  # pairs that are multiplied at once


class NearPairs(eqx.Module):
    """The ordered pairs that need close evaluation. The valid rows come first; the others are unused.

    In a periodic cell, the source is its image at x + m₁ a₁ + m₂ a₂ with the integers m of `image`.
    """

    target: Int[Array, "K"]
    source: Int[Array, "K"]
    valid: Bool[Array, "K"]
    overflow: Bool[Array, ""]
    image: Int[Array, "K 2"] | None = None

    @classmethod
    def of(cls, curves: Curve, per_vesicle: int, near: float, domain: AbstractDomain) -> "NearPairs":
        """Finds the pairs that are closer than `near` node spacings, images of a vesicle near itself included.

        There is room for `per_vesicle` sources per target on average.
        """
        curves, domain = lax.stop_gradient((curves, domain))
        M = curves.x.shape[0]
        lattice = domain.lattice if isinstance(domain, Cell) else None
        others = M - 1 if lattice is None else 9 * M - 1
        candidates = min(_CANDIDATES * per_vesicle, others)
        found = _candidates(curves, candidates, near, domain)
        *pairs, valid = (leaf.reshape(M * candidates, *leaf.shape[2:]) for leaf in found[:-1])
        pairs = jnp.repeat(jnp.arange(M), candidates), *pairs

        def is_close(row):
            (target, source, image), valid = row

            def close():
                curve = _moved(jax.tree.map(lambda leaf: leaf[source], curves), image, lattice)
                return is_near_curve(curve, curves.x[target], near)

            return lax.cond(valid, close, lambda: jnp.array(False))

        close = lax.map(is_close, (pairs, valid))
        room = min(per_vesicle, others) * M
        (row,) = jnp.nonzero(close, size=room, fill_value=0)
        target, source, image = (leaf[row] for leaf in pairs)
        count = jnp.sum(close)
        overflow = jnp.any(found[-1]) | (count > room)
        return cls(target, source, jnp.arange(room) < count, overflow, None if lattice is None else image)

    def sources_of(self, target: Int[Array, ""], M: int) -> Bool[Array, "M"]:
        """Returns which of the M membranes are near `target`."""
        return jnp.zeros(M, bool).at[self.source].max(self.valid & (self.target == target))

    def source_curve(self, k: Int[Array, ""], curves: Curve, domain: AbstractDomain) -> Curve:
        """Returns the source of the pair k, moved to its image."""
        curve = jax.tree.map(lambda leaf: leaf[self.source[k]], curves)
        return curve if self.image is None else _moved(curve, self.image[k], domain.lattice)

    def summed(
        self,
        product: Callable[[PyTree, Float[Array, "k N *rest"]], Float[Array, "k N 2"]],
        matrices: PyTree,
        density: Float[Array, "M N *rest"],
    ) -> Float[Array, "M N 2"]:
        """Returns, at each target, the sum of `product(matrices, density)` over the near pairs.

        `matrices` has the pairs along its first axis, and zeros for unused ones. Parts of the list without valid pairs
        are left out, so that room that is not needed costs little.
        """
        size = math.gcd(self.valid.shape[0], _CHUNK)

        def of_part(part, density):
            source, matrices = part
            return product(matrices, density[source])

        values = over_valid(of_part, self.valid, (self.source, matrices), density, size)
        return jnp.zeros((*density.shape[:2], 2)).at[self.target].add(values.reshape(-1, *values.shape[2:]))


def _moved(curve: Curve, image: Int[Array, "2"], lattice: Float[Array, "2 2"] | None) -> Curve:
    if lattice is None:
        return curve
    return eqx.tree_at(lambda curve: curve.x, curve, curve.x + image @ lattice)


def _candidates(curves: Curve, room: int, near: float, domain: AbstractDomain):
    """Returns sources and images (M, room) near each target, which of them are valid, and whether room was short."""
    M = curves.x.shape[0]
    vesicles = center, radius = circles(curves.x)
    reach = radius + (near + 1) * jnp.max(curves.weights, axis=1)

    def of_target(i):
        image = images_near((center[i], radius[i]), vesicles, domain, 1)
        apart = center[i] - center[:, None]
        if isinstance(domain, Cell):
            apart = apart - image @ domain.lattice
        within = jnp.sqrt(jnp.sum(apart**2, axis=-1)) < radius[i] + reach[:, None]
        itself = (jnp.arange(M) == i)[:, None] & jnp.all(image == 0, axis=-1)
        chosen, valid, count = packed(within & ~itself, room)
        source, which = jnp.divmod(chosen, image.shape[1])
        return source, image[source, which], valid, count > room

    return lax.map(of_target, jnp.arange(M))
