"""Outlines of vesicles as polygons, without JAX: are they curves at all, and clear of each other?

A curve through exact points is a periodic quintic spline over chord length; a curve through noisy ones is a truncated
Fourier series (`outline_fit`).
"""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from shapely import LinearRing, Polygon, affinity

from . import outline_fit

_FINE = 1024  # samples of an outline; as a polygon it is true to 5e-6 of its radius
_TOUCH = 1e-4  # in units of a: nearer is touching
_FEWEST = 8  # points that can be called a shape
_ROUGHEST = 0.02  # noise over the radius, above which the number of modes is not chosen


class OutlineNoise(UserWarning):
    """Points carry noise, and the number of Fourier modes that is kept of them was chosen."""


class Outline(NamedTuple):
    """Points in counter-clockwise order, (K, 2), and how many of their Fourier modes are kept; None for all of them."""

    points: Float[np.ndarray, "K 2"]
    modes: int | None


def prepared(points: Float[np.ndarray, "K 2"], modes: int | None = None, lines: Sequence[int] | None = None) -> Outline:
    """The outline through these points: closed, counter-clockwise, each point once, and smooth where they are noisy.

    Where `modes` is not given it is chosen from the noise of the points, with a warning (OutlineNoise); exact points
    keep all modes. `lines` are the lines of a file on which the points stand, for complaints.

    Raises:
        ValueError: the points are too few, not finite, coincide, or give a curve that crosses itself. The message says
            what was expected.
    """
    where = [f"line {line}" for line in lines] if lines else [f"point {k}" for k in range(len(points))]
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        raise ValueError(f"finite numbers ({where[int(np.argmin(finite))]} has others)")
    fresh = np.any(points != np.roll(points, -1, axis=0), axis=1)  # a closed or lingering outline repeats points
    points, where = points[fresh], [name for name, new in zip(where, fresh, strict=True) if new]
    if len(points) < _FEWEST:
        raise ValueError(f"at least {_FEWEST} points, not {len(points)}")
    if modes is not None and 2 * modes + 1 > len(points):
        raise ValueError(f"at least {2 * modes + 1} points for modes = {modes}, not {len(points)}")
    if modes is None:
        modes = _chosen(points)
    if modes is None:
        _check_points(points, where)
    x, y = points.T
    if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0:
        points, where = points[::-1], where[::-1]
    curve = smooth(points, modes)
    if Polygon(curve).area < 1e-6 * LinearRing(curve).length ** 2:
        raise ValueError("points that enclose an area")
    if (found := crossing(curve)) is not None:
        place = found.place
        raise ValueError(
            "points through which a smooth curve does not cross itself: it does near "
            f"({place[0]:.5g}, {place[1]:.5g}), so take points closer there, or more evenly, or fewer `modes`"
        )
    return Outline(points, modes)


def _chosen(points: Float[np.ndarray, "K 2"]) -> int | None:
    """The number of modes that noisy points support, with a warning; None for exact ones."""
    noise = outline_fit.noise_of(points)
    if noise is None:
        return None
    size = f"by {noise.deviation:.2g} along their normal, {noise.deviation / noise.radius:.1%} of the radius"
    if noise.deviation > _ROUGHEST * noise.radius:
        raise ValueError(
            f"points with less noise (they scatter {size}): average them, or say with `modes` what to keep"
        )
    warnings.warn(
        f"the points of the outline scatter {size}: {noise.modes} Fourier modes are kept; `modes` sets another number",
        OutlineNoise,
        stacklevel=4,
    )
    return noise.modes


def _check_points(points: Float[np.ndarray, "K 2"], where: list[str]) -> None:
    _, first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)
    repeated = np.flatnonzero(first[same.ravel()] != np.arange(len(points)))
    if repeated.size:
        k = repeated[0]
        raise ValueError(f"distinct points ({where[first[same.ravel()[k]]]} and {where[k]} coincide)")
    if (found := crossing(points)) is not None:
        i, j, place = found
        after = [where[(k + 1) % len(points)] for k in (i, j)]
        raise ValueError(
            f"a curve that does not cross itself: it does at ({place[0]:.5g}, {place[1]:.5g}), "
            f"between {where[i]} and {after[0]}, and between {where[j]} and {after[1]}"
        )


class Crossing(NamedTuple):
    """Two edges of a polygon that cross, each named by its first point, and where they do."""

    first: int
    second: int
    place: tuple[float, float]


def crossing(points: Float[np.ndarray, "K 2"]) -> Crossing | None:
    """The first crossing of a closed polygon with itself; None for a simple one."""
    if LinearRing(points).is_simple:
        return None
    K = len(points)
    edges = shapely.linestrings(np.stack([points, np.roll(points, -1, axis=0)], axis=1))
    pairs = shapely.STRtree(edges).query(edges, predicate="intersects").T
    apart = [(int(i), int(j)) for i, j in pairs if 1 < j - i < K - 1]
    if not apart:  # neighbouring edges that lie upon each other
        return Crossing(0, 1, (float(points[1, 0]), float(points[1, 1])))
    i, j = min(apart)
    place = shapely.centroid(shapely.intersection(edges[i], edges[j]))
    return Crossing(i, j, (float(place.x), float(place.y)))


def smooth(points: Float[np.ndarray, "K 2"], modes: int | None = None) -> Float[np.ndarray, "1024 2"]:
    """Samples of the smooth closed curve through the points, or near them with this many Fourier modes."""
    if modes is not None:
        return outline_fit.fitted(points, modes, _FINE).samples
    from scipy.interpolate import make_interp_spline

    closed = np.vstack([points, points[:1]])
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    spline = make_interp_spline(chord, closed, k=5, bc_type="periodic")
    return spline(np.linspace(0, chord[-1], _FINE, endpoint=False))


def circle_polygon() -> Polygon:
    """Of radius 1."""
    return _ellipse(1.0)


def ellipse_polygon(reduced_area: float) -> Polygon:
    """Major axis along x; of any size."""
    from scipy.optimize import brentq
    from scipy.special import ellipe

    def excess(ratio):
        # 4πA/L² with A = π b/a and L = 4 E(1 - (b/a)²)
        return 4 * np.pi**2 * ratio / (4 * ellipe(1 - ratio**2)) ** 2 - reduced_area

    return _ellipse(brentq(excess, 0.0, 1.0) if reduced_area < 1 else 1.0)


def _ellipse(ratio: float) -> Polygon:
    alpha = np.linspace(0, 2 * np.pi, _FINE, endpoint=False)
    return Polygon(np.stack([np.cos(alpha), ratio * np.sin(alpha)], axis=-1))


def placed(polygon: Polygon, length: float, angle: float, center: tuple[float, float]) -> Polygon:
    """Perimeter 2π·`length`, turned by `angle` degrees, centroid at `center`."""
    factor = 2 * np.pi * length / polygon.length
    polygon = affinity.scale(polygon, factor, factor, origin="centroid")
    polygon = affinity.rotate(polygon, angle, origin="centroid")
    return affinity.translate(polygon, center[0] - polygon.centroid.x, center[1] - polygon.centroid.y)


def first_touching(polygons: list[Polygon]) -> tuple[int, int] | None:
    """The first two that overlap, contain one another or touch, if any do."""
    tree = shapely.STRtree(polygons)
    pairs = tree.query(polygons, predicate="dwithin", distance=_TOUCH).T
    touching = sorted((int(i), int(j)) for i, j in pairs if i < j)
    return touching[0] if touching else None
