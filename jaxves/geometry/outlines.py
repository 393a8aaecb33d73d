"""Checks of outlines as polygons: do they cross themselves, do they touch each other? No JAX.

A curve through exact points is a periodic quintic spline over chord length. A curve near noisy points is a truncated
Fourier series (`outline_fit`).
"""

import sys
import warnings
from collections.abc import Sequence
from types import FrameType
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from shapely import LinearRing, Polygon, affinity

from . import outline_fit

_FINE = 1024  # samples of an outline; the polygon differs from the curve by 5e-6 of the radius
_TOUCH = 1e-4  # two outlines touch if they are closer than this, in units of a
_FEWEST = 8  # least number of points of an outline
_INNER = (__name__.partition(".")[0], "pydantic", "jaxtyping")  # packages between a reader of a scene and this file
_TOLD: set[bytes] = set()  # outlines whose noise was reported by this process; a scene is read several times
_ROUGHEST = 0.02  # largest noise, relative to the radius, for which the number of modes is chosen automatically


class OutlineNoise(UserWarning):
    """The points of an outline are noisy, and the number of Fourier modes was chosen automatically."""


class Outline(NamedTuple):
    """Points (K, 2) in counter-clockwise order, and the number of Fourier modes to keep; None keeps all of them."""

    points: Float[np.ndarray, "K 2"]
    modes: int | None


def prepared(points: Float[np.ndarray, "K 2"], modes: int | None = None, lines: Sequence[int] | None = None) -> Outline:
    """Checks the points of an outline, orders them counter-clockwise, and removes repeated points.

    If `modes` is None, the number of modes of noisy points is chosen from their noise, with a warning (OutlineNoise).
    Exact points keep all modes. `lines` are the line numbers of the points in their file; messages name them.

    Raises:
        ValueError: the points are too few, are not finite or coincide, or their curve crosses itself. The message says
            what was expected.
    """
    where = [f"line {line}" for line in lines] if lines else [f"point {k}" for k in range(len(points))]
    finite = np.isfinite(points).all(axis=1)
    if not finite.all():
        raise ValueError(f"finite numbers ({where[int(np.argmin(finite))]} has others)")
    fresh = np.any(points != np.roll(points, -1, axis=0), axis=1)  # a file may repeat a point, such as the first one
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
    """Returns the number of modes for noisy points, with a warning, or None for exact points."""
    noise = outline_fit.noise_of(points)
    if noise is None:
        return None
    size = f"by {noise.deviation:.2g} along their normal, {noise.deviation / noise.radius:.1%} of the radius"
    if noise.deviation > _ROUGHEST * noise.radius:
        raise ValueError(
            f"points with less noise (they scatter {size}): average them, or say with `modes` what to keep"
        )
    known = points.tobytes()
    if known not in _TOLD:
        warnings.warn(
            f"the points of the outline scatter {size}: {noise.modes} Fourier modes are kept; `modes` sets another "
            "number",
            OutlineNoise,
            stacklevel=_level_outside(sys._getframe()),
        )
        _TOLD.add(known)
    return noise.modes


def _level_outside(frame: FrameType) -> int:
    """Returns the `stacklevel` with which a warning of the function in `frame` names the line that called this package.

    A scene is read by pydantic, which is between that line and this file.
    """
    level = 1
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in _INNER:
        frame, level = frame.f_back, level + 1
    return level


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
    """Two edges of a polygon that cross, each given by its first point, and the place where they cross."""

    first: int
    second: int
    place: tuple[float, float]


def crossing(points: Float[np.ndarray, "K 2"]) -> Crossing | None:
    """Returns the first crossing of a closed polygon with itself, or None for a simple polygon."""
    if LinearRing(points).is_simple:
        return None
    K = len(points)
    edges = shapely.linestrings(np.stack([points, np.roll(points, -1, axis=0)], axis=1))
    pairs = shapely.STRtree(edges).query(edges, predicate="intersects").T
    apart = [(int(i), int(j)) for i, j in pairs if 1 < j - i < K - 1]
    if not apart:  # neighbouring edges overlap
        return Crossing(0, 1, (float(points[1, 0]), float(points[1, 1])))
    i, j = min(apart)
    place = shapely.centroid(shapely.intersection(edges[i], edges[j]))
    return Crossing(i, j, (float(place.x), float(place.y)))


def smooth(points: Float[np.ndarray, "K 2"], modes: int | None = None) -> Float[np.ndarray, "1024 2"]:
    """Returns samples of the smooth closed curve through the points, or of the best one with this many modes."""
    if modes is not None:
        return outline_fit.fitted(points, modes, _FINE).samples
    from scipy.interpolate import make_interp_spline

    closed = np.vstack([points, points[:1]])
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    spline = make_interp_spline(chord, closed, k=5, bc_type="periodic")
    return spline(np.linspace(0, chord[-1], _FINE, endpoint=False))


def measured(points: Float[np.ndarray, "K 2"], modes: int | None = None) -> tuple[float, float]:
    """Returns perimeter / 2π, in the unit of the points, and the reduced area of the curve that `smooth` samples."""
    polygon = Polygon(smooth(points, modes))
    return polygon.length / (2 * np.pi), 4 * np.pi * polygon.area / polygon.length**2


def circle_polygon() -> Polygon:
    """Returns a circle of radius 1."""
    return _ellipse(1.0)


def ellipse_polygon(reduced_area: float) -> Polygon:
    """Returns an ellipse of this reduced area with its major axis along x. Its size is not specified."""
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
    """Returns the polygon with perimeter 2π·`length`, rotated by `angle` degrees, with its centroid at `center`."""
    factor = 2 * np.pi * length / polygon.length
    polygon = affinity.scale(polygon, factor, factor, origin="centroid")
    polygon = affinity.rotate(polygon, angle, origin="centroid")
    return affinity.translate(polygon, center[0] - polygon.centroid.x, center[1] - polygon.centroid.y)


def first_touching(polygons: list[Polygon], lattice=None) -> tuple[int, int] | None:
    """Returns the indices of the first two polygons that overlap, contain one another or touch, or None.

    With the two vectors of a `lattice`, polygons also must not touch images of others, nor their own, whose pair of
    indices is twice the same.
    """
    M, images = len(polygons), list(polygons)
    if lattice is not None:
        steps = [(m, n) for m in (-1, 0, 1) for n in (-1, 0, 1) if (m, n) != (0, 0)]
        home = [_home(polygon, lattice) for polygon in polygons]
        polygons, images = home, list(home)
        for m, n in steps:
            images += [affinity.translate(p, *(m * a + n * b for a, b in zip(*lattice, strict=True))) for p in home]
    tree = shapely.STRtree(images)
    pairs = tree.query(polygons, predicate="dwithin", distance=_TOUCH).T
    touching = sorted((int(i), int(j) % M) for i, j in pairs if i < j)
    return touching[0] if touching else None


def _home(polygon: Polygon, lattice) -> Polygon:
    """Returns the image of a polygon whose centroid is in the cell next to the origin."""
    place = np.floor(np.linalg.solve(np.transpose(lattice), polygon.centroid.coords[0]))
    return affinity.translate(polygon, *(-place @ np.array(lattice)))
