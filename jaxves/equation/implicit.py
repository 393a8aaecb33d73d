"""The linear part A of the equation at one instant, and solving with 1 - c A.

A is block lower triangular. Its blocks are the shapes, the scalars, and, if the model has it, the dependence of the
rates of the scalars on the shapes. Systems for the shapes have one block per membrane, or one matrix while membranes
are near.
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
from .shape_block import ShapeBlock
from .state import Motion, Unknowns


class Shifted(eqx.Module):
    """The factorised 1 - c A for the shapes: blocks, or one matrix (`whole`) while `near`.

    `factors` belong to the small systems of the blocks. `whole` and `near` are None if one matrix is never used.
    """

    blocks: ShapeBlock
    factors: linear.AbstractFactoredDense
    c: Scalar
    whole: linear.FactoredLU | None
    near: Bool[Array, ""] | None

    @classmethod
    def of(cls, blocks: ShapeBlock, A: Float[Array, "n n"] | None, c: Scalar, near: Bool[Array, ""] | None):
        """Factorises. `A` is zero while no pair is near; the factors of the identity are then used directly."""
        factors = linear.factor_blocks(jax.vmap(lambda block: block.shifted(c))(blocks))
        if A is None:
            return cls(blocks, factors, c, None, None)
        one = jnp.eye(A.shape[0])
        shifted = linear.LinearOperator(one - c * A)
        trivial = linear.FactoredLU(shifted, one, jnp.arange(A.shape[0], dtype=jnp.int32))
        return cls(blocks, factors, c, lax.cond(near, lambda: linear.Dense().factor(shifted), lambda: trivial), near)

    def solve(self, r: VesiclePoints) -> VesiclePoints:
        """Returns (1 - c A)⁻¹ r."""
        if self.whole is None:
            return self._by_blocks(r)
        return lax.cond(self.near, lambda: self._together(r), lambda: self._by_blocks(r))

    def _by_blocks(self, r: VesiclePoints) -> VesiclePoints:
        zeta = linear.solve_blocks(self.factors, self.c * jax.vmap(ShapeBlock.load)(self.blocks, r))
        return r + jax.vmap(ShapeBlock.moved)(self.blocks, zeta)

    def _together(self, r: VesiclePoints) -> VesiclePoints:
        M, N, _ = r.shape
        d = self.whole.solve_columns(jnp.swapaxes(r, 1, 2).reshape(-1, 1))
        return jnp.swapaxes(d.reshape(M, 2, N), 1, 2)


class Implicit(eqx.Module):
    """The factorised 1 - c A. It is the identity for running integrals.

    `below`, if not None, returns c times the rate of the scalars that a change of the shapes causes.
    """

    x: Shifted
    scalars: linear.AbstractFactoredDense | None
    below: Callable[[VesiclePoints], dict[str, VesicleNodes]] | None

    def solve(self, r: Unknowns) -> Unknowns:
        """Returns (1 - c A)⁻¹ r."""
        x = self.x.solve(r.x)
        scalars = r.scalars
        if self.below is not None:
            scalars = jax.tree.map(jnp.add, scalars, self.below(x))
        if self.scalars is not None:
            scalars = _unstacked(linear.solve_blocks(self.scalars, _stacked(scalars)), scalars)
        return Unknowns(x, scalars, r.integrals)


def _stacked(scalars: dict[str, VesicleNodes]) -> Float[Array, "M n"]:
    """Returns all scalars of each membrane as one vector, in the order of their names."""
    parts = jax.tree.leaves(scalars)
    return parts[0] if len(parts) == 1 else jnp.concatenate(parts, axis=1)


def _unstacked(values: Float[Array, "M n"], like: dict[str, VesicleNodes]) -> dict[str, VesicleNodes]:
    """Returns the scalars of stacked values; the inverse of `_stacked`, with the names of `like`."""
    leaves, names = jax.tree.flatten(like)
    parts = [values] if len(leaves) == 1 else jnp.split(values, len(leaves), axis=1)
    return jax.tree.unflatten(names, parts)


class Frozen(eqx.Module):
    """The linear part at one instant, with the constraint for the projection.

    `blocks` are for the shapes, one per membrane. `A_all` (2MN, 2MN) replaces them while membranes are near. It is zero
    otherwise, and None if one matrix is never used. `A_scalars` (M, n, n) is for the scalars, in the order of
    their names; None without scalars. `below` returns the rate of the scalars that a change (M, N, 2) of the shapes
    causes at fixed scalars; None if it is treated explicitly.
    """

    motion: Motion
    constraint: Constraint
    blocks: ShapeBlock
    A_all: Float[Array, "Mn Mn"] | None
    A_scalars: Float[Array, "M k k"] | None
    below: Callable[[VesiclePoints], dict[str, VesicleNodes]] | None = None

    def implicit(self, c: Scalar) -> Implicit:
        """Factorises 1 - c A."""

        def shifted(A):
            return linear.factor_blocks(jnp.eye(A.shape[-1]) - c * A)

        near = None if self.A_all is None else self.motion.surfaces.interactions.any_near()
        x = Shifted.of(self.blocks, self.A_all, c, near)
        below = None if self.below is None else jax.tree_util.Partial(_scaled, self.below, c)
        return Implicit(x, None if self.A_scalars is None else shifted(self.A_scalars), below)


def _scaled(function, c: Scalar, x: VesiclePoints) -> dict[str, VesicleNodes]:
    return jax.tree.map(lambda rate: c * rate, function(x))
