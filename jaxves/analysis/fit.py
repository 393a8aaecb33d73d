r"""Numbers of a scene from what was observed: least squares, several starts, and what the answer is worth.

With the model m(p), the observations d and their standard deviations s, χ² = Σ ((m - d)/s)² is minimised within bounds
by a trust region (SciPy's `least_squares`, which takes a run that breaks down for too long a step) with forward
derivatives: P unknowns cost P tangents of a run. About the minimum χ² is a paraboloid, whose curvature JᵀJ, with
J = ∂(m/s)/∂p, gives covariances after Laplace: (JᵀJ)⁻¹. Where that has a long axis the observations do not tell the
numbers apart, and the answer says along which combination.

    observed = {"deformation_along_field": D}, any diagnostics (T, …) at t_end k/T, k = 1 … T, and "radii" (T, M, K)
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..base.arguments import require_count
from ..inputs.parameters import check_numbers
from ..inputs.scene_tables import SceneFile
from ..numerics.arrays import as_float
from ..stepping.march import AbstractMarch
from . import boxes
from .boxes import Box
from .kept_starts import fingerprint, keep, resumed
from .observations import Model, Observations
from .search import Start, Target, linearised, starting_points, trust_region

NORMAL_95 = 1.959964
_LOOSE = 1.0  # half of a 95 % interval beyond which a combination of numbers counts as not determined


class Fit(NamedTuple):
    """The best end of all starts; intervals are 95 %, of the paraboloid in the coordinate that was searched in."""

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    covariance: Float[np.ndarray, "P P"]  # in the units of the numbers, in the order of `values`
    chi2: float
    observations: int  # χ² is near this, less the unknowns, where model and deviations are right
    loose: tuple[str, ...]  # combinations that the observations do not determine
    starts: tuple[Start, ...]


def fit(
    scene_file: SceneFile,
    bounds: Mapping[str, tuple[float, float]],
    observations: Observations,
    *,
    starts: int | Sequence[Mapping[str, float]] = 3,
    march: AbstractMarch | None = None,
    tolerance: float = 1e-5,
    max_steps: int = 100,
    checkpoint: str | Path | None = None,
    progress: Callable[[int, Start], None] = lambda i, start: None,
) -> Fit:
    """The numbers named in `bounds`, in the scene that `observations` were made of.

    Begins at `starts`: the scene's own numbers and as many more in the bounds as make this count, or given points.
    With `checkpoint` (JSON) every start is kept once it is done, and not searched again when called again.

    Raises:
        ValueError: bounds or observations make no sense, no start led anywhere, or the checkpoint is of another fit.
        SceneError: the scene has no number of such a name.
    """
    inside = boxes.boxes(bounds)
    model = Model.of(scene_file, observations, march)
    for name, box in inside.items():
        for share in (1e-6, 1 - 1e-6):  # the ends themselves are never tried
            check_numbers(scene_file, {name: box.lower + share * (box.upper - box.lower)})
    if isinstance(starts, int):
        require_count("starts", starts)
    target = Target.of(model, inside, observations)
    points = starting_points(inside, scene_file, starts) if isinstance(starts, int) else starts
    mark = fingerprint(scene_file, inside, observations, model.march, tolerance)
    done = resumed(checkpoint, mark)
    for i, point in enumerate(points):
        if i >= len(done):
            done.append(trust_region(point, target, tolerance, max_steps))
            keep(checkpoint, mark, done)
        progress(i, done[i])
    return _judged(tuple(done[: len(points)]), target)


def _judged(starts: tuple[Start, ...], target: Target) -> Fit:
    inside = dict(target.inside)
    finite = [start for start in starts if math.isfinite(start.chi2)]
    if not finite:
        raise ValueError("starts: every run broke down, expected at least one that the scene can be simulated with.")
    best = min(finite, key=lambda start: start.chi2)
    r, jacobian = linearised(as_float(boxes.to_coordinates(best.ended, inside)), target)
    to_value = boxes.slopes(best.ended, inside)
    fisher = np.array(jacobian)
    # What is round-off beside the others says nothing, and must not say it of combinations with them.
    said = np.max(np.abs(fisher), axis=0)
    fisher[:, said < 1e-9 * np.max(said)] = 0.0
    _, singular, axes = np.linalg.svd(fisher, full_matrices=False)
    singular = np.maximum(singular, 1e-100)
    half = NORMAL_95 / singular
    covariance = (axes.T / singular**2) @ axes
    sizes = NORMAL_95 * np.sqrt(np.diag(covariance))
    intervals = {}
    for (name, box), size, scale in zip(inside.items(), sizes, to_value, strict=True):
        value, both = best.ended[name], np.array([-size, size])
        low, high = value * np.exp(np.clip(both, -600, 600)) if box.positive else value + scale * both
        intervals[name] = (float(low), float(high))
    loose = tuple(_in_words(axis, inside) for axis, size in zip(axes, half, strict=True) if size > _LOOSE)
    return Fit(
        best.ended, intervals, to_value[:, None] * covariance * to_value, best.chi2, r.size, loose, starts
    )  # fmt: skip


def _in_words(axis: Float[np.ndarray, "P"], inside: Mapping[str, Box]) -> str:
    axis = axis * np.sign(axis[np.argmax(np.abs(axis))])
    parts = [
        f"{weight:+.2f} {f'log {name}' if box.positive else name}"
        for weight, (name, box) in zip(axis, inside.items(), strict=True)
        if abs(weight) > 0.1
    ]
    return " ".join(parts)
