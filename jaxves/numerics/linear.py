r"""Linear solves behind one interface: an operator goes in, something that solves with it comes out.

    factored = solver.factor(operator)      once
    solution = factored.solve(b)            often

`Solution` carries the TRUE relative residual |b - A x|/|b| and the iteration count, so that nothing
unconverged or NaN passes for an answer. Derivatives are implicit (one more solve, with the transpose);
they never unroll or differentiate a factorisation.
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
    """x of A x = b, |b - A x| / |b| (0 for b = 0), and how many iterations it took (0: direct)."""

    value: Float[Array, "*rest"]
    residual: Scalar
    iterations: Int[Array, ""]

    def reshaped(self, *shape: int) -> "Solution":
        """The same with x of this shape."""
        return Solution(self.value.reshape(shape), self.residual, self.iterations)


class LinearOperator(eqx.Module):
    """A square matrix, given densely, by its action, or both; at least one.

    `precondition` is an approximate inverse, used by iterative solvers; `positive_definite` promises a
    symmetric positive definite matrix, which dense solvers factor at half the cost.
    """

    matrix: Float[Array, "n n"] | None = None
    action: Callable[[Vector], Vector] | None = None
    precondition: Callable[[Vector], Vector] | None = None
    positive_definite: bool = eqx.field(static=True, default=False)

    def mv(self, v: Vector) -> Vector:
        """A v."""
        return self.matrix @ v if self.action is None else self.action(v)


class AbstractFactored(eqx.Module):
    """A linear operator, ready to be solved with."""

    @abc.abstractmethod
    def solve(self, b: Vector) -> Solution:
        """x with A x = b."""


class AbstractSolver(eqx.Module):
    """How to solve with a linear operator."""

    @abc.abstractmethod
    def factor(self, operator: LinearOperator) -> AbstractFactored:
        """Does the work that all right-hand sides share."""


def _one_by_one(function, together=None):
    """Batches a LAPACK call as a loop on CPUs, where JAX's batched calls can lock up.

    A batched call waits for helpers from the thread pool that it runs on itself; two at once, in a compiled loop,
    wait for each other for ever (jaxlib 0.10). Other platforms batch as they like, or by `together`, which does the
    same as `function`.
    """
    together = together or function
    single = jax.custom_batching.custom_vmap(function)

    @single.def_vmap
    def batched(size, is_batched, *args):
        if size == 1:  # a loop of one costs a loop all the same
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
    """Triangular factors of `operator.matrix`."""

    operator: eqx.AbstractVar[LinearOperator]

    @abc.abstractmethod
    def _substitute(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """A⁻¹ b."""

    @abc.abstractmethod
    def _substitute_transposed(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """A⁻ᵀ b."""

    def solve_columns(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """A⁻¹ applied to every column."""
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
    """A⁻¹ b: eliminating the columns of [A b] leaves U and L⁻¹ P b."""
    n = matrix.shape[0]
    reduced, _, _ = lax.linalg.lu(jnp.concatenate([matrix, b[:, None]], axis=1))
    return lax.linalg.triangular_solve(reduced[:, :n], reduced[:, n:], left_side=True, lower=False)[:, 0]


def _factored_and_solved(matrix, b):
    """A⁻¹ b: GPU libraries factor many square matrices at once, oblong ones only one after the other."""
    lu, _, order = lax.linalg.lu(matrix)
    z = lax.linalg.triangular_solve(lu, b[order][:, None], left_side=True, lower=True, unit_diagonal=True)
    return lax.linalg.triangular_solve(lu, z, left_side=True, lower=False)[:, 0]


_eliminate = _one_by_one(_eliminated, together=_factored_and_solved)


class Eliminated(AbstractFactored):
    """Nothing is factored beforehand: each right-hand side is eliminated along with the matrix."""

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

    Cheaper than `Dense` then: the order of the rows, which LAPACK gives as a sequence of exchanges, is not needed.
    """

    def factor(self, operator: LinearOperator) -> Eliminated:
        return Eliminated(operator)


class FactoredLU(AbstractFactoredDense):
    """P A = L U in one array, with the row order of P."""

    operator: LinearOperator
    lu: Float[Array, "n n"]
    order: Int[Array, "n"]

    def _substitute(self, b):
        return _solve_upper(self.lu, _solve_unit_lower(self.lu, b[self.order]))

    def _substitute_transposed(self, b):
        z = _solve_unit_lower_transposed(self.lu, _solve_upper_transposed(self.lu, b))
        return jnp.zeros_like(z).at[self.order].set(z)


class FactoredCholesky(AbstractFactoredDense):
    """A = L Lᵀ; NaN when A is not positive definite, which the residual then shows."""

    operator: LinearOperator
    lower: Float[Array, "n n"]

    def _substitute(self, b):
        return _solve_lower_transposed(self.lower, _solve_lower(self.lower, b))

    _substitute_transposed = _substitute


class Dense(AbstractSolver):
    """Cholesky where positive definiteness is promised, else LU with partial pivoting."""

    def factor(self, operator: LinearOperator) -> AbstractFactoredDense:
        # Solves differentiate implicitly, so the factors themselves carry no derivative.
        matrix = lax.stop_gradient(operator.matrix)
        if operator.positive_definite:
            return FactoredCholesky(operator, _cholesky(matrix))
        return FactoredLU(operator, *_lu(matrix))


class FactoredGMRES(AbstractFactored):
    """Nothing is factored; the operator's own `precondition` does what sharing there is, from the right."""

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
    """Restarted GMRES, until the true residual is below `tol` or a cycle no longer helps."""

    tol: float = eqx.field(static=True, default=1e-11)
    restart: int = eqx.field(static=True, default=30)
    max_cycles: int = eqx.field(static=True, default=5)

    def factor(self, operator: LinearOperator) -> FactoredGMRES:
        return FactoredGMRES(operator, self.tol, self.restart, self.max_cycles)


def for_second_kind(n: int) -> AbstractSolver:
    """The faster solver for one right-hand side of a well-conditioned second-kind system of n unknowns.

    Measured (`experiments/solvers.py`): GMRES takes 2 to 10 iterations whatever n is; with its overhead it
    overtakes LU between 128 and 256 unknowns and is nine times faster at 512. The stiff systems stay with dense
    factors, which the frozen part needs anyway.
    """
    return Elimination() if n < 256 else GMRES()


def factor_blocks(matrices: Float[Array, "M n n"], *, positive_definite: bool = False) -> AbstractFactoredDense:
    """Dense factors of each block of a block-diagonal matrix, batched along the first axis."""
    return jax.vmap(lambda A: Dense().factor(LinearOperator(A, positive_definite=positive_definite)))(matrices)


def solve_blocks(blocks: AbstractFactoredDense, b: Float[Array, "M n"]) -> Float[Array, "M n"]:
    """Solves with each of the factored blocks."""
    return jax.vmap(lambda block, b: block.solve_columns(b[:, None])[:, 0])(blocks, b)
