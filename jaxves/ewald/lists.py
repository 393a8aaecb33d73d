"""Which clusters of nodes are within r_c of one another, images in a periodic cell included.

For every vesicle, the others are found whose circumscribed circles are within reach, and among their clusters those
within reach of each of its own clusters. Pairs that are computed otherwise, such as a vesicle with itself, are left
out. The pairs of clusters of all vesicles are one list, because few have as many as there may be. It has a fixed
length. `overflow` says that it was too short, so that the sums would be wrong.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from ..geometry.domain import AbstractDomain, Cell
from ..numerics.arrays import Scalar, VesiclePoints
from .plans import Plan


class Excluded(eqx.Module):
    """Pairs of a target vesicle and an image of a source vesicle; `image` is None in the plane.

    The vesicle at the nodes x has its image m at x + m₁ a₁ + m₂ a₂. Rows that are not `valid` are unused.
    """

    target: Int[Array, "K"]
    source: Int[Array, "K"]
    image: Int[Array, "K 2"] | None
    valid: Bool[Array, "K"]


class Lists(eqx.Module):
    """The pairs of a target cluster and an image of a source cluster within reach; `image` is None in the plane.

    The valid pairs come first, ordered by their targets.
    """

    target: Int[Array, "T"]
    source: Int[Array, "T"]
    image: Int[Array, "T 2"] | None
    valid: Bool[Array, "T"]
    overflow: Bool[Array, ""]

    @classmethod
    def of(cls, x: VesiclePoints, r_c: Scalar, plan: Plan, domain: AbstractDomain, excluded: Excluded) -> "Lists":
        """Finds the clusters. A vesicle and itself, not its images, are left out without being in `excluded`."""
        x, r_c, domain, excluded = lax.stop_gradient((x, r_c, domain, excluded))
        M, N, _ = x.shape
        per, n = N // plan.cluster, plan.cluster
        lattice = domain.lattice if isinstance(domain, Cell) else None
        vesicles, clusters = circles(x), circles(x.reshape(M, per, n, 2))

        def of_vesicle(i):
            own = jax.tree.map(lambda leaf: leaf[i], vesicles)
            image = images_near(own, vesicles, domain, plan.images)
            within = _are_within(own, vesicles, image, lattice, r_c) & ~_left_out(i, image, excluded)
            chosen, valid, count = packed(within, plan.vesicles)
            source, which = jnp.divmod(chosen, image.shape[1])
            image = image[source, which]
            theirs = jax.tree.map(lambda leaf: leaf[source], clusters)

            def of_cluster(own):
                near = _are_within(own, theirs, image[:, None, None], lattice, r_c)[..., 0] & valid[:, None]
                return packed(near, plan.room)

            place, valid_clusters, counts = jax.vmap(of_cluster)(jax.tree.map(lambda leaf: leaf[i], clusters))
            row, cluster = jnp.divmod(place, per)
            found = source[row] * per + cluster, image[row], valid_clusters
            return *found, (count > plan.vesicles) | jnp.any(counts > plan.room)

        *found, valid, overflow = lax.map(of_vesicle, jnp.arange(M))
        pair, kept, count = packed(valid, plan.pairs(M * per))
        source, image = (leaf.reshape(M * per * plan.room, -1)[pair] for leaf in found)
        overflow = jnp.any(overflow) | (count > pair.size) | _reaches_farther(vesicles, domain, plan.images, r_c)
        return cls(pair // plan.room, source[:, 0], None if lattice is None else image, kept, overflow)


def circles(x: Float[Array, "*groups n 2"]) -> tuple[Float[Array, "*groups 2"], Float[Array, "*groups"]]:
    """Returns centres and radii of circles that contain n points each."""
    center = jnp.mean(x, axis=-2)
    return center, jnp.sqrt(jnp.max(jnp.sum((x - center[..., None, :]) ** 2, axis=-1), axis=-1))


def images_near(own, others, domain: AbstractDomain, reach: int) -> Int[Array, "M images 2"]:
    """Returns the images of all vesicles nearest to one, and `reach` more on each side."""
    centers, _ = others
    if not isinstance(domain, Cell):
        return jnp.zeros((centers.shape[0], 1, 2), jnp.int32)
    steps = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    return domain.nearest_image(own[0], centers)[:, None] + steps.astype(np.int32)


def _are_within(own, others, image, lattice, r_c) -> Bool[Array, "..."]:
    """Returns whether circles of others, moved by images, are within r_c of one circle."""
    (center, radius), (centers, radii) = own, others
    apart = center - centers[..., None, :]
    if lattice is not None:
        apart = apart - image @ lattice
    return jnp.sqrt(jnp.sum(apart**2, axis=-1)) < r_c + radius + radii[..., None]


def _left_out(i, image: Int[Array, "M images 2"], excluded: Excluded) -> Bool[Array, "M images"]:
    """Returns which images of all vesicles are not in the lists of vesicle i."""
    M, images, _ = image.shape
    mine = excluded.valid & (excluded.target == i)
    if excluded.image is None:
        out = jnp.zeros(M, bool).at[excluded.source].max(mine)[:, None]
    else:
        matched = jnp.all(image[excluded.source] == excluded.image[:, None], axis=-1) & mine[:, None]
        out = jnp.zeros((M, images), bool).at[excluded.source].max(matched)
    return out | ((jnp.arange(M) == i)[:, None] & jnp.all(image == 0, axis=-1))


def packed(wanted: Bool[Array, "..."], room: int) -> tuple[Int[Array, "room"], Bool[Array, "room"], Int[Array, ""]]:
    """Returns the flat indices of the first `room` true entries, which of them there are, and how many there are."""
    wanted = wanted.reshape(-1)
    place = jnp.cumsum(wanted) - 1
    target = jnp.where(wanted & (place < room), place, room)
    found = jnp.zeros(room + 1, jnp.int32).at[target].set(jnp.arange(wanted.size, dtype=jnp.int32))[:room]
    count = place[-1] + 1
    return found, jnp.arange(room) < count, count


def _reaches_farther(vesicles, domain: AbstractDomain, images: int, r_c) -> Bool[Array, ""]:
    """Returns whether images that were not looked at may be within reach."""
    if not isinstance(domain, Cell):
        return jnp.array(False)
    _, radius = vesicles
    return (images + 0.5) * jnp.min(domain.heights()) < r_c + 2 * jnp.max(radius)
