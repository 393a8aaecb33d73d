r"""Numbers of a scene from observations: least squares from several starts, with confidence intervals.

With the model m(p), the observations d and their standard deviations s, `fit` minimises χ² = Σ ((m - d)/s)² within
bounds. The search is a trust region (`search`) or a gradient descent with an optimiser of Optax (`descent`). Both use
forward derivatives: P unknowns cost P tangents of a run. Near the minimum χ² is a paraboloid with the curvature JᵀJ,
where J = ∂(m/s)/∂p. Its inverse is the covariance of the numbers (Laplace's approximation, `intervals`). Where the
paraboloid has a long axis, the observations do not determine the numbers separately. The answer names that combination.

    observed = {"deformation_along_field": D}, any diagnostics (T, …) at t_end k/T, k = 1 … T, and "radii" (T, M, K)

Several runs with different numbers, such as frequencies, are fitted together (`Observations.conditions`). The unknowns
are numbers of the scene, or others from which these follow, such as the capacitance of the membrane in F/m².

`fit_frames` takes the outlines of a film from a microscope.
"""

import functools
import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import optax
from jaxtyping import Float
from scipy.special import gammaincc

from ..base.arguments import refusal, require_count
from ..base.own_functions import number, returned
from ..base.progress import Progress, silent
from ..geometry.frames import Frames
from ..inputs.parameters import check_numbers
from ..inputs.parameters import numbers as read_numbers
from ..inputs.scene_files import Readable, read_scene
from ..numerics.arrays import ScalarLike, as_float
from ..stepping.march import AbstractMarch
from . import boxes
from .descent import descent, require_optimiser
from .intervals import judged
from .kept_starts import fingerprint, keep, resumed
from .observations import Model, Observations, Translation, words
from .search import Start, Target, linearised, starting_points, trust_region

_AT_BOUND = 0.05  # distance from a bound, relative to the half-width of an interval
_IMPROBABLE = 1e-3  # probability of χ² below which a fit is doubtful


class Fit(NamedTuple):
    """The best end of all starts. The intervals are 95 %, from the paraboloid in the coordinates of the search.

    A number that the observations do not determine has no interval, and neither has one that ends at a bound, because
    χ² has no minimum there. `str` gives all of it in words.
    """

    values: dict[str, float]
    intervals: dict[str, tuple[float, float] | None]  # None for a number that is not determined, or at a bound
    covariance: Float[np.ndarray, "P P"]  # in the units of the numbers, in the order of `values`
    chi2: float
    observations: int  # χ² is near this minus the number of unknowns if model and deviations are right
    loose: tuple[str, ...]  # combinations that the observations do not determine
    determined: tuple[str, ...]  # combinations that they do determine, of numbers that are not determined alone
    starts: tuple[Start, ...]
    at_bounds: tuple[str, ...] = ()  # numbers that ended at a bound, within a twentieth of what their interval would be

    @property
    def probability(self) -> float:
        """The probability that χ² is at least this large if model and deviations are right; 1 without redundancy."""
        redundant = self.observations - len(self.values)
        return float(gammaincc(0.5 * redundant, 0.5 * self.chi2)) if redundant > 0 else 1.0

    def __str__(self) -> str:
        lines = []
        for name, interval in self.intervals.items():
            if name in self.at_bounds:
                lines.append(f"{name} = {self.values[name]:.5g}, an end of its bounds: no interval. Widen the bounds.")
            elif interval is None:
                lines.append(f"{name}: not determined alone")
            else:
                lines.append("{} = {:.5g}, 95 % from {:.5g} to {:.5g}".format(name, self.values[name], *interval))
        lines += [f"{sentence}." for sentence in self.determined]
        if not self.determined:
            lines += [f"{combination} is not determined." for combination in self.loose]
        lines.append(f"χ² = {self.chi2:.5g} for {self.observations} observations")
        if self.probability < _IMPROBABLE:
            lines.append(
                "χ² is improbably large: the scene does not describe the observations, or their `deviation` is too "
                "small. The intervals are too narrow."
            )
        return "\n".join(lines)


