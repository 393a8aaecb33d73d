"""Linear systems that couple all membranes, solved by one factorisation or by GMRES."""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics import krylov, linear
from ..numerics.arrays import Scalar, VesicleNodes
from ..operators.interactions import AbstractInteractions
from ..operators.surfaces import Surfaces


def solve_coupled(
    blocks: linear.AbstractFactoredDense,
    respond: Callable[[AbstractInteractions, VesicleNodes], VesicleNodes],
    across: AbstractInteractions,
    b: VesicleNodes,
) -> linear.Solution:
    """Solves (B + C) x = b by GMRES. B has the factorised `blocks` of the membranes, and C x = respond(across, x).

    The blocks are the preconditioner. If the interactions have a cheaper form, Chebyshev steps with it improve it.
    """
    M, N = b.shape
    rough = across.roughly()

    def action(v):
        v = v.reshape(M, N)
        return (jnp.einsum("mij,mj->mi", blocks.operator.matrix, v) + respond(across, v)).reshape(-1)

    def own(v):
        return linear.solve_blocks(blocks, v)

    def precondition(v):
        v = v.reshape(M, N)
        if rough is None:
            return own(v).reshape(-1)
        return krylov.chebyshev(lambda x: own(v - respond(rough, x)), own(v)).reshape(-1)

    operator = linear.LinearOperator(action=action, precondition=precondition)
    return linear.GMRES(across.tolerance()).factor(operator).solve(b.reshape(-1)).reshaped(M, N)


def assembled(blocks: Float[Array, "M N N"], coupled: Float[Array, "n n"]) -> linear.AbstractFactoredDense:
    """Returns the factorised matrix of all membranes, with `blocks` on its diagonal and `coupled` off it."""
    M, N, _ = blocks.shape
    m = np.arange(M)
    whole = coupled.reshape(M, N, M, N).at[m, :, m, :].set(blocks).reshape(M * N, M * N)
    return linear.Dense().factor(linear.LinearOperator(whole))


def worst(solutions: list[linear.Solution], surfaces: Surfaces) -> tuple[Scalar, Array]:
    """Returns the largest residual and the number of iterations.

    The residual is infinite if there was no room for all near pairs.
    """
    residual, iterations = jnp.zeros(()), jnp.int32(0)
    for solution in solutions:
        residual = jnp.maximum(residual, jnp.max(solution.residual))
        iterations = iterations + jnp.max(solution.iterations)
    if surfaces.interactions is not None and surfaces.interactions.crowded is not None:
        residual = jnp.where(surfaces.interactions.crowded, jnp.inf, residual)
    return residual, iterations
