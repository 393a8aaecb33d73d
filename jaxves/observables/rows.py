"""Everything that is saved at one time."""

import jax
from jaxtyping import Array

from ..equation import tracking
from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..numerics.arrays import PerVesicle, Scalar
from ..physics import membrane
from . import diagnostics


def observe(
    equation: Equation, t: Scalar, y: Unknowns, angle: PerVesicle, time_error: Scalar | None
) -> dict[str, Array]:
    """Returns everything that is saved at one time, as a flat dictionary with the names of the result file.

    `angle` (M,) are the unwrapped inclinations before, `time_error` is the sum of the embedded errors so far.
    """
    motion = equation.motion(t, y)
    tension = jax.vmap(membrane.physical_tension)(motion.surfaces.curves, motion.sigma, equation.scene.bending)
    out = {"t": t, "x": y.x, "tension": tension}
    if y.V_m is not None:
        out["V_m"] = y.V_m
    found = diagnostics.diagnose(equation, t, y, motion)
    found["inclination_unwrapped"] = tracking.turned(angle, found["inclination"])
    if time_error is not None:
        found["time_error"] = time_error
    return out | {f"diagnostics/{name}": value for name, value in found.items()}