def fit(
    scene_file: Readable,
    bounds: Mapping[str, tuple[float, float]],
    observations: Observations,
    *,
    starts: int | Sequence[Mapping[str, float]] = 3,
    numbers: Translation | None = None,
    march: AbstractMarch | None = None,
    tolerance: float = 1e-5,
    max_steps: int = 100,
    method: optax.GradientTransformation | None = None,
    checkpoint: str | Path | None = None,
    progress: Progress = silent,
) -> Fit:
    """Returns the unknowns named in `bounds` with which the scene agrees best with `observations`.

    Args:
        scene_file: the scene that was observed: read, or as a path, a built-in name or tables.
        bounds: (lower, upper) for each unknown, by its name, such as "field.beta" (or a name that `numbers` takes).
        observations: what was observed.
        starts: how many searches to make: from the scene's own numbers (with `numbers` from the middle of the bounds)
            and from more points within the bounds. Or the points themselves, each with a value for every unknown.
        numbers: a function of the unknowns, by name, that returns numbers of the scene, by name. JAX must be able to
            trace it, as it can trace `LabQuantities`. The unknowns may then have names and units of your own.
        march: how runs advance in time; what the scene file says if None.
        tolerance: a search ends when χ² changes by less than this, relative to χ².
        max_steps: the largest number of runs in one search.
        method: None for the trust region, which is the better choice for a few unknowns. Or an optimiser of Optax, such
            as `optax.adam(0.1)`, which needs a few hundred steps. It works in the logarithm of a number whose bounds
            are positive, and else in the fraction of the bounds, so that a learning rate of 0.1 means steps of about
            10 % at first. An optimiser with a line search is refused.
        checkpoint: a file (JSON) of the starts that are done. A call with the same arguments continues from it.
        progress: called after each run and each start, with the number of starts done, of all, and a text with χ².

    Raises:
        ValueError: bounds, observations or `method` cannot be used, every start broke down, or the checkpoint belongs
            to another fit.
        SceneError: the scene has no number of such a name.
    """
    scene_file = read_scene(scene_file)
    inside = boxes.boxes(bounds)
    model = Model.of(scene_file, observations, march, _traceable(numbers, inside))
    tried = [_checked(model, inside, name, share) for name in inside for share in (1e-6, 1 - 1e-6)]
    if isinstance(starts, int):
        require_count("starts", starts)
        own = read_numbers(scene_file) if numbers is None else _middle(inside)
        starts = starting_points(inside, own, starts)
    if method is not None:
        require_optimiser("method", method)
    search = trust_region if method is None else functools.partial(descent, method=method)
    target = Target.of(model, inside, observations)
    mark = fingerprint(scene_file, inside, observations, model.march, tolerance, method, tried)
    done = resumed(checkpoint, mark)
    for i, point in enumerate(starts):
        if i >= len(done):
            told = functools.partial(_tell, progress, i, len(starts))
            done.append(search(point, target, tolerance, max_steps, told))
            keep(checkpoint, mark, done)
        progress(i + 1, len(starts), f"start {i + 1} of {len(starts)} is done: χ² = {done[i].chi2:.6g}")
    return _judged(tuple(done[: len(starts)]), target)


def _traceable(numbers: Translation | None, inside: Mapping[str, boxes.Box]) -> Translation | None:
    """Returns `numbers`; raises ValueError unless JAX can trace it, and it returns numbers by their names."""
    if numbers is None:
        return None
    expected = "a function in JAX that returns numbers of the scene by their names, as a dict"
    found = returned("numbers", numbers, dict.fromkeys(inside, number()), expected=expected)
    if not isinstance(found, dict) or not all(np.shape(value) == () for value in found.values()):
        raise refusal("numbers", f"a function that returns {found}", expected)
    return numbers


def _middle(inside: Mapping[str, boxes.Box]) -> dict[str, float]:
    """Returns the point in the middle of all boxes, in the coordinates of the search."""
    middle = as_float([sum(box.ends()) / 2 for box in inside.values()])
    return {name: float(value) for name, value in boxes.to_values(middle, inside).items()}


