r"""Numbers of a scene from what was observed: least squares, several starts, and what the answer is worth.

With the model m(p), the observations d and their standard deviations s, χ² = Σ ((m - d)/s)² is minimised within bounds
by a trust region (SciPy's `least_squares`, which takes a run that breaks down for too long a step) with forward
derivatives: P unknowns cost P tangents of a run. About the minimum χ² is a paraboloid, whose curvature JᵀJ, with
J = ∂(m/s)/∂p, gives covariances after Laplace: (JᵀJ)⁻¹. Where that has a long axis the observations do not tell the
numbers apart, and the answer says along which combination.

    observed = {"deformation_along_field": D}, any diagnostics (T, …) at t_end k/T, k = 1 … T, and "radii" (T, M, K)
"""

import hashlib
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares
from scipy.stats import qmc

from ..base import status
from ..base.arguments import require, require_count
from ..base.bounds import POSITIVE
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..inputs.parameters import check_numbers, numbers
from ..inputs.scene_files import to_toml
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import FIT
from ..numerics import fourier
from ..numerics.arrays import VesiclePoints, as_float
from ..runs.case import Case
from ..stepping.marching import AbstractMarch
from . import boxes
from .boxes import Box

NORMAL_95 = 1.959964
_LOOSE = 1.0  # half of a 95 % interval beyond which a combination of numbers counts as not determined


class Observations(NamedTuple):
    """What was seen at the T equally spaced times up to `t_end`, by name, and its standard deviations."""

    t_end: float
    seen: dict[str, Float[np.ndarray, "T ..."]]
    deviation: dict[str, float]


class Start(NamedTuple):
    """Where one search began and ended."""

    began: dict[str, float]
    ended: dict[str, float]
    chi2: float
    iterations: int
    converged: bool


class Fit(NamedTuple):
    """The best end of all starts; intervals are 95 %, of the paraboloid in the coordinate that was searched in."""

    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    covariance: Float[np.ndarray, "P P"]  # in the units of the numbers, in the order of `values`
    chi2: float
    observations: int  # χ² is near this, less the unknowns, where model and deviations are right
    loose: tuple[str, ...]  # combinations that the observations do not determine
    starts: tuple[Start, ...]


def radii(x: VesiclePoints, K: int) -> Float[Array, "M K"]:
    """Distance from the centroid to the outline in K directions, from x on: how an observed shape is given.

    Of outlines that a ray from the centroid meets once; cubic in the node spacing over four.
    """

    def one(x):
        fine = fourier.resample(x, 4 * x.shape[0], axis=0) - geometry.centroid(Curve.from_nodes(x))
        angle = jnp.unwrap(jnp.arctan2(fine[:, 1], fine[:, 0]))
        radius = jnp.sqrt(jnp.sum(fine**2, axis=-1))
        wanted = 2 * jnp.pi * jnp.arange(K) / K
        return jnp.interp(wanted, angle, radius, period=2 * jnp.pi)

    return jax.vmap(one)(x)


class Model(eqx.Module):
    """What a run with these numbers would show at the times of the observations."""

    scene_file: SceneFile = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    directions: int = eqx.field(static=True)  # of "radii"
    saves: int = eqx.field(static=True)
    t_end: float = eqx.field(static=True)
    march: AbstractMarch

    @classmethod
    def of(cls, scene_file: SceneFile, observations: Observations, march: AbstractMarch | None = None) -> "Model":
        """Raises ValueError for observations that do not fit together, SceneError for keys that no fit can honour."""
        require("observations.t_end", observations.t_end, POSITIVE)
        counts = {len(values) for values in observations.seen.values()}
        if len(counts) != 1 or 0 in counts:
            raise ValueError(f"observations.seen: {sorted(counts)} times, expected the same number of all, at least 1.")
        for name in observations.seen:
            if not observations.deviation.get(name, 0.0) > 0:
                raise ValueError(f"observations.deviation: {name} is missing, expected a positive number.")
            if not np.all(np.isfinite(observations.seen[name])):
                raise ValueError(f"observations.seen: {name} has entries that are not finite, expected finite numbers.")
        directions = np.shape(observations.seen["radii"])[-1] if "radii" in observations.seen else 0
        saves = counts.pop()
        case = Case.of(scene_file, FIT)
        march = (case.march(observations.t_end, saves) if march is None else march).forwards()
        return cls(scene_file, tuple(sorted(observations.seen)), directions, saves, observations.t_end, march)

    def __call__(self, values: Mapping[str, Array]) -> dict[str, Float[Array, "T ..."]]:
        """NaN where the run does not reach its end."""
        result = Case(self.scene_file).simulate(values, t_end=self.t_end, saves=self.saves, march=self.march)
        complete = result.status == status.COMPLETE
        found = {name: jnp.where(complete, value, jnp.nan) for name, value in result.diagnostics.items()}
        if self.directions:
            found["radii"] = jnp.where(complete, jax.vmap(lambda x: radii(x, self.directions))(result.x), jnp.nan)
        for name in self.names:
            if name not in found:
                raise ValueError(f"observations.seen: {name!r}, expected some of radii, {', '.join(sorted(found))}.")
        return {name: found[name][1:] for name in self.names}


