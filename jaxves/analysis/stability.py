r"""Linear stability of a steady state of one vesicle: growth rates of small disturbances, their modes, derivatives.

The growth rates s are the eigenvalues of the linearised motion L (`disturbances`). With right and left eigenvectors r
and l of a simple eigenvalue, ds = lᵀ dL r/lᵀr. L contains the steady state, which changes with the numbers of the scene
as well.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Complex, Float

from ..base.arguments import refusal, require_count
from ..equation.cells import may_keep_symmetry
from ..equation.equation import equation_for
from ..equation.state import Unknowns
from ..numerics.linear import AbstractSolver
from ..physics.scene import Scene
from .disturbances import broken, linearisation, remaining
from .steady import Steady, steady_shape


class Stability(eqx.Module):
    """The leading growth rates of a steady state, the largest real part first, and their modes.

    `rates` (K,) are in 1/t_κ. A mode is the normal displacement `shapes` (K, N) and the change of each of the `scalars`
    by name, (K, N) each, with the norm 1 together. `breaks` has, for each symmetry in words, the share (K,) of the
    square of each mode that breaks it, and NaN if the steady state does not have this symmetry. `steady` is the steady
    state. Rates are NaN if it was not found, and where there are fewer modes than rates.
    """

    rates: Complex[Array, "K"]
    shapes: Complex[Array, "K N"]
    scalars: dict[str, Complex[Array, "K N"]]
    breaks: dict[str, Float[Array, "K"]]
    steady: Steady

    @property
    def is_stable(self) -> Bool[Array, ""]:
        """Whether the steady state was found and no small disturbance of it grows."""
        return self.steady.converged & ~jnp.any(self.rates.real >= 0)


def stability(scene: Scene, start: Unknowns, *, count: int = 4, solver: AbstractSolver | None = None) -> Stability:
    """Returns the `count` leading growth rates of the steady state near `start`, and their modes.

    The function is pure. The rates are differentiable once, forward or reverse, in everything the scene depends on,
    where they are simple eigenvalues. The modes have no derivative. A disturbance may break the symmetries that a run
    keeps. Area, perimeter and net charge are kept, and motions that change nothing, as translations, do not count.

    Args:
        scene: one vesicle with its area and perimeter, and field and flow at t = 0.
        start: a state near the steady one, as for `jaxves.steady_shape`.
        count: how many rates are returned.
        solver: solver for the charge; the default depends on the number of nodes.

    Raises:
        ValueError: the scene has several vesicles, is in a periodic cell, or has a field that is not uniform or a flow
            whose gradient is not. A translation is no neutral motion in these. Or field or flow has a period that is
            not averaged over, so that there is no steady state.
    """
    require_count("count", count)
    if scene.periods():
        wanted = "one with a steady state, as in AC(..., averaged=True); for a periodic motion compare disturbed runs"
        raise refusal("scene", "a field or flow with a period", wanted)
    if not may_keep_symmetry(scene):
        raise refusal("scene", "not symmetric about a point", "free space, a uniform field, and a flow linear in x")
    return _analysed(scene, steady_shape(scene, start, solver=solver), count, solver)


@eqx.filter_jit
def _analysed(scene: Scene, steady: Steady, count: int, solver: AbstractSolver | None) -> Stability:
    equation, y = equation_for(scene, solver=solver, keep_symmetry=False), steady.y
    kept = remaining(equation, y, rotation=scene.flow is None and scene.field is None)
    matrix = kept @ linearisation(equation, y) @ kept
    # The directions that are left out get a rate below all others.
    lowest = -1.0 - 2.0 * jax.lax.stop_gradient(jnp.linalg.norm(matrix))
    rates, right = leading(matrix + lowest * (jnp.eye(len(matrix)) - kept), min(count, len(matrix)))
    unflatten = ravel_pytree((y.x[0, :, 0], {name: scalar[0] for name, scalar in y.scalars.items()}))[1]
    real, imaginary = (jax.vmap(unflatten)(part) for part in (right.real, right.imag))
    shapes, scalars = jax.tree.map(lambda re, im: re + 1j * im, real, imaginary)
    exists = steady.converged & (jnp.arange(len(rates)) < jnp.trace(kept) - 0.5)
    shares = broken(equation, jax.lax.stop_gradient(y), shapes, scalars)
    rates, shares = jax.tree.map(lambda value: jnp.where(exists, value, jnp.nan), (rates, shares))
    return Stability(rates, shapes, scalars, shares, steady)


def leading(matrix: Float[Array, "n n"], count: int) -> tuple[Complex[Array, "K"], Complex[Array, "K n"]]:
    """Returns the eigenvalues with the largest real parts, and their right eigenvectors of norm 1.

    The eigenvalues have the derivatives of simple ones. The eigenvectors have none.
    """
    values, right = jnp.linalg.eig(jax.lax.stop_gradient(matrix))
    order = jnp.argsort(-values.real)[:count]
    left = jnp.linalg.solve(right.T, jnp.eye(len(matrix), dtype=right.dtype)[:, order]).T  # lᵀr = 1
    right = jax.lax.stop_gradient(right.T[order])
    return jnp.einsum("ka,ab,kb->k", jax.lax.stop_gradient(left), matrix, right), right
