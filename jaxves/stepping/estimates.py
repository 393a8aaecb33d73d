"""The sum of the estimated errors of all steps where a field or a flow has a period.

Steps resolve every period, so a run may make thousands of them. The error of a step then changes its sign with the
field, and most of it is taken back within a period. The sum of the sizes of all errors would be many times too large.

Errors are therefore added with their signs, as displacements of nodes and changes of scalars, as long as the shape has
hardly moved: until a node is `_MOVED` away from where it was when this stretch began. Within a stretch the flow carries
an error along almost unchanged, so that errors of opposite signs cancel indeed. The sizes of the sums of all stretches
are then added. Two terms are on the safe side:

- the largest partial sum of any stretch, for errors that decay before they are taken back;
- `_KEPT` of the sum of the sizes, for what motion and deformation within a stretch change.

The result is at most the sum of the sizes. Like that sum it does not show how the flow amplifies errors.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from ..equation import norms
from ..equation.state import Unknowns
from ..numerics.arrays import Scalar, VesiclePoints
from ..physics.scene import Scene

_MOVED = 0.05  # in a
_KEPT = 0.1  # twice the largest turn, in radians, of a vesicle of the size a that moves its nodes by `_MOVED`


class ErrorSum(eqx.Module):
    """The sums so far: of the sizes, of the stretches that are over, and with signs in the present stretch."""

    sizes: Scalar
    closed: Scalar
    greatest: Scalar
    signed: Unknowns
    begun: VesiclePoints

    @classmethod
    def of(cls, scene: Scene, y: Unknowns) -> "ErrorSum | None":
        """Returns what is known at the start, or None for a scene without a period."""
        if not scene.periods():
            return None
        zero, signed = jnp.zeros(()), jax.tree.map(jnp.zeros_like, _without_integrals(y))
        return cls(zero, zero, zero, signed, y.x)

    def after(self, error: Unknowns, y: Unknowns) -> "ErrorSum":
        """Returns the sums after a step to y with this estimated error."""
        signed = jax.tree.map(jnp.add, self.signed, jax.lax.stop_gradient(_without_integrals(error)))
        size = norms.error_size(signed)
        sizes, greatest = self.sizes + norms.error_size(error), jnp.maximum(self.greatest, size)
        x = jax.lax.stop_gradient(y.x)
        over = norms.displacement(Unknowns(x), Unknowns(self.begun)) > _MOVED
        return ErrorSum(
            sizes,
            self.closed + jnp.where(over, size, 0.0),
            greatest,
            jax.tree.map(lambda f: jnp.where(over, 0.0, f), signed),
            jnp.where(over, x, self.begun),
        )

    def with_nodes(self, y: Unknowns) -> "ErrorSum":
        """Returns the sums for a state y with other nodes, with which a new stretch begins."""
        closed = self.closed + norms.error_size(self.signed)
        signed = jax.tree.map(jnp.zeros_like, _without_integrals(y))
        return ErrorSum(self.sizes, closed, self.greatest, signed, y.x)

    def total(self) -> Scalar:
        """Returns the estimated error of all steps together."""
        found = self.closed + norms.error_size(self.signed) + self.greatest + _KEPT * self.sizes
        return jnp.minimum(found, self.sizes)


def _without_integrals(y: Unknowns) -> Unknowns:
    return Unknowns(y.x, y.scalars)
