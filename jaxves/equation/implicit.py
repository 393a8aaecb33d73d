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
from ..operators.surfaces import Surfaces
from .inextensible import Constraint
from .rotating_block import FactoredRotations, RotatingBlock
from .state import Motion, Unknowns


class Shifted(eqx.Module):
    """The factorised 1 - c A for the shapes: blocks, or one matrix (`whole`) while `near`.

    `whole` and `near` are None if one matrix is never used.
    """

    blocks: linear.AbstractFactoredDense | FactoredRotations
    whole: linear.FactoredLU | None
    near: Bool[Array, ""] | None

    @classmethod
    def of(
        cls,
        blocks: linear.AbstractFactoredDense | FactoredRotations,
        A: Float[Array, "n n"] | None,
        c: Scalar,
        near: Bool[Array, ""] | None,
    ):
        """Factorises. `A` is zero while no pair is near; the factors of the identity are then used directly."""
        if A is None:
            return cls(blocks, None, None)
        one = jnp.eye(A.shape[0])
        shifted = linear.LinearOperator(one - c * A)
        trivial = linear.FactoredLU(shifted, one, jnp.arange(A.shape[0], dtype=jnp.int32))
        return cls(blocks, lax.cond(near, lambda: linear.Dense().factor(shifted), lambda: trivial), near)

    def solve(self, r: VesiclePoints) -> VesiclePoints:
        """Returns (1 - c A)⁻¹ r."""
        if isinstance(self.blocks, FactoredRotations):
            return self._by_rotations(r)
        M, N, _ = r.shape
        b = jnp.swapaxes(r, 1, 2).reshape(M, 2 * N)
        if self.whole is None:
            d = linear.solve_blocks(self.blocks, b)
        else:
            d = lax.cond(
                self.near,
                lambda: self.whole.solve_columns(b.reshape(-1, 1)).reshape(b.shape),
                lambda: linear.solve_blocks(self.blocks, b),
            )
        return jnp.swapaxes(d.reshape(M, 2, N), 1, 2)

    def _by_rotations(self, r: VesiclePoints) -> VesiclePoints:
        def own():
            return jax.vmap(FactoredRotations.solve)(self.blocks, r)

        if self.whole is None:
            return own()
        columns = jnp.swapaxes(r, 1, 2)

        def together():
            return jnp.swapaxes(self.whole.solve_columns(columns.reshape(-1, 1)).reshape(columns.shape), 1, 2)

        return lax.cond(self.near, together, own)


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

    `A_x` is for the shapes, with one block per membrane: matrices (M, 2N, 2N), or rotations. `A_all` (2MN, 2MN)
    replaces it while membranes are near. It is zero otherwise, and None if one matrix is never used. `A_scalars`
    (M, n, n) is for the scalars, in the order of their names; None without scalars. `below` returns c times the rate of
    the scalars that a change (M, N, 2) of the surfaces of `motion` causes at fixed scalars; None if it is treated
    explicitly.
    """

    motion: Motion
    constraint: Constraint
    A_x: Float[Array, "M n n"] | RotatingBlock
    A_all: Float[Array, "Mn Mn"] | None
    A_scalars: Float[Array, "M k k"] | None
    below: Callable[[Surfaces, VesiclePoints, Scalar], dict[str, VesicleNodes]] | None = None

    def implicit(self, c: Scalar) -> Implicit:
        """Factorises 1 - c A."""

        def shifted(A):
            return linear.factor_blocks(jnp.eye(A.shape[-1]) - c * A)

        near = None if self.A_all is None else self.motion.surfaces.interactions.any_near()
        if isinstance(self.A_x, RotatingBlock):
            blocks = jax.vmap(lambda block: block.factored(c))(self.A_x)
        else:
            blocks = shifted(self.A_x)
        x = Shifted.of(blocks, self.A_all, c, near)
        below = None if self.below is None else jax.tree_util.Partial(_with, self.below, self.motion.surfaces, c)
        return Implicit(x, None if self.A_scalars is None else shifted(self.A_scalars), below)


def _with(function, surfaces: Surfaces, c: Scalar, x: VesiclePoints) -> dict[str, VesicleNodes]:
    return function(surfaces, x, c)
