"""Gradient descent on χ² with an optimiser of Optax. `fit` uses it as an alternative to the trust region.

The optimiser takes the gradient of χ²/2 in the coordinates of `boxes`. That is Jᵀr with the residuals r and their
Jacobian J. Steps end at the bounds. A step to numbers with which the run breaks down is halved. Each step needs one
run.
"""

import hashlib
import math
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Bool, Float

from ..base.arguments import refusal
from ..numerics.arrays import as_float
from . import boxes
from .search import AfterRun, Start, Target, linearised

_WANTED = "an optimiser of Optax without a line search, such as optax.adam(0.1), or None for the trust region"
_TRIED = 8  # number of steps that distinguish optimisers
_MARGIN = 1e-6  # least distance of a coordinate from the ends of its box, as a fraction of the box
_ROUND_OFF = 1e-9  # combinations of coordinates with a smaller relative singular value carry no information


def require_optimiser(argument: str, value: Any) -> None:
    """Raises ValueError unless `value` is an optimiser of Optax that needs nothing but gradients and parameters."""
    if not isinstance(value, optax.GradientTransformation):
        raise refusal(argument, value, _WANTED)
    try:
        fingerprint_of(value)
    except TypeError:  # its update wants the value of the function as well, or the function
        raise refusal(argument, "an optimiser whose update wants more than gradients", _WANTED) from None


def fingerprint_of(method: optax.GradientTransformation) -> str:
    """Returns a hash of the first steps of an optimiser along fixed gradients. Equal settings have equal hashes."""
    c = jnp.ones(2)
    state, steps = method.init(c), []
    for i in range(_TRIED):
        step, state = method.update(jnp.array([1.0, -0.5 * i]), state, c)
        c = c + step
        steps += [f"{value:.9e}" for value in np.asarray(step)]
    return hashlib.sha256(" ".join(steps).encode()).hexdigest()


def descent(
    point: Mapping[str, float],
    target: Target,
    tolerance: float,
    max_steps: int,
    told: AfterRun = lambda run, chi2: None,
    *,
    method: optax.GradientTransformation,
) -> Start:
    """Returns the best point of a gradient descent from `point` with at most `max_steps` runs.

    The search has converged when the linearised residuals predict that χ² can fall by less than `tolerance` times χ²,
    or by less than `tolerance` where χ² is below 1. χ² is infinite if the first run breaks down. `told` is called after
    each run.
    """
    inside = dict(target.inside)
    lower, upper = np.transpose([box.ends() for box in inside.values()])
    lower, upper = lower + _MARGIN * (upper - lower), upper - _MARGIN * (upper - lower)
    c = np.clip(boxes.to_coordinates(point, inside), lower, upper)
    r, jacobian = map(np.asarray, linearised(as_float(c), target))
    runs, state = 1, method.init(as_float(c))
    told(runs, float(r @ r))
    if not np.all(np.isfinite(r)):
        return Start(dict(point), dict(point), math.inf, runs, False)
    best, least = c, float(r @ r)
    while not (converged := _is_converged(r, jacobian, _free(c, jacobian.T @ r, lower, upper), tolerance)):
        update, state = method.update(as_float(jacobian.T @ r), state, as_float(c))
        share, found = 1.0, False
        while runs < max_steps and not found:
            tried = np.clip(c + share * np.asarray(update), lower, upper)
            its_r, its_jacobian = map(np.asarray, linearised(as_float(tried), target))
            found, runs, share = np.all(np.isfinite(its_r)), runs + 1, share / 2
            told(runs, float(its_r @ its_r))
        if not found:
            break
        c, r, jacobian = tried, its_r, its_jacobian
        if float(r @ r) < least:
            best, least = c, float(r @ r)
    ended = {name: float(value) for name, value in boxes.to_values(as_float(best), inside).items()}
    return Start(dict(point), ended, least, runs, bool(converged))


def _free(
    c: Float[np.ndarray, "P"],
    gradient: Float[np.ndarray, "P"],
    lower: Float[np.ndarray, "P"],
    upper: Float[np.ndarray, "P"],
) -> Bool[np.ndarray, "P"]:
    """Returns which coordinates (P,) are not held by a bound that the descent pushes them against."""
    return ~(((c <= lower) & (gradient > 0)) | ((c >= upper) & (gradient < 0)))


def _is_converged(
    r: Float[np.ndarray, "R"], jacobian: Float[np.ndarray, "R P"], free: Bool[np.ndarray, "P"], tolerance: float
) -> bool:
    """Returns whether the linearised residuals predict almost no decrease of χ² in the free coordinates."""
    if not np.any(free):
        return True
    directions, singular, _ = np.linalg.svd(jacobian[:, free], full_matrices=False)
    told = directions[:, singular > _ROUND_OFF * np.max(singular)]
    return float(np.sum((told.T @ r) ** 2)) <= tolerance * max(float(r @ r), 1.0)
