"""Linear solves: every way agrees with NumPy in value, derivative and honesty."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.numerics import linear
from jaxves.numerics.linear import GMRES, Dense, Elimination, LinearOperator, factor_blocks

RNG = np.random.default_rng(1)
N = 40
LEFT = RNG.normal(size=(N, N))
GENERAL = jnp.asarray(np.eye(N) + 0.4 * LEFT / np.sqrt(N))
DEFINITE = jnp.asarray(LEFT @ LEFT.T / N + np.eye(N))
B = jnp.asarray(RNG.normal(size=N))
DIRECTION = jnp.asarray(RNG.normal(size=(N, N)))


def operator(kind, matrix):
    if kind == "action":
        inverse_diagonal = 1 / jnp.diag(matrix)
        return LinearOperator(action=lambda v: matrix @ v, precondition=lambda v: inverse_diagonal * v)
    return LinearOperator(matrix, positive_definite=kind == "definite")


@pytest.mark.parametrize(
    ("solver", "kind", "matrix"),
    [
        (Dense(), "general", GENERAL),
        (Dense(), "definite", DEFINITE),
        (GMRES(tol=1e-12), "general", GENERAL),
        (GMRES(tol=1e-12), "action", DEFINITE),
    ],
)
def test_solvers_agree_with_numpy_in_value_and_derivative(solver, kind, matrix):
    exact = np.linalg.solve(matrix, B)

    @jax.jit
    def solution(matrix):
        return solver.factor(operator(kind, matrix)).solve(B)

    found = solution(matrix)
    np.testing.assert_allclose(found.value, exact, rtol=1e-9, atol=1e-10)
    assert found.residual < 1e-11
    assert (found.iterations > 0) == isinstance(solver, GMRES)

    symmetric = DIRECTION + DIRECTION.T if kind == "definite" else DIRECTION
    slope = -np.linalg.solve(matrix, symmetric @ exact)
    forward = jax.jvp(lambda A: solution(A).value, (matrix,), (symmetric,))[1]
    np.testing.assert_allclose(forward, slope, rtol=1e-7, atol=1e-8)
    gradient = jax.grad(lambda A: jnp.sum(jnp.sin(solution(A).value)))(matrix)
    np.testing.assert_allclose(jnp.sum(gradient * symmetric), np.cos(exact) @ slope, rtol=1e-7)


def test_what_cannot_be_solved_shows_in_the_residual():
    indefinite = jnp.diag(jnp.array([1.0, -1.0, 2.0]))
    b = jnp.ones(3)
    assert not Dense().factor(LinearOperator(indefinite, positive_definite=True)).solve(b).residual < 1e-6
    few = GMRES(tol=1e-12, restart=2, max_cycles=1)
    hard = jnp.diag(jnp.logspace(0, 6, N))
    assert few.factor(LinearOperator(hard)).solve(B).residual > 1e-6
    poisoned = few.factor(LinearOperator(hard.at[0, 0].set(jnp.nan))).solve(B)
    assert not poisoned.residual < 1e-6


@pytest.mark.parametrize("count", [1, 3])
def test_blocks_are_solved_one_by_one(count):
    matrices = jnp.stack([DEFINITE + m * jnp.eye(N) for m in range(count)])
    for definite in (True, False):
        solve = jax.jit(jax.vmap(lambda factored: factored.solve(B).value))
        found = solve(factor_blocks(matrices, positive_definite=definite))
        np.testing.assert_allclose(found, np.linalg.solve(matrices, B), rtol=1e-10, atol=1e-12)


def test_on_a_cpu_no_batched_factorisation_is_compiled():
    """Batched LAPACK calls can lock up the thread pool they run on."""
    matrices = jnp.stack([DEFINITE] * 3)
    text = jax.jit(lambda m: jax.vmap(lambda f: f.solve(B).value)(factor_blocks(m))).lower(matrices).as_text()
    calls = [line for line in text.splitlines() if "lapack" in line or ("lu" in line and "custom_call" in line)]
    assert calls
    assert not any(f"tensor<3x{N}x{N}" in line for line in calls)


def test_elimination_in_batches_of_a_gpu_is_elimination():
    """The form that other platforms batch, here by the host's own routines, gives what the loop over LAPACK gives."""
    matrices = jnp.stack([GENERAL, GENERAL.T, DEFINITE])
    right = jnp.stack([B, 2 * B, B[::-1]])
    looped = jax.vmap(lambda A, b: Elimination().factor(LinearOperator(A)).solve(b).value)(matrices, right)
    np.testing.assert_allclose(looped, np.linalg.solve(matrices, right[..., None])[..., 0], rtol=1e-9, atol=1e-10)
    batched = jax.vmap(linear._factored_and_solved)(matrices, right)
    np.testing.assert_allclose(batched, looped, rtol=1e-10, atol=1e-12)
