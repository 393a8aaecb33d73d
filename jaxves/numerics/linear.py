r"""One interface for direct and iterative linear solvers.

    factored = solver.factor(operator)      once
    solution = factored.solve(b)            for each right-hand side

`Solution` has the true relative residual |b - A x|/|b| and the number of iterations, so that a solution that has not
converged, or is NaN, can be recognised. Derivatives are implicit: they take one more solve with A or its transpose, and
do not differentiate a factorisation or an iteration.
"""

import abc
import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from . import krylov
from .arrays import Scalar

Vector = Float[Array, "n"]


class Solution(eqx.Module):
    """The solution x of A x = b, the residual |b - A x| / |b| (0 for b = 0), and the iterations (0: direct)."""

    value: Float[Array, "*rest"]
    residual: Scalar
    iterations: Int[Array, ""]

    def reshaped(self, *shape: int) -> "Solution":
        """Returns the same solution with x reshaped."""
        return Solution(self.value.reshape(shape), self.residual, self.iterations)


class LinearOperator(eqx.Module):
    """A square matrix A, given as a dense `matrix`, by its `action` v ↦ A v, or both.

    `precondition` is an approximate inverse for iterative solvers. `positive_definite` states that the matrix is
    symmetric positive definite, which halves the cost of a dense factorisation.
    """

    matrix: Float[Array, "n n"] | None = None
    action: Callable[[Vector], Vector] | None = None
    precondition: Callable[[Vector], Vector] | None = None
    positive_definite: bool = eqx.field(static=True, default=False)

    def mv(self, v: Vector) -> Vector:
        """Returns A v."""
        return self.matrix @ v if self.action is None else self.action(v)


class AbstractFactored(eqx.Module):
    """A linear operator that is prepared for solving."""

    @abc.abstractmethod
    def solve(self, b: Vector) -> Solution:
        """Solves A x = b."""


class AbstractSolver(eqx.Module):
    """A method for solving linear systems."""

    @abc.abstractmethod
    def factor(self, operator: LinearOperator) -> AbstractFactored:
        """Does the part of the work that does not depend on the right-hand side."""


def _one_by_one(function, together=None):
    """Wraps a LAPACK call so that on CPUs a batch is a loop, because JAX's batched calls can deadlock there.

    A batched call waits for worker threads of the thread pool in which it runs itself. Two such calls in a compiled
    loop can wait for each other forever (jaxlib 0.10). On other platforms a batch uses `jax.vmap` of `together`
    (default: `function`), which must compute the same.
    """
    together = together or function
    single = jax.custom_batching.custom_vmap(function)

    @single.def_vmap
    def batched(size, is_batched, *args):
        if size == 1:  # avoids the overhead of a loop
            out = single(*(arg[0] if flag else arg for arg, flag in zip(args, is_batched, strict=True)))
            return jax.tree.map(lambda leaf: leaf[None], out), jax.tree.map(lambda _: True, out)
        args = [
            arg if flag else jnp.broadcast_to(arg, (size, *arg.shape))
            for arg, flag in zip(args, is_batched, strict=True)
        ]
        out = lax.platform_dependent(
            *args, cpu=lambda *args: lax.map(lambda one: single(*one), args), default=jax.vmap(together)
        )
        return out, jax.tree.map(lambda _: True, out)

    return single


@_one_by_one
def _lu(matrix):
    lu, _, order = lax.linalg.lu(matrix)
    return lu, order


@_one_by_one
def _cholesky(matrix):
    return lax.linalg.cholesky(matrix, symmetrize_input=False)


def _triangular(*, lower: bool, transpose: bool = False, unit: bool = False):
    return _one_by_one(
        functools.partial(
            lax.linalg.triangular_solve, left_side=True, lower=lower, transpose_a=transpose, unit_diagonal=unit
        )
    )


_solve_unit_lower = _triangular(lower=True, unit=True)
_solve_unit_lower_transposed = _triangular(lower=True, unit=True, transpose=True)
_solve_lower = _triangular(lower=True)
_solve_lower_transposed = _triangular(lower=True, transpose=True)
_solve_upper = _triangular(lower=False)
_solve_upper_transposed = _triangular(lower=False, transpose=True)


