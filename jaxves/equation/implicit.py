"""Solving with 1 - c A: by blocks, or as one matrix while membranes are near each other."""

import equinox as eqx
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics import linear
from ..numerics.arrays import Scalar
from .inextensible import Constraint
from .state import Motion, Unknowns


class Shifted(eqx.Module):
    """1 - c A of the shapes, factored: by blocks, but as one matrix while `near`; None where that never is."""

    blocks: linear.AbstractFactoredDense
    whole: linear.FactoredLU | None
    near: Bool[Array, ""] | None

    @classmethod
    def of(
        cls,
        blocks: linear.AbstractFactoredDense,
        A: Float[Array, "n n"] | None,
        c: Scalar,
        near: Bool[Array, ""] | None,
    ):
        """`A` is zero while nothing is near; its factors are then those of 1, found by nobody."""
        if A is None:
            return cls(blocks, None, None)
        one = jnp.eye(A.shape[0])
        shifted = linear.LinearOperator(one - c * A)
        trivial = linear.FactoredLU(shifted, one, jnp.arange(A.shape[0], dtype=jnp.int32))
        return cls(blocks, lax.cond(near, lambda: linear.Dense().factor(shifted), lambda: trivial), near)

    def solve(self, b: Float[Array, "M n"]) -> Float[Array, "M n"]:
        """(1 - c A)⁻¹ b."""
        if self.whole is None:
            return linear.solve_blocks(self.blocks, b)
        return lax.cond(
            self.near,
            lambda: self.whole.solve_columns(b.reshape(-1, 1)).reshape(b.shape),
            lambda: linear.solve_blocks(self.blocks, b),
        )


class Implicit(eqx.Module):
    """1 - c A, ready to be solved with; the identity on running integrals."""

    x: Shifted
    V_m: linear.AbstractFactoredDense | None

    def solve(self, r: Unknowns) -> Unknowns:
        """(1 - c A)⁻¹ r."""
        M, N, _ = r.x.shape
        x = self.x.solve(jnp.swapaxes(r.x, 1, 2).reshape(M, 2 * N))
        V_m = None if self.V_m is None else linear.solve_blocks(self.V_m, r.V_m)
        return Unknowns(jnp.swapaxes(x.reshape(M, 2, N), 1, 2), V_m, r.integrals)


class Frozen(eqx.Module):
    """The linear part at one instant, with the constraint that projections use.

    `A_all` replaces the blocks `A_x` while membranes are near; it is zero otherwise, and None where there never is one.
    """

    motion: Motion
    constraint: Constraint
    A_x: Float[Array, "M n n"]
    A_all: Float[Array, "Mn Mn"] | None
    A_V: Float[Array, "M N N"] | None

    def implicit(self, c: Scalar) -> Implicit:
        """The factorised 1 - c A."""

        def shifted(A):
            return linear.factor_blocks(jnp.eye(A.shape[-1]) - c * A)

        near = None if self.A_all is None else self.motion.surfaces.interactions.any_near
        x = Shifted.of(shifted(self.A_x), self.A_all, c, near)
        return Implicit(x, None if self.A_V is None else shifted(self.A_V))
