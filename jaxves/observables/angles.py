"""Whether the inclination of a vesicle turns, or only jumps. Nothing here imports JAX."""

import numpy as np
from jaxtyping import Bool, Float

_JUMP = 45.0  # degrees; the axis jumps by 90


def jumps(degrees: Float[np.ndarray, "T *M"]) -> Bool[np.ndarray, "T-1 *M"]:
    """Returns whether an angle jumps between neighbouring times.

    The direction of the major axis jumps by a right angle when a shape passes through a square or a circle.
    """
    return np.abs(np.diff(degrees, axis=0)) > _JUMP


def only_jumps(degrees: Float[np.ndarray, "T M"]) -> bool:
    """Returns whether an angle jumps and does not turn otherwise: the shape passes through a circle and back."""
    return bool(np.any(jumps(degrees))) and not turns(degrees)


def turns(degrees: Float[np.ndarray, "T M"]) -> bool:
    """Returns whether an angle changes by more than a degree in total, without its `jumps`."""
    steps = np.where(jumps(degrees), 0.0, np.abs(np.diff(degrees, axis=0)))
    return bool(np.any(np.nansum(steps, axis=0) > 1))