class AbstractFactoredDense(AbstractFactored):
    """A linear operator with triangular factors of `operator.matrix`."""

    operator: eqx.AbstractVar[LinearOperator]

    @abc.abstractmethod
    def _substitute(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Returns A⁻¹ b by substitution."""

    @abc.abstractmethod
    def _substitute_transposed(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Returns A⁻ᵀ b by substitution."""

    def solve_columns(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Applies A⁻¹ to every column of b."""
        return lax.custom_linear_solve(
            lambda v: self.operator.matrix @ v,
            b,
            solve=lambda _, b: self._substitute(b),
            transpose_solve=lambda _, b: self._substitute_transposed(b),
        )

    def solve(self, b: Vector) -> Solution:
        x = self.solve_columns(b[:, None])[:, 0]
        return Solution(x, krylov.relative_residual(b - self.operator.mv(x), b), jnp.int32(0))


def _eliminated(matrix, b):
    """Returns A⁻¹ b: the LU factorisation of [A b] gives U and L⁻¹ P b."""
    n = matrix.shape[0]
    reduced, _, _ = lax.linalg.lu(jnp.concatenate([matrix, b[:, None]], axis=1))
    return lax.linalg.triangular_solve(reduced[:, :n], reduced[:, n:], left_side=True, lower=False)[:, 0]


def _factored_and_solved(matrix, b):
    """Returns A⁻¹ b for GPUs: their libraries factorise a batch of square matrices at once, but not of others."""
    lu, _, order = lax.linalg.lu(matrix)
    z = lax.linalg.triangular_solve(lu, b[order][:, None], left_side=True, lower=True, unit_diagonal=True)
    return lax.linalg.triangular_solve(lu, z, left_side=True, lower=False)[:, 0]


_eliminate = _one_by_one(_eliminated, together=_factored_and_solved)


class Eliminated(AbstractFactored):
    """Repeats the elimination for each right-hand side; nothing is factorised beforehand."""

    operator: LinearOperator

    def solve(self, b: Vector) -> Solution:
        matrix = lax.stop_gradient(self.operator.matrix)
        x = lax.custom_linear_solve(
            self.operator.mv,
            b,
            solve=lambda _, b: _eliminate(matrix, b),
            transpose_solve=lambda _, b: _eliminate(matrix.T, b),
        )
        return Solution(x, krylov.relative_residual(b - self.operator.mv(x), b), jnp.int32(0))


class Elimination(AbstractSolver):
    """Gaussian elimination with partial pivoting for a single right-hand side.

    It is then cheaper than `Dense`, because the row order is not needed, which LAPACK returns as a sequence of swaps.
    """

    def factor(self, operator: LinearOperator) -> Eliminated:
        return Eliminated(operator)


class FactoredLU(AbstractFactoredDense):
    """The factors of P A = L U in one array, and the row order that P describes."""

    operator: LinearOperator
    lu: Float[Array, "n n"]
    order: Int[Array, "n"]

    def _substitute(self, b):
        return _solve_upper(self.lu, _solve_unit_lower(self.lu, b[self.order]))

    def _substitute_transposed(self, b):
        z = _solve_unit_lower_transposed(self.lu, _solve_upper_transposed(self.lu, b))
        return jnp.zeros_like(z).at[self.order].set(z)


class FactoredCholesky(AbstractFactoredDense):
    """The factor of A = L Lᵀ. It is NaN if A is not positive definite; the residual is then NaN as well."""

    operator: LinearOperator
    lower: Float[Array, "n n"]

    def _substitute(self, b):
        return _solve_lower_transposed(self.lower, _solve_lower(self.lower, b))

    _substitute_transposed = _substitute


class Dense(AbstractSolver):
    """Cholesky if the operator is stated to be positive definite, otherwise LU with partial pivoting."""

    def factor(self, operator: LinearOperator) -> AbstractFactoredDense:
        # Solutions are differentiated implicitly, so the factors need no derivative.
        matrix = lax.stop_gradient(operator.matrix)
        if operator.positive_definite:
            return FactoredCholesky(operator, _cholesky(matrix))
        return FactoredLU(operator, *_lu(matrix))


class FactoredGMRES(AbstractFactored):
    """Solves by GMRES, with the operator's `precondition` from the right; nothing is factorised."""

    operator: LinearOperator
    tol: float = eqx.field(static=True)
    restart: int = eqx.field(static=True)
    max_cycles: int = eqx.field(static=True)

    def solve(self, b: Vector) -> Solution:
        precondition = self.operator.precondition or (lambda v: v)
        transposed = jax.linear_transpose(precondition, b)

        def iterate(mv, precondition, b):
            x, *found = krylov.gmres(
                mv, precondition, b, tol=self.tol, restart=self.restart, max_cycles=self.max_cycles
            )
            return x, found

        x, (residual, count) = lax.custom_linear_solve(
            self.operator.mv,
            b,
            solve=lambda mv, b: iterate(mv, precondition, b),
            transpose_solve=lambda mv, b: iterate(mv, lambda v: transposed(v)[0], b),
            has_aux=True,
        )
        return Solution(x, residual, count)


class GMRES(AbstractSolver):
    """Restarted GMRES. It stops when the true residual is below `tol` or a cycle does not halve it."""

    tol: float = eqx.field(static=True, default=1e-11)
    restart: int = eqx.field(static=True, default=30)
    max_cycles: int = eqx.field(static=True, default=5)

    def factor(self, operator: LinearOperator) -> FactoredGMRES:
        return FactoredGMRES(operator, self.tol, self.restart, self.max_cycles)


def for_second_kind(n: int) -> AbstractSolver:
    """Returns the faster solver for one right-hand side of a well-conditioned second-kind system of n unknowns.

    By the measurements of `experiments/solvers.py`, GMRES takes 2 to 10 iterations for every n. It becomes faster than
    LU between 128 and 256 unknowns and is nine times faster at 512. Stiff systems are solved with dense factors, which
    the implicit steps need anyway.
    """
    return Elimination() if n < 256 else GMRES()


def factor_blocks(matrices: Float[Array, "M n n"], *, positive_definite: bool = False) -> AbstractFactoredDense:
    """Factorises each block of a block-diagonal matrix; the first axis counts the blocks."""
    return jax.vmap(lambda A: Dense().factor(LinearOperator(A, positive_definite=positive_definite)))(matrices)


def solve_blocks(blocks: AbstractFactoredDense, b: Float[Array, "M n"]) -> Float[Array, "M n"]:
    """Solves with each of the factorised blocks."""
    return jax.vmap(lambda block, b: block.solve_columns(b[:, None])[:, 0])(blocks, b)
