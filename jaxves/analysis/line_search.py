"""A step along a line for a sum of squares whose least value is zero, where one residual may change its sign.

Far from the wanted value a quantity of a run often hardly changes, as the deformation of a vesicle that has become
prolate or oblate. Two such states on both sides of the wanted value have almost no slope. The wanted value lies between
them, so that the zero of the residual is searched there.
"""

from collections.abc import Callable
from math import inf
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

_SUFFICIENT = 1e-4  # least decrease of the cost, relative to the one that the slope predicts
_CLOSER = 0.3  # once the sign has changed, the residual must fall to this share
_MOST = 12  # trials


class Trial(NamedTuple):
    """The cost at a point of the line (infinite if there is none), the residual that may change its sign, the rest."""

    cost: float
    residual: float
    rest: Any = None


def step_along(
    here: Trial, slope: float, share: float, try_at: Callable[[float], Trial | None]
) -> tuple[float, Trial] | None:
    """Returns a share of a step at which the cost is lower, with its trial; None if none was found.

    Without a change of sign, a share is halved until the cost decreases enough. Between shares with residuals of both
    signs the next share is the zero of the straight line through them; the residual of an end that stays is halved (the
    Illinois method).

    Args:
        here: the trial at the share 0.
        slope: the decrease of the cost per share at the share 0, positive.
        share: the first share to try.
        try_at: computes the trial at a share, or gives None if it cannot be afforded any more.
    """
    before, beyond = (0.0, here.residual), None
    best: tuple[float, Trial] | None = None
    for _ in range(_MOST):
        trial = try_at(share)
        if trial is None:
            break
        enough = trial.cost <= here.cost - _SUFFICIENT * share * slope
        if enough and (best is None or trial.cost < best[1].cost):
            best = share, trial
        crossed = trial.cost < inf and trial.residual * here.residual < 0
        if enough and (abs(trial.residual) <= _CLOSER * abs(here.residual) if crossed or beyond is not None else True):
            break
        if trial.cost == inf or not (crossed or beyond is not None):
            share = 0.5 * (before[0] + share)
            continue
        if crossed:
            before = (before[0], before[1] if beyond is None else 0.5 * before[1])
            beyond = (share, trial.residual)
        else:
            before, beyond = (share, trial.residual), (beyond[0], 0.5 * beyond[1])
        share = before[0] + (beyond[0] - before[0]) * before[1] / (before[1] - beyond[1])
    return best


def capped(step: Float[Array, "K"], longest: float) -> Float[Array, "K"]:
    """Returns a step of which no component is longer than `longest`."""
    return step * jnp.minimum(1.0, longest / jnp.maximum(jnp.max(jnp.abs(step)), 1e-300))
