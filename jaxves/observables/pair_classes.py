"""How two vesicles in a field move about each other, from the history of the line of their centres.

    circulation   the line turned by half a turn or more: past the field's direction and on past the perpendicular
    oscillation   it swings about the field's direction, and the swings do not die away: twice or more beyond SWING,
                  the last complete one at least half of the largest
    chain         it came to rest along the field: within ALIGNED of it for the last fifth of the time, in which it
                  moves by less than 2 SWING and the gap does not widen
    slanted       it came to rest off that direction: within RESTING for as long, the membranes all but in touch
    repulsion     they move apart without turning: within TURNED of where the line was, as far apart as never before
    open          none of these yet

A swing is what lies between two passages of the line through the field's direction; which of the two vesicles is
ahead does not matter, so that directions half a turn apart are one. Nothing here imports JAX.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

SWING = np.deg2rad(5.0)
ALIGNED = np.deg2rad(15.0)
TURNED = np.deg2rad(10.0)
RESTING = np.deg2rad(1.0)
TOUCHING = 0.1  # of the gap at the start
NAMES = ("open", "chain", "oscillation", "circulation", "slanted", "repulsion")

History = Float[np.ndarray, "T"]


def tilt(angle: History, field: float) -> History:
    """From the field's direction to the line of centres, in radians, followed in time; it ends in [-π/2, π/2]."""
    tilt = np.unwrap(np.asarray(angle, dtype=float)) - field
    return tilt - np.pi * np.round(tilt[-1] / np.pi)


def swings(tilt: History) -> Float[np.ndarray, "swings"]:
    """The largest tilt, with its sign, of each complete swing: between one passage through zero and the next."""
    passages = np.flatnonzero(np.signbit(tilt[1:]) != np.signbit(tilt[:-1])) + 1
    parts = [tilt[start:end] for start, end in pairwise(passages)]
    return np.array([part[np.argmax(np.abs(part))] for part in parts])


def classify(t: History, angle: History, separation: History, gap: History, field: float) -> str:
    """One of `NAMES`; rows with NaN are ignored.

    `angle` of the line of centres from x in radians, saved often enough to be followed from row to row,
    `separation` of the centres, `gap` between the membranes, `field` the angle of the field from x.
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
