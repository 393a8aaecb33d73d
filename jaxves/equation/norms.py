r"""How large an error or a change of the unknowns is, and whether a state can be stepped on from.

Step control asks these functions, so that it need not know what the unknowns mean. No derivative is taken of what
they return.

With steps at the edge of stability of the explicit stages, round-off in the highest modes grows until the error
estimate sees it. It then has the size of the tolerance, which is a thousand times what a smooth solution has in these
modes, and is far larger in curvature and tension. `excess` measures the errors of these modes alone.
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

_HIGHEST = 0.25  # share of the modes left by the filter of x that `excess` looks at
_PART = 0.03  # errors in them below this part of their content are no excess
ROUGH = 3e-3  # a spectrum whose top exceeds this part of its largest mode is not resolved


def error_size(error: Unknowns) -> Scalar:
    """The largest error of any node in position or potential; NaN when any is."""
    return lax.stop_gradient(_largest((error.x, error.scalars)))


def excess(equation: Equation, error: Unknowns, y: Unknowns) -> Scalar:
    """By how much the error in the highest modes exceeds 3 % of what y has in them; may be negative."""
    N = y.x.shape[1]
    cut = N // 2 - round((1 - _HIGHEST) * (N // 2 - equation.filter.x))

    def highest(f):
        return jnp.max(jnp.abs(f - fourier.low_pass(f, cut, axis=1)))

    parts = lax.stop_gradient(((error.x, error.scalars), (y.x, y.scalars)))
    pairs = zip(*map(jax.tree.leaves, parts), strict=True)
    return jnp.max(jnp.stack([highest(e) - _PART * highest(f) for e, f in pairs]))


def displacement(y: Unknowns, other: Unknowns) -> Scalar:
    """The largest difference of any coordinate of a node between two states; NaN when any is."""
    return _largest((y.x - other.x,))


def solve_status(frozen: Frozen) -> Status:
    """RUNNING, or what the linear solves at a frozen state say against it: SOLVE_FAILED or CROWDED."""
    return verdict(frozen.motion.residual)


def step_status(equation: Equation, frozen: Frozen, y: Unknowns, rough: float) -> Status:
    """RUNNING, or why a step from a frozen state to y ends the run.

    `rough` is the largest ratio of the top of a spectrum to its largest mode that counts as resolved.
    """
    code = verdict(frozen.motion.residual)
    unresolved = _is_rough(equation, frozen.motion, y, rough)
    code = jnp.where((code == status.RUNNING) & unresolved, status.UNRESOLVED, code)
    # Crowded interactions make the step NaN: say why.
    finite = jnp.isfinite(_largest((y.x, y.scalars))) | (code == status.CROWDED)
    return jnp.where(finite, code, status.NOT_FINITE)


def _is_rough(equation: Equation, motion: Motion, y: Unknowns, rough: float) -> Bool[Array, ""]:
    """Whether the shape has a rough spectrum, or wrinkles finer than the nodes resolve would grow in it.

    Wrinkles may come and go between saved instants, and leave a smooth shape that is not the right one.
    """
    cut, N = equation.filter.x, y.x.shape[1]

    def of_one(x, curve, sigma, bending):
        finest = membrane.fastest_wrinkle(curve, sigma, bending)
        return (fourier.spectral_tail(x, cut) > rough) | (finest > N // 2 - cut)

    found = jax.vmap(of_one)(y.x, motion.surfaces.curves, motion.sigma, equation.scene.bending)
    return lax.stop_gradient(jnp.any(found))


def _largest(leaves) -> Scalar:
    """Largest absolute entry of all arrays; NaN when any is."""
    return jnp.max(jnp.stack([jnp.max(jnp.abs(leaf)) for leaf in jax.tree.leaves(leaves)]))
