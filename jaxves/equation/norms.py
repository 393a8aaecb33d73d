r"""Sizes of errors and changes of the unknowns, and the checks after each step.

Step-size control uses these functions, so that it does not depend on the meaning of the unknowns. Their results have no
derivative.

If stability limits the steps, round-off in the highest modes grows until the error estimate notices it. It then has the
size of the tolerance. This is a thousand times the content of a smooth solution in these modes, and the effect on
curvature and tension is much larger. `excess` measures the errors of these modes only.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool

from ..base import status
from ..numerics import fourier
from ..numerics.arrays import Scalar, Status
from ..physics import membrane
from .equation import Equation
from .implicit import Frozen
from .state import Motion, Unknowns, verdict

_HIGHEST = 0.25  # fraction of the modes that `excess` uses, of those that the filter of x keeps
_PART = 0.03  # errors below this fraction of the content of these modes are ignored
ROUGH = 3e-3  # a spectrum is not resolved if its top exceeds this fraction of its largest mode


def error_size(error: Unknowns) -> Scalar:
    """Returns the largest error of any node in position or potential; NaN if any is NaN."""
    return lax.stop_gradient(_largest((error.x, error.scalars)))


def excess(equation: Equation, error: Unknowns, y: Unknowns) -> Scalar:
    """Returns the error in the highest modes minus 3 % of the content of y in these modes; may be negative."""
    N = y.x.shape[1]
    cut = N // 2 - round((1 - _HIGHEST) * (N // 2 - equation.filter.x))

    def highest(f):
        return jnp.max(jnp.abs(f - fourier.low_pass(f, cut, axis=1)))

    parts = lax.stop_gradient(((error.x, error.scalars), (y.x, y.scalars)))
    pairs = zip(*map(jax.tree.leaves, parts), strict=True)
    return jnp.max(jnp.stack([highest(e) - _PART * highest(f) for e, f in pairs]))


def displacement(y: Unknowns, other: Unknowns) -> Scalar:
    """Returns the largest difference of any coordinate of a node between two states; NaN if any is NaN."""
    return _largest((y.x - other.x,))


def solve_status(equation: Equation, frozen: Frozen) -> Status:
    """Returns RUNNING, or SOLVE_FAILED or CROWDED if the linear solves at this state failed."""
    return verdict(frozen.motion.residual, equation.coupling)


def step_status(
    equation: Equation, frozen: Frozen, y: Unknowns, rough: float, nodes_per_wave: float | None = None
) -> Status:
    """Returns RUNNING, or the status with which a step from a frozen state to y ends the run.

    `rough` is the largest ratio of the top of a spectrum to its largest mode for a resolved shape. `nodes_per_wave` is
    the least number of nodes for a wave of the fastest growing wrinkle. If it is None, the wrinkle must only be a mode
    that the nodes keep.
    """
    code = verdict(frozen.motion.residual, equation.coupling)
    unresolved = _is_rough(equation, frozen.motion, y, rough, nodes_per_wave)
    code = jnp.where((code == status.RUNNING) & unresolved, status.UNRESOLVED, code)
    # If interactions are crowded, the step is NaN. The status is then CROWDED.
    finite = jnp.isfinite(_largest((y.x, y.scalars))) | (code == status.CROWDED)
    return jnp.where(finite, code, status.NOT_FINITE)


def fastest_growth(equation: Equation, frozen: Frozen) -> Scalar:
    """Returns the growth rate of the fastest growing wrinkle at a frozen state; 0 without compression.

    Waves between two fluids of viscosities 1 and ν move 2/(1 + ν) times as fast as in one fluid.
    """
    motion, ratio = frozen.motion, equation.scene.viscosity_ratio

    def of_one(curve, sigma, bending):
        return membrane.wrinkle_growth(curve, membrane.physical_tension(curve, sigma, bending), bending)

    found = jax.vmap(of_one)(motion.surfaces.curves, motion.sigma, equation.scene.bending)
    found = found if ratio is None else found * 2 / (1 + ratio)
    return lax.stop_gradient(jnp.max(found))


def _is_rough(
    equation: Equation, motion: Motion, y: Unknowns, rough: float, nodes_per_wave: float | None
) -> Bool[Array, ""]:
    """Returns whether the shape has a rough spectrum, or wrinkles grow in it that the nodes do not resolve.

    Wrinkles may appear and vanish between saved times, and leave a smooth shape that is wrong.
    """
    cut, N = equation.filter.x, y.x.shape[1]

    def of_one(x, curve, sigma, bending):
        if nodes_per_wave is None:
            unresolved = membrane.fastest_wrinkle(curve, sigma, bending) > N // 2 - cut
        else:  # σ is less than the tension of a strongly curved tip, which does not wrinkle
            tension = membrane.physical_tension(curve, sigma, bending)
            unresolved = nodes_per_wave * membrane.fastest_wrinkle(curve, tension, bending) > N
        return (fourier.spectral_tail(x, cut) > rough) | unresolved

    found = jax.vmap(of_one)(y.x, motion.surfaces.curves, motion.sigma, equation.scene.bending)
    return lax.stop_gradient(jnp.any(found))


def _largest(leaves) -> Scalar:
    """Returns the largest absolute entry of all arrays; NaN if any is NaN."""
    return jnp.max(jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(leaves)]))
