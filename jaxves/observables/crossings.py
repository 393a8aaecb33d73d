"""Whether curves cross themselves or each other, by the polygons of their nodes."""

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Cell
from ..operators.interactions import NEAR, over_pairs
from ..operators.near_pairs import NearPairs

_NEIGHBOURS = 8  # near pairs per vesicle that are compared in a cell; more of them end a run as crowded


def _crossings(first: Curve, second: Curve) -> Array:
    """Returns which edges of the polygon of nodes of one curve intersect which edges of another, (N, N)."""

    def ends(curve):
        return curve.x, jnp.roll(curve.x, -1, axis=0)

    def side(a, b, c):
        """Returns twice the signed area of the triangle a, b, c for all edges (a, b) and all points c."""
        u, v = (b - a)[:, None], c[None] - a[:, None]
        return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]

    (p, q), (r, s) = ends(first), ends(second)
    return (side(p, q, r) * side(p, q, s) < 0) & (side(r, s, p) * side(r, s, q) < 0).T


def crosses_itself(curve: Curve) -> Array:
    """Returns whether two edges of the polygon of nodes intersect."""
    # Neighbouring edges share an end, so their products are zero up to round-off. They are left out.
    N = curve.x.shape[0]
    steps = jnp.abs(jnp.arange(N)[:, None] - jnp.arange(N)[None])
    return jnp.any(_crossings(curve, curve) & (jnp.minimum(steps, N - steps) > 1))


def _is_inside(point: Array, curve: Curve) -> Array:
    """Returns whether the polygon of nodes encloses a point or has it on an edge, by the angle it turns about it."""
    a, b = curve.x - point, jnp.roll(curve.x, -1, axis=0) - point
    cross, dot = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], jnp.sum(a * b, axis=-1)
    nothing = (cross == 0) & (dot == 0)
    turned = jnp.sum(jnp.arctan2(jnp.where(nothing, 0.0, cross), jnp.where(nothing, 1.0, dot)))
    return jnp.abs(turned) > 0.5 * jnp.pi


def collides(curves: Curve, domain: AbstractDomain) -> Array:
    """Returns whether the polygons of any two vesicles intersect or coincide, or one contains the other.

    In a periodic cell only near pairs are compared, also a vesicle with its own images.
    """

    def of_pair(first, second):
        return jnp.any(_crossings(first, second)) | _is_inside(first.x[0], second) | _is_inside(second.x[0], first)

    if not isinstance(domain, Cell):
        return jnp.any(over_pairs(of_pair, curves))
    near = NearPairs.of(curves, _NEIGHBOURS, NEAR, domain)

    def overlaps(k):
        target = jax.tree.map(lambda leaf: leaf[near.target[k]], curves)
        return near.valid[k] & of_pair(target, near.source_curve(k, curves, domain))

    return jnp.any(jax.lax.map(overlaps, jnp.arange(near.valid.shape[0])))
