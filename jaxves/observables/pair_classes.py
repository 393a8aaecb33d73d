"""Classes of the motion of two vesicles in a field, from the time series of the line between their centres.

    circulation   the line turns by half a turn or more
    oscillation   the line swings about the field direction without damping: two or more swings exceed SWING, and the
                  last complete one is at least half the largest
    chain         the line comes to rest along the field: in the last fifth of the time it is within ALIGNED of the
                  field direction and moves by less than 2 SWING, and the gap does not grow
    slanted       the line comes to rest in another direction: it moves by less than RESTING in the last fifth of the
                  time, and the membranes nearly touch
    repulsion     the vesicles separate without turning: the line stays within TURNED of its first direction, and the
                  separation is the largest at the end
    open          none of these

A swing is the motion between two passages of the line through the field direction. Directions that differ by half a
turn are equal, because the vesicles are not distinguished. Nothing here imports JAX.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

SWING = np.deg2rad(5.0)
ALIGNED = np.deg2rad(15.0)
TURNED = np.deg2rad(10.0)
RESTING = np.deg2rad(1.0)
TOUCHING = 0.1  # relative to the gap at the start
NAMES = ("open", "chain", "oscillation", "circulation", "slanted", "repulsion")

History = Float[np.ndarray, "T"]


def tilt(angle: History, field: float) -> History:
    """Returns the angle from the field direction to the line of centres, in radians, continuous in time.

    The last value is in [-π/2, π/2].
    """
    tilt = np.unwrap(np.asarray(angle, dtype=float)) - field
    return tilt - np.pi * np.round(tilt[-1] / np.pi)


def swings(tilt: History) -> Float[np.ndarray, "swings"]:
    """Returns the largest tilt of each complete swing, with its sign. A swing lies between two zeros of the tilt."""
    passages = np.flatnonzero(np.signbit(tilt[1:]) != np.signbit(tilt[:-1])) + 1
    parts = [tilt[start:end] for start, end in pairwise(passages)]
    return np.array([part[np.argmax(np.abs(part))] for part in parts])


def classify(t: History, angle: History, separation: History, gap: History, field: float) -> str:
    """Returns one of `NAMES`; rows with NaN are ignored.

    Args:
        t: the saved times (T,).
        angle: of the line of centres from x, in radians. It must change by less than half a turn between saved times.
        separation: distance of the centres.
        gap: least distance of the membranes.
        field: angle of the field from x, in radians.
    """
    known = np.isfinite(t)
    t, angle, separation, gap = (np.asarray(f, dtype=float)[known] for f in (t, angle, separation, gap))
    if len(t) == 0:
        return "open"
    delta = tilt(angle, field)
    if np.ptp(delta) >= np.pi:
        return "circulation"
    sizes = np.abs(swings(delta))
    if np.sum(sizes > SWING) >= 2 and sizes[-1] >= max(SWING, 0.5 * sizes.max()):
        return "oscillation"
    late = t >= t[-1] - 0.2 * (t[-1] - t[0])
    closing = len(t) > 1 and gap[-1] <= gap[late][0]
    if closing and np.all(np.abs(delta[late]) < ALIGNED) and np.ptp(delta[late]) < 2 * SWING:
        return "chain"
    if closing and np.ptp(delta[late]) < RESTING and gap[-1] < TOUCHING * gap[0]:
        return "slanted"
    apart = separation[-1] > separation[0] and separation[-1] == separation.max()
    if apart and np.all(np.abs(delta - delta[0]) < TURNED):
        return "repulsion"
    return "open"