def _checked(model: Model, inside: Mapping[str, boxes.Box], name: str, share: float) -> dict[str, float]:
    """Returns the numbers of the scene with one unknown near an end of its bounds, which is never tried itself.

    Raises:
        SceneError: they are no numbers that the scene may have.
        ValueError: `numbers` gives a number in which the observed runs differ.
    """
    box = inside[name]
    found = {name: box.lower + share * (box.upper - box.lower)}
    if model.numbers is not None:
        found = {name: float(value) for name, value in model.numbers(_middle(inside) | found).items()}
    for name in model.conditions or ():
        if name in found:
            raise ValueError(f"observations.conditions: {name} is an unknown too, expected it in one of both.")
    check_numbers(model.scene_file, found)
    return found


def _tell(progress: Progress, start: int, starts: int, run: int, chi2: float) -> None:
    progress(start, starts, f"start {start + 1} of {starts}, run {run}: χ² = {chi2:.6g}")


def fit_frames(
    scene_file: Readable,
    bounds: Mapping[str, tuple[float, float]],
    frames: Frames,
    time_unit: ScalarLike,
    **how,
) -> Fit:
    """Returns the numbers with which the scene agrees best with the outlines of a film.

    The outlines are compared by their normal distances in Fourier modes, weighted by their noise (`film_gauge`).
    Neither the position of the vesicle nor tank-treading counts. With the right scene, χ² is near the number of
    observations minus the number of unknowns.

    The scene has one vesicle, whose length is in units of the radius a of the film. To take the errors of the radius
    and of the reduced area into account, let "vesicle.length" and "vesicle.reduced_area" be among the `bounds`. Without
    the length a warning says how large the error is that the intervals leave out.

    Args:
        scene_file: the scene at t = 0, which is the frame `frames.start`.
        bounds: (lower, upper) for each number to be found.
        frames: the film, as `read_frames` returns it.
        time_unit: t_κ in s, with the bending stiffness to which `vesicle.bending` is relative; see
            `LabQuantities.scales`.
        how: the other arguments of `fit`.

    Raises:
        ValueError: as for `fit`; or the scene has several vesicles.
        SceneError: the scene has no number of such a name.
    """
    if "vesicle.length" not in bounds:
        radius = frames.radius
        warnings.warn(
            f"bounds: vesicle.length is missing, so the intervals leave out the error of the radius of the film, "
            f"{100 * radius.error / radius.value:.1g} % of it.",
            stacklevel=2,
        )
    return fit(scene_file, bounds, Observations.of_frames(frames, time_unit), **how)


def _judged(starts: tuple[Start, ...], target: Target) -> Fit:
    """Returns the best end of all starts, with intervals and the combinations that are not determined."""
    inside = dict(target.inside)
    finite = [start for start in starts if math.isfinite(start.chi2)]
    if not finite:
        ended = " or ".join(sorted(set().union(*(words(target.model, start.began) for start in starts))))
        wanted = "at least one start whose run is complete and has all observed quantities"
        raise ValueError(f"starts: every run ended as {ended}, expected {wanted}.")
    best = min(finite, key=lambda start: start.chi2)
    coordinates = boxes.to_coordinates(best.ended, inside)
    r, jacobian = linearised(as_float(coordinates), target)
    to_value = boxes.slopes(best.ended, inside)
    sizes, undetermined, covariance, loose, determined = judged(np.array(jacobian), inside)
    intervals: dict[str, tuple[float, float] | None] = {}
    at_bounds = []
    rows = zip(inside.items(), coordinates, sizes, undetermined, to_value, strict=True)
    for (name, box), c, size, unknown, scale in rows:
        lower, upper = box.ends()
        if not unknown and min(c - lower, upper - c) < _AT_BOUND * size:
            at_bounds.append(name)
        value, both = best.ended[name], np.array([-size, size])
        low, high = value * np.exp(np.clip(both, -600, 600)) if box.positive else value + scale * both
        intervals[name] = None if unknown or name in at_bounds else (float(low), float(high))
    covariance = to_value[:, None] * covariance * to_value
    return Fit(best.ended, intervals, covariance, best.chi2, r.size, loose, determined, starts, tuple(at_bounds))
