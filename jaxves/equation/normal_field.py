r"""The integral equation for the mean normal field g of all membranes, for densities that are affine in g.

    g = E_∞·n - S'q + D'V,     q = q_0 + q_1 g,  V = V_0 + V_1 g        (laws of charging: `physics/charging.py`)
    (1 + S' q_1 - D' V_1) g = E_∞·n - S' q_0 + D' V_0

If no membrane has a net charge, the mean of g is zero. The equation implies this except for a perfect conductor inside,
q_1 = 2, where it leaves the mean open. The mean is then added to the left-hand side, which is regular for all q_1.

There are K components of g, which the coefficients q_1 and V_1 may couple: one for a real field, and two, the real and
the imaginary part, for a complex envelope. -D' is positive, so the equation is well posed for V_1 >= 0.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics import fourier, linear
from ..numerics.arrays import VesicleNodes
from ..operators.interactions import AbstractInteractions, pair_frames
from ..operators.surfaces import Surfaces
from .coupled import assembled, solve_coupled

Components = Float[Array, "M K N"]
Couplings = Float[Array, "M K K"]


def solve_normal_field(
    surfaces: Surfaces,
    E_inf: Float[Array, "K 2"],
    q: tuple[Components, Couplings],
    V: tuple[Components, Couplings],
    *,
    neutral: bool,
    direct: bool,
) -> tuple[Components, linear.Solution]:
    """Returns g (M, K, N) for q = (q_0, q_1) and V = (V_0, V_1), and the linear solution.

    `neutral` says that no membrane has a net charge. With `direct`, the system that couples membranes is factorised and
    not solved by GMRES.
    """
    curves, across = surfaces.curves, surfaces.interactions
    (q0, q1), (V0, V1) = q, V
    M, K, N = q0.shape
    flux = jnp.einsum("mna,ka->mkn", curves.normal, E_inf)
    flux = flux + jnp.stack([surfaces.dlp_dn(V0[:, k]) - _slp_dn(surfaces, q0[:, k]) for k in range(K)], axis=1)
    b = flux.reshape(M, K * N)
    mean = curves.speed / jnp.sum(curves.speed, axis=1, keepdims=True) if neutral else None
    matrices = jax.vmap(_own_matrix)(_own_slp_dn(surfaces), _own_dlp_dn(surfaces), q1, V1, mean)
    if across is None:
        solver = linear.Elimination()
        solution = jax.vmap(lambda matrix, b: solver.factor(linear.LinearOperator(matrix)).solve(b))(matrices, b)
        return solution.value.reshape(M, K, N), solution
    if direct:
        solution = assembled(matrices, _across_matrix(surfaces, q1, V1)).solve(b.reshape(-1))
        return solution.value.reshape(M, K, N), solution

    def respond(across, g):
        g = g.reshape(M, K, N)
        parts = _across(surfaces, across, jnp.einsum("mkl,mln->mkn", q1, g), jnp.einsum("mkl,mln->mkn", V1, g))
        return parts.reshape(M, K * N)

    solution = solve_coupled(linear.factor_blocks(matrices), respond, across, b)
    return solution.value.reshape(M, K, N), solution


def _own_slp_dn(surfaces: Surfaces) -> Float[Array, "M N N"]:
    return surfaces.laplace_slp_dn * surfaces.curves.speed[:, None, :]


def _own_dlp_dn(surfaces: Surfaces) -> Float[Array, "M N N"]:
    D = fourier.derivative_matrix(surfaces.curves.speed.shape[1])
    return (D @ (surfaces.laplace_slp @ D)) / surfaces.curves.speed[:, :, None]


def _own_matrix(slp_dn, dlp_dn, q1, V1, mean) -> Float[Array, "n n"]:
    """Returns 1 + S' q_1 - D' V_1 of one membrane, plus the mean if it is given, ordered by component, node."""
    K, N = q1.shape[0], slp_dn.shape[0]
    blocks = q1[:, None, :, None] * slp_dn[None, :, None, :] - V1[:, None, :, None] * dlp_dn[None, :, None, :]
    if mean is not None:
        blocks = blocks + np.eye(K)[:, None, :, None] * mean
    return np.eye(K * N) + blocks.reshape(K * N, K * N)


def _slp_dn(surfaces: Surfaces, q: VesicleNodes) -> VesicleNodes:
    """Returns S'[q] at all nodes."""
    value = jnp.einsum("mij,mj->mi", surfaces.laplace_slp_dn, surfaces.curves.speed * q)
    if surfaces.interactions is not None:
        value = value + jnp.sum(surfaces.curves.normal * surfaces.interactions.slp_gradient(q), axis=-1)
    return value


def _across(surfaces: Surfaces, across: AbstractInteractions, q: Components, V: Components) -> Components:
    """Returns S'[q] - D'[V] of the other membranes."""
    curves = surfaces.curves

    def of_one(q, V):
        of_V = across.slp_gradient(surfaces.d_ds(V))
        return jnp.sum(curves.normal * across.slp_gradient(q) - curves.tangent * of_V, axis=-1)

    return jnp.stack([of_one(q[:, k], V[:, k]) for k in range(q.shape[1])], axis=1)


def _across_matrix(surfaces: Surfaces, q1: Couplings, V1: Couplings) -> Float[Array, "n n"]:
    """Returns the matrix of S' q_1 - D' V_1 from the other membranes, ordered by membrane, component, node."""
    pairs = surfaces.interactions.matrices()
    target, source = pair_frames(surfaces.curves)
    _, sources = pairs.ordered()
    D = fourier.derivative_matrix(surfaces.curves.speed.shape[1])
    count, _, N, _ = pairs.gradient.shape
    K = q1.shape[1]
    normal, tangent = (jnp.moveaxis(frame, -1, 1)[..., None] for frame in (target.normal, target.tangent))
    slp_dn = jnp.sum(normal * pairs.gradient, axis=1)
    dlp_dn = (jnp.sum(tangent * pairs.gradient, axis=1) / source.speed[:, None, :]) @ D
    blocks = jnp.einsum("pkl,pij->pkilj", q1[sources], slp_dn) - jnp.einsum("pkl,pij->pkilj", V1[sources], dlp_dn)
    return pairs.scattered(blocks.reshape(count, K * N, K * N))
