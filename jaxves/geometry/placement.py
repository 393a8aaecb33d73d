"""Places for many vesicles in a periodic cell, without overlap. Nothing here imports JAX.

Vesicles are put one after the other, the largest first, at random places and angles. A place is kept if the outline
keeps a gap to all others and to all images, its own included. Above an area fraction of about a half no room is found.
"""

import itertools

import numpy as np
from jaxtyping import Float
from shapely import affinity
from shapely.geometry import Polygon

_ATTEMPTS = 2_000  # places that are tried for one vesicle
_COARSE = 1e-3  # largest distance of a simplified outline from the right one
GAP = 0.05  # default gap between membranes, in a


class NoRoom(ValueError):
    """There is no room for all vesicles."""


def random_places(
    outlines: list[Polygon], lattice: Float[np.ndarray, "2 2"], seed: int, gap: float = GAP
) -> tuple[Float[np.ndarray, "M 2"], Float[np.ndarray, "M"]]:
    """Returns centroids (M, 2) and angles (M,) in degrees, by which each outline is turned, for `outlines` in a cell.

    Each outline must have its centroid at the origin. The rows of `lattice` are the vectors of the cell.

    Raises:
        NoRoom: no place was found for one of them in 2000 attempts.
    """
    generator = np.random.default_rng(seed)
    images = np.array(list(itertools.product((-1, 0, 1), repeat=2))) @ lattice
    distances = [np.hypot(*np.array(outline.exterior.coords).T) for outline in outlines]
    radii, inner = (np.array([choose(found) for found in distances]) for choose in (np.max, np.min))
    # Few vertices make distances cheap; the gap allows for what they miss.
    outlines, gap = [outline.simplify(_COARSE) for outline in outlines], gap + 2 * _COARSE
    centers, angles = np.zeros((len(outlines), 2)), np.zeros(len(outlines))
    put: list[tuple[int, Polygon]] = []
    for m in sorted(range(len(outlines)), key=lambda m: -radii[m]):
        for _ in range(_ATTEMPTS):
            center, angle = generator.uniform(size=2) @ lattice, generator.uniform(0, 360)
            turned = affinity.rotate(outlines[m], angle, origin=(0, 0))
            apart = centers[[k for k, _ in put], None] + images - center
            if _is_clear(turned, m, apart, put, radii, inner, images, gap):
                break
        else:
            raise NoRoom(f"no room for vesicle {len(put) + 1} of {len(outlines)}")
        centers[m], angles[m] = center, angle
        put.append((m, turned))
    return centers, angles


def _is_clear(turned: Polygon, m: int, apart, put, radii, inner, images, gap) -> bool:
    """Returns whether the outline m keeps the gap to its own images, and to those that are `put`.

    `apart` has the vectors to all images of these. `radii` and `inner` are those of circles around and in the outlines.
    """
    for image in images:
        near = 0 < np.hypot(*image) < 2 * radii[m] + gap
        if near and turned.distance(affinity.translate(turned, *image)) < gap:
            return False
    others = [k for k, _ in put]
    distance = np.hypot(apart[..., 0], apart[..., 1])
    if np.any(distance < inner[m] + inner[others, None] + gap):
        return False
    for k, image in zip(*np.nonzero(distance < radii[m] + radii[others, None] + gap), strict=True):
        if turned.distance(affinity.translate(put[k][1], *apart[k, image])) < gap:
            return False
    return True


def lattice_places(count: int, lattice: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "M 2"]:
    """Returns `count` places on a lattice that divides the cell, with equal numbers along both vectors where it can.

    If the count is not a product of such numbers, the last places of the lattice stay empty.
    """
    stretch = np.linalg.norm(lattice[0]) / np.linalg.norm(lattice[1])
    across = min(
        range(1, count + 1), key=lambda n: (-(-count // n) * n - count, abs(np.log(n * n / (count * stretch))))
    )
    i, j = np.divmod(np.arange(count), across)
    rows = -(-count // across)
    return np.stack([(j + 0.5) / across, (i + 0.5) / rows], axis=-1) @ lattice


def random_suspension(
    x: Float[np.ndarray, "N 2"], lattice, *, count: int, seed: int = 0, gap: float = GAP
) -> Float[np.ndarray, "M N 2"]:
    """Returns the nodes of `count` copies of a curve at random places and angles in a periodic cell, without overlap.

    They can be given to `make_scene` with `cell=Cell.of(lattice)`.

    Args:
        x: the nodes (N, 2) of the curve.
        lattice: the two vectors of the cell, as rows.
        count: the number of copies.
        seed: the seed of the random numbers.
        gap: the least distance of two membranes.

    Raises:
        ValueError: the arguments do not have the right form, or there is no room for so many (`NoRoom`).
    """
    x, lattice = np.asarray(x, dtype=float), np.asarray(lattice, dtype=float)
    if x.ndim != 2 or x.shape[1] != 2:
        raise ValueError(f"x has shape {x.shape}, expected the nodes (N, 2) of a curve.")
    if lattice.shape != (2, 2) or not np.linalg.det(lattice) > 0:
        raise ValueError(f"lattice = {lattice.tolist()}, expected two vectors, the second to the left of the first.")
    if not isinstance(count, int | np.integer) or count < 1:
        raise ValueError(f"count = {count}, expected a whole number >= 1.")
    outline = Polygon(x)
    x = x - np.array(outline.centroid.coords[0])
    centers, angles = random_places([Polygon(x)] * count, lattice, seed, gap)
    turns = np.exp(1j * np.deg2rad(angles))
    z = turns[:, None] * (x[:, 0] + 1j * x[:, 1])
    return np.stack([z.real, z.imag], axis=-1) + centers[:, None]
