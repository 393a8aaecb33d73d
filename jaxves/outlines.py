"""Outlines of vesicles as polygons, without JAX: are they curves at all, and clear of each other?

A curve through given points is a periodic quintic spline over chord length.
"""

from pathlib import Path

import numpy as np
import shapely
from jaxtyping import Float
from shapely import LinearRing, Polygon, affinity

_FINE = 1024  # samples of an outline; as a polygon it is true to 5e-6 of its radius
_TOUCH = 1e-4  # in units of a: nearer is touching
_FEWEST = 8  # points that can be called a shape


def read_points(path: Path) -> Float[np.ndarray, "K 2"]:
    """Points of a .csv, .txt or .npy file; raises ValueError saying what was expected instead."""
    wanted = "a readable .csv, .txt or .npy file of K x 2 numbers"
    if path.suffix not in {".csv", ".txt", ".npy"}:
        raise ValueError(wanted)
    try:
        if path.suffix == ".npy":
            points = np.load(path, allow_pickle=False)
        else:
            lines = path.read_text(encoding="utf-8").replace(",", " ").splitlines()
            rows = [line for line in lines if line.split("#")[0].strip()]
            points = np.loadtxt(rows, ndmin=2) if rows else np.zeros((0, 2))
    except OSError as error:
        raise ValueError(f"{wanted} ({error.strerror or 'not such a file'})") from None
    except (ValueError, EOFError) as error:
        raise ValueError(f"{wanted} ({' '.join(str(error).split())})") from None
    if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in "iuf":
        raise ValueError(f"{wanted} (found {points.dtype} of shape {points.shape})")
    return points.astype(float)


def counter_clockwise(points: Float[np.ndarray, "K 2"]) -> Float[np.ndarray, "K 2"]:
    """The points, turned round if clockwise; raises ValueError if they are no simple closed curve."""
    if len(points) < _FEWEST:
        raise ValueError(f"at least {_FEWEST} points, not {len(points)}")
    if not np.all(np.isfinite(points)):
        raise ValueError(f"finite numbers (point {np.argmin(np.isfinite(points).all(axis=1))} is not)")
    _, first, same = np.unique(points, axis=0, return_index=True, return_inverse=True)
    repeated = np.flatnonzero(first[same.ravel()] != np.arange(len(points)))
    if repeated.size:
        k = repeated[0]
        raise ValueError(f"distinct points (points {first[same.ravel()[k]]} and {k} coincide)")
    if not LinearRing(points).is_simple:
        raise ValueError("a curve that does not cross itself")
    points = points if LinearRing(points).is_ccw else points[::-1]
    if not LinearRing(smooth(points)).is_simple:
        raise ValueError("points through which a smooth curve does not cross itself (take them closer, or more evenly)")
    return points


def smooth(points: Float[np.ndarray, "K 2"]) -> Float[np.ndarray, "1024 2"]:
    """Samples of the smooth closed curve through the points, beginning at the first."""
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
