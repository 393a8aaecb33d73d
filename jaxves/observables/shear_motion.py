"""The motion of a vesicle in a shear flow, from the time series of its unwrapped inclination: class, period, averages.

    treading      the inclination comes to rest: in the last fifth of the time it changes by less than RESTING
    tumbling      the major axis turns by two half-turns or more, always in one sense at the end
    swinging      the inclination swings without a half-turn: two swings or more exceed SWING, and the last is at least
                  half the largest
    open          none of these, as yet

A vesicle of viscosity ratio ν moves on the time scale (1 + ν)/2, so a run of fixed length shows less for a larger ν. A
tumbling vesicle has the same shape and the same viscosity after half a turn. Averages are therefore taken over whole
half-turns, between two instants of the same direction. Nothing here imports JAX.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

RESTING = np.deg2rad(0.5)
SWING = np.deg2rad(2.0)
NAMES = ("open", "treading", "tumbling", "swinging")

History = Float[np.ndarray, "T"]


class HalfTurns(NamedTuple):
    """The instants at which the major axis has the direction of the end again, and the mean time between them."""

    times: Float[np.ndarray, "K"]
    period: float  # of half a turn; NaN for fewer than two instants


def half_turns(t: History, inclination: History) -> HalfTurns:
    """Returns the half-turns that end with the last saved time.

    `inclination` is unwrapped, in radians; it must change by less than half a turn between saved times. The instants
    are those of the cubic spline through the saved values.
    """
    turned = np.abs(inclination - inclination[-1])
    spline = CubicSpline(t, inclination)
    sign = np.sign(inclination[-1] - inclination[0]) or 1.0
    times = [float(t[-1])]
    for k in range(1, int(np.max(turned) / np.pi) + 1):
        roots = spline.solve(inclination[-1] - sign * k * np.pi, extrapolate=False)
        if len(roots) == 0:
            break
        times.append(float(roots[-1]))
    times = np.array(times[::-1])
    return HalfTurns(times, float(np.mean(np.diff(times))) if len(times) > 1 else np.nan)


def classify(t: History, inclination: History) -> str:
    """Returns one of `NAMES` from the saved times (T,) and the unwrapped inclination in radians."""
    known = np.isfinite(t) & np.isfinite(inclination)
    t, inclination = np.asarray(t, dtype=float)[known], np.asarray(inclination, dtype=float)[known]
    if len(t) < 5:
        return "open"
    if len(half_turns(t, inclination).times) > 2:
        return "tumbling"
    late = inclination[t >= t[-1] - 0.2 * (t[-1] - t[0])]
    if np.ptp(late) < RESTING:
        return "treading"
    turning = np.flatnonzero(np.diff(np.sign(np.diff(inclination))) != 0) + 1
    swings = np.abs(np.diff(inclination[turning]))
    if np.sum(swings > SWING) >= 2 and swings[-1] >= max(SWING, 0.5 * swings.max()):
        return "swinging"
    return "open"


def average(t: History, inclination: History, values: Float[np.ndarray, "T *rest"], turns: int = 1) -> np.ndarray:
    """Returns the time average of `values` over the last `turns` half-turns; NaN if there are fewer.

    The integral is that of the cubic spline through the saved values.
    """
    times = half_turns(t, inclination).times
    if len(times) <= turns:
        return np.full(np.shape(values)[1:], np.nan)
    start, end = times[-1 - turns], times[-1]
    return np.asarray(CubicSpline(t, values).integrate(start, end) / (end - start))
