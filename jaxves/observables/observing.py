"""Computes everything that is saved at one time."""

import jax

from ..equation import tracking
from ..equation.equation import Equation
from ..equation.state import Motion, Unknowns
from ..numerics.arrays import PerVesicle, Scalar
from ..physics import membrane
from . import diagnostics
from .rows import Row


def observe(
    equation: Equation, t: Scalar, y: Unknowns, motion: Motion, angle: PerVesicle, time_error: Scalar | None
) -> Row:
    """Returns everything that is saved at one time.

    `motion` is `equation.motion(t, y)`. `angle` (M,) are the unwrapped inclinations before, and `time_error` is the sum
    of the embedded errors so far.
    """
    tension = jax.vmap(membrane.physical_tension)(motion.surfaces.curves, motion.sigma, equation.scene.bending)
    found = diagnostics.diagnose(equation, t, y, motion)
    found["inclination_unwrapped"] = tracking.turned(angle, found["inclination"])
    if time_error is not None:
        found["time_error"] = time_error
    V_m = None if motion.electric is None else motion.electric.potential(y.scalars)
    return Row(t, y.x, tension, found, V_m, scalars={name: f for name, f in y.scalars.items() if name != "V_m"})
