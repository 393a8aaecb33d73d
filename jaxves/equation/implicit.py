"""The implicit part A of the equation at one instant, and solving with 1 - c A.

A is block lower triangular: the shapes, the scalars, and where the model has it the dependence of the scalars' rates on
the shapes. Shapes are solved by one block per membrane, or as one matrix while membranes are near each other.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics import linear
from ..numerics.arrays import Scalar, VesicleNodes, VesiclePoints
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
        """`A` is zero while no pair is near; the factors of the identity are then used without computing them."""
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
    """1 - c A, factored; the identity on running integrals.

    `below`, where there is one, gives c times what a change of the shapes adds to the scalars.
    """

    x: Shifted
    scalars: linear.AbstractFactoredDense | None
    below: Callable[[VesiclePoints], dict[str, VesicleNodes]] | None

    def solve(self, r: Unknowns) -> Unknowns:
        """(1 - c A)⁻¹ r."""
        M, N, _ = r.x.shape
        x = self.x.solve(jnp.swapaxes(r.x, 1, 2).reshape(M, 2 * N))
        x = jnp.swapaxes(x.reshape(M, 2, N), 1, 2)
        scalars = r.scalars
        if self.below is not None:
            scalars = jax.tree.map(jnp.add, scalars, self.below(x))
        if self.scalars is not None:
            scalars = _unstacked(linear.solve_blocks(self.scalars, _stacked(scalars)), scalars)
        return Unknowns(x, scalars, r.integrals)


def _stacked(scalars: dict[str, VesicleNodes]) -> Float[Array, "M n"]:
    """All scalars of every membrane as one vector, in the order of their names."""
    parts = jax.tree.leaves(scalars)
    return parts[0] if len(parts) == 1 else jnp.concatenate(parts, axis=1)


def _unstacked(values: Float[Array, "M n"], like: dict[str, VesicleNodes]) -> dict[str, VesicleNodes]:
    """The inverse of `_stacked`, with the names of `like`."""
    leaves, names = jax.tree.flatten(like)
    parts = [values] if len(leaves) == 1 else jnp.split(values, len(leaves), axis=1)
    return jax.tree.unflatten(names, parts)


class Frozen(eqx.Module):
    """The implicit part at one instant, with the constraint that projections use.

    `A_x` (M, 2N, 2N) is of the shapes, one block per membrane. `A_all` replaces it while membranes are near; it is zero
    otherwise, and None where one matrix of all is not used. `A_scalars` (M, n, n) is of the scalars, in the order of
    their names; None without any. `below` is the rate of the scalars that a change (M, N, 2) of the shapes causes, at
    fixed scalars; None where the explicit part takes it.
    """

    motion: Motion
    constraint: Constraint
    A_x: Float[Array, "M n n"]
    A_all: Float[Array, "Mn Mn"] | None
    A_scalars: Float[Array, "M k k"] | None
    below: Callable[[VesiclePoints], dict[str, VesicleNodes]] | None = None

    def implicit(self, c: Scalar) -> Implicit:
        """The factorised 1 - c A."""

        def shifted(A):
            return linear.factor_blocks(jnp.eye(A.shape[-1]) - c * A)

        near = None if self.A_all is None else self.motion.surfaces.interactions.any_near()
        x = Shifted.of(shifted(self.A_x), self.A_all, c, near)
        below = None if self.below is None else jax.tree_util.Partial(_scaled, self.below, c)
        return Implicit(x, None if self.A_scalars is None else shifted(self.A_scalars), below)


def _scaled(function, c: Scalar, x: VesiclePoints) -> dict[str, VesicleNodes]:
    return jax.tree.map(lambda rate: c * rate, function(x))
