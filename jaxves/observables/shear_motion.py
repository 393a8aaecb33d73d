"""The motion of a vesicle in a shear flow, from the time series of its unwrapped inclination: class, period, averages.

    treading      the inclination comes to rest: in the last fifth of the time it changes by less than RESTING
    tumbling      the major axis turns by two half-turns or more, always in one sense at the end
    swinging      the inclination swings without a half-turn: two swings or more exceed SWING, and the last is at least
                  half the largest
    open          none of these, as yet

Shapes and inclinations relax (1 + ν)/2 times as slowly as with equal viscosities. For a viscosity ratio ν > 1, RESTING
is therefore divided by (1 + ν)/2, so that slow motion is not taken for rest. A tumbling vesicle has the same shape and
the same viscosity after half a turn. Averages are therefore taken over whole half-turns, between two instants of the
same direction. Nothing here imports JAX.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

RESTING = np.deg2rad(0.5)
SWING = np.deg2rad(2.0)
NAMES = ("open", "treading", "tumbling", "swinging")

History = Float[np.ndarray, "T"]


def _spline(t: History, values: Float[np.ndarray, "T ..."]):
    from scipy.interpolate import CubicSpline  # takes as long to import as the rest of the command line

    return CubicSpline(t, values)


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
    spline = _spline(t, inclination)
    sign = np.sign(inclination[-1] - inclination[0]) or 1.0
    times = [float(t[-1])]
    for k in range(1, int(np.max(turned) / np.pi) + 1):
        roots = spline.solve(inclination[-1] - sign * k * np.pi, extrapolate=False)
        if len(roots) == 0:
            break
        times.append(float(roots[-1]))
    times = np.array(times[::-1])
    return HalfTurns(times, float(np.mean(np.diff(times))) if len(times) > 1 else np.nan)


def classify(t: History, inclination: History, ratio: float = 1.0) -> str:
    """Returns one of `NAMES` from the saved times (T,), the unwrapped inclination in radians, and ν."""
    known = np.isfinite(t) & np.isfinite(inclination)
    t, inclination = np.asarray(t, dtype=float)[known], np.asarray(inclination, dtype=float)[known]
    if len(t) < 5:
        return "open"
    if len(half_turns(t, inclination).times) > 2:
        return "tumbling"
    late = inclination[t >= t[-1] - 0.2 * (t[-1] - t[0])]
    if np.ptp(late) < RESTING / max(1.0, 0.5 * (1 + ratio)):
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
    return np.asarray(_spline(t, values).integrate(start, end) / (end - start))


class Motion(NamedTuple):
    """The motion of all vesicles of a run."""

    names: tuple[str, ...]  # the class of each vesicle
    half_turn: Float[np.ndarray, "M"]  # the mean time of half a turn; NaN unless it tumbles
    viscosity: float  # the average of [μ] over whole half-turns; NaN unless there is one vesicle and it tumbles


def motion_of(
    t: History,
    inclination: Float[np.ndarray, "T M"],
    ratio: Float[np.ndarray, "M"],
    viscosity: History | None = None,
) -> Motion:
    """Returns the motion of all vesicles from saved times, unwrapped inclinations, ν of each, and [μ].

    Rows that are NaN, which a run did not reach, are ignored.
    """
    there = np.isfinite(t) & np.all(np.isfinite(inclination), axis=1)
    t, inclination = t[there], inclination[there]
    names = tuple(classify(t, *each) for each in zip(inclination.T, ratio, strict=True))
    turning = [
        half_turns(t, angle) if name == "tumbling" else None for angle, name in zip(inclination.T, names, strict=True)
    ]
    periods = np.array([np.nan if found is None else found.period for found in turning])
    mean = np.nan
    if viscosity is not None and len(turning) == 1 and turning[0] is not None:
        mean = float(average(t, inclination[:, 0], viscosity[there], len(turning[0].times) - 1))
    return Motion(names, periods, mean)


def is_sheared(tables: Mapping[str, Any]) -> bool:
    """Returns whether the tables of a scene have a constant shear flow, in which no vesicle is a circle."""
    flow = tables.get("flow") or {}
    constant = (flow.get("time") or {}).get("kind", "constant") == "constant"
    round_ones = [vesicle for vesicle in tables["vesicle"] if vesicle.get("shape") == "circle"]
    return flow.get("kind") == "shear" and constant and not round_ones
