"""The search for the minimum of χ² from one point, which `fit` makes for each of its starts.

The search works in the coordinates of `boxes`. The trust region is SciPy's `least_squares`, for which a run that breaks
down is a step that was too long. The derivatives are forward: P unknowns cost P tangents of a run.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares
from scipy.stats import qmc

from ..numerics.arrays import as_float
from . import boxes
from .boxes import Box
from .observations import Model, Observations

AfterRun = Callable[[int, float], None]  # number of runs, χ² of the last one


class Start(NamedTuple):
    """One search: the numbers at its beginning and end, χ² at its end, its number of runs, whether it converged."""

    began: dict[str, float]
    ended: dict[str, float]
    chi2: float
    iterations: int
    converged: bool


class Target(NamedTuple):
    """The definition of χ²: the model, the bounds of its numbers, and the observations with their deviations."""

    model: Model
    inside: tuple[tuple[str, Box], ...]
    seen: dict[str, Float[Array, "T ..."]]
    deviation: dict[str, Float[Array, ""]]

    @classmethod
    def of(cls, model: Model, inside: Mapping[str, Box], observations: Observations) -> "Target":
        """Returns the target of a fit."""
        seen = {name: as_float(values) for name, values in observations.seen.items()}
        return cls(model, tuple(inside.items()), seen, {name: as_float(observations.deviation[name]) for name in seen})


@eqx.filter_jit
def linearised(c: Float[Array, "P"], target: Target) -> tuple[Float[Array, "R"], Float[Array, "R P"]]:
    """Returns residuals (R,) and their Jacobian (R, P) in the coordinates; NaN if the run breaks down."""
    model, inside, seen, deviation = target

    def both(c):
        shown = model(boxes.to_values(c, dict(inside)))
        r = jnp.concatenate([jnp.ravel((shown[name] - seen[name]) / deviation[name]) for name in model.names])
        return r, r

    jacobian, r = jax.jacfwd(both, has_aux=True)(c)
    return r, jacobian


def starting_points(
    inside: Mapping[str, Box], own: Mapping[str, float], count: int, seed: int = 0
) -> list[dict[str, float]]:
    """Returns the point `own`, then `count` - 1 more points spread over the boxes (Sobol sequence)."""
    points = [{name: own[name] for name in inside}]
    if count > 1:
        spread = 0.1 + 0.8 * qmc.Sobol(len(inside), seed=seed).random(1 << (count - 2).bit_length())[: count - 1]
        lower, upper = np.transpose([box.ends() for box in inside.values()])
        for place in lower + (upper - lower) * spread:
            values = boxes.to_values(as_float(place), inside)
            points.append({name: float(value) for name, value in values.items()})
    return points


def trust_region(
    point: Mapping[str, float],
    target: Target,
    tolerance: float,
    max_steps: int,
    told: AfterRun = lambda run, chi2: None,
) -> Start:
    """Returns the end of a trust-region search from `point` with at most `max_steps` runs.

    The search ends when a step changes the coordinates or χ² by less than `tolerance`, relative. χ² is infinite if the
    first run breaks down. `told` is called after each run.
    """
    inside = dict(target.inside)
    first = boxes.to_coordinates(point, inside)
    last: dict[str, Any] = {"c": None, "runs": 0}

    def residuals(c):
        if not np.array_equal(c, last["c"]):
            last["r"], last["jacobian"] = map(np.asarray, linearised(as_float(c), target))
            last["c"], last["runs"] = np.array(c), last["runs"] + 1
            told(last["runs"], float(last["r"] @ last["r"]))
        return last["r"]

    def jacobian(c):
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