@eqx.filter_jit
def _shown(model: Model, values):
    return model(values)


def shown(model: Model, values: Mapping[str, float]) -> dict[str, Float[np.ndarray, "T ..."]]:
    """What the model shows with these numbers: to make or to draw observations."""
    found = _shown(model, {name: as_float(value) for name, value in values.items()})
    return {name: np.asarray(history) for name, history in found.items()}


@eqx.filter_jit
def _linear(c: Float[Array, "P"], args) -> tuple[Float[Array, "R"], Float[Array, "R P"]]:
    """Residuals and their Jacobian in the coordinates; NaN where the run breaks down."""
    model, inside, seen, deviation = args

    def both(c):
        shown = model(boxes.to_values(c, dict(inside)))
        r = jnp.concatenate([jnp.ravel((shown[name] - seen[name]) / deviation[name]) for name in model.names])
        return r, r

    jacobian, r = jax.jacfwd(both, has_aux=True)(c)
    return r, jacobian


def starting_points(
    inside: Mapping[str, Box], scene_file: SceneFile, count: int, seed: int = 0
) -> list[dict[str, float]]:
    """The scene's own numbers, then `count` - 1 more spread over the boxes (Sobol's sequence)."""
    own = numbers(scene_file)
    points = [{name: own[name] for name in inside}]
    if count > 1:
        spread = 0.1 + 0.8 * qmc.Sobol(len(inside), seed=seed).random(1 << (count - 2).bit_length())[: count - 1]
        lower, upper = np.transpose([box.ends() for box in inside.values()])
        for place in lower + (upper - lower) * spread:
            values = boxes.to_values(as_float(place), inside)
            points.append({name: float(value) for name, value in values.items()})
    return points


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
    args = (
        model,
        tuple(inside.items()),
        {name: as_float(values) for name, values in observations.seen.items()},
        {name: as_float(observations.deviation[name]) for name in observations.seen},
    )
    points = starting_points(inside, scene_file, starts) if isinstance(starts, int) else starts
    mark = _fingerprint(scene_file, inside, observations, model.march, tolerance)
    done = _resumed(checkpoint, mark)
    for i, point in enumerate(points):
        if i >= len(done):
            done.append(_search(point, inside, args, tolerance, max_steps))
            _keep(checkpoint, mark, done)
        progress(i, done[i])
    return _judged(tuple(done[: len(points)]), inside, args)


def _search(point, inside, args, tolerance, max_steps) -> Start:
    first = boxes.to_coordinates(point, inside)
    last = {}

    def residuals(c):
        r, last["jacobian"] = map(np.asarray, _linear(as_float(c), args))
        last["c"] = np.array(c)
        return r

    def jacobian(c):
        if not np.array_equal(c, last["c"]):
            residuals(c)
        return last["jacobian"]

    if not np.all(np.isfinite(residuals(first))):
        return Start(dict(point), dict(point), math.inf, 1, False)
    found = least_squares(
        residuals,
        first,
        jacobian,
        bounds=np.transpose([box.ends() for box in inside.values()]),
        x_scale="jac",
        xtol=tolerance,
        ftol=tolerance,
        gtol=None,
        max_nfev=max_steps,
    )
    ended = {name: float(value) for name, value in boxes.to_values(as_float(found.x), inside).items()}
    return Start(dict(point), ended, 2 * float(found.cost), int(found.nfev), found.status > 0)


def _judged(starts: tuple[Start, ...], inside: Mapping[str, Box], args) -> Fit:
    finite = [start for start in starts if math.isfinite(start.chi2)]
    if not finite:
        raise ValueError("starts: every run broke down, expected at least one that the scene can be simulated with.")
    best = min(finite, key=lambda start: start.chi2)
    r, jacobian = _linear(as_float(boxes.to_coordinates(best.ended, inside)), args)
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


# -- starts that are done ------------------------------------------------------------------------------------------


def _fingerprint(scene_file, inside, observations: Observations, march, tolerance) -> str:
    text = [to_toml(scene_file), repr(sorted(inside.items())), repr(march), repr(tolerance), repr(observations.t_end)]
    for name in sorted(observations.seen):
        text += [name, repr(np.asarray(observations.seen[name]).tolist()), repr(float(observations.deviation[name]))]
    return hashlib.sha256("\n".join(text).encode()).hexdigest()


def _resumed(checkpoint: str | Path | None, mark: str) -> list[Start]:
    if checkpoint is None or not Path(checkpoint).exists():
        return []
    try:
        kept = json.loads(Path(checkpoint).read_text())
        found, starts = kept["fit"], [Start(**start) for start in kept["starts"]]
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"checkpoint = {checkpoint}, expected the starts of an earlier fit (JSON).") from None
    if found != mark:
        raise ValueError(f"checkpoint = {checkpoint}, expected that of the same scene, bounds and observations.")
    return starts


def _keep(checkpoint: str | Path | None, mark: str, done: list[Start]) -> None:
    if checkpoint is None:
        return
    path = Path(checkpoint)
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps({"fit": mark, "starts": [start._asdict() for start in done]}, indent=1) + "\n")
    os.replace(part, path)
