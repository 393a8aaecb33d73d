r"""Symmetries of a single vesicle that its motion conserves.

A uniform field and a linear flow are symmetric about a point. A vesicle that is symmetric about its centre at the start
therefore remains so. Without a flow, a vesicle that is also symmetric in an axis along or across the field remains so
as well. In the discrete equations both hold to round-off, but a compressed neck amplifies deviations by 1e8 and more.
The symmetries of the start are therefore restored after every step. A start that deviates by more than 1e-10 is not
changed.

    about the centre:  x(α + π) = -x(α),   V_m(α + π) = -V_m(α)
    in the axis a:     x(-α) = R x(α),     V_m(-α) = ±V_m(α),    R = 2 a aᵀ - 1,

with x relative to the centre, and a through the first node. V_m, like every scalar, is linear in the field. The sign is
+ if a is along the field and - if a is across it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from ..numerics.arrays import NodePoints, Nodes, Scalar
from ..physics.scene import Scene

# Relative to the size of the vesicle, which is also the unit of potentials:
_KEPT = 1e-10  # a start with a smaller deviation is symmetric
_LOST = 1e-7  # round-off in one step causes smaller deviations


class Symmetry(eqx.Module):
    """The symmetries that a single vesicle has at the start, and therefore always."""

    about_center: Bool[Array, ""]
    in_axis: Bool[Array, ""]
    axis: Float[Array, "2"]
    parity: Scalar  # sign of the scalars under reflection in the axis

    @classmethod
    def of(cls, scene: Scene) -> "Symmetry":
        """Returns the symmetries that the start has in common with field and flow."""
        scalars = {} if scene.V_m is None else {"V_m": scene.V_m[0]}
        x, scalars = lax.stop_gradient((scene.x[0], scalars))
        axis = (x[0] - jnp.mean(x, axis=0)) / _size(x)
        parity, shared = jnp.ones(()), jnp.array(scene.flow is None)
        if scene.field is not None:
            direction = lax.stop_gradient(scene.field.unit_direction())
            along, across = jnp.abs(axis @ direction), jnp.abs(axis[0] * direction[1] - axis[1] * direction[0])
            parity = jnp.where(along > across, 1.0, -1.0)
            shared = shared & (jnp.minimum(along, across) < _KEPT)
        all_ = cls(jnp.array(True), shared, axis, parity)
        in_axis, about_center = (
            wanted & _is_small(_missing(image, x, scalars), _KEPT * _size(x)) for wanted, *image in all_._images()
        )
        return cls(about_center, in_axis, axis, parity)

    @property
    def kept(self) -> str:
        """The symmetries that are kept, in words (outside compiled code); empty if there are none."""
        words = {"about its centre": self.about_center, "in its axis": self.in_axis}
        return " and ".join(word for word, kept in words.items() if kept)

    def restored(self, x: NodePoints, scalars: dict[str, Nodes]) -> tuple[NodePoints, dict[str, Nodes]]:
        """Returns x (N, 2) and scalars (N,) with the symmetries of the start, without deviations by round-off.

        Derivatives are not changed. A larger deviation was made on purpose, and the state is then not changed.
        """
        size = _size(x)
        for wanted, *image in self._images():
            lost = lax.stop_gradient(_missing(image, x, scalars))
            given_back = wanted & _is_small(lost, _LOST * size)
            x, scalars = jax.tree.map(lambda f, d, keep=given_back: f + jnp.where(keep, d, 0.0), (x, scalars), lost)
        return x, scalars

    def _images(self):
        """Yields, for each symmetry, whether it is kept, and functions for the symmetric parts of x and of a scalar."""
        yield self.in_axis, lambda x: _in_axis(x, self.axis), lambda scalar: _mirrored(scalar, self.parity)
        yield self.about_center, _about_center, _opposite


def _size(x: NodePoints) -> Scalar:
    return jnp.linalg.norm(x[0] - jnp.mean(x, axis=0))


def _missing(image, x: NodePoints, scalars: dict[str, Nodes]) -> tuple[NodePoints, dict[str, Nodes]]:
    """Returns what must be added to x and the scalars to make them symmetric; `image` has the symmetric parts."""
    of_x, of_scalar = image
    return of_x(x) - x, jax.tree.map(lambda scalar: of_scalar(scalar) - scalar, scalars)


def _is_small(parts, limit: Scalar) -> Bool[Array, ""]:
    return jnp.max(jnp.stack([jnp.max(jnp.abs(part)) for part in jax.tree.leaves(parts)])) < limit


def _about_center(x: NodePoints) -> NodePoints:
    center = jnp.mean(x, axis=0)
    return center + _opposite(x - center)


def _opposite(f: Array) -> Array:
    """Returns the part of f, (N, ...), that changes its sign under α → α + π."""
    return 0.5 * (f - jnp.roll(f, f.shape[0] // 2, axis=0))


def _backwards(f: Array) -> Array:
    """Returns f(-α)."""
    return jnp.roll(f[::-1], 1, axis=0)


def _in_axis(x: NodePoints, axis: Float[Array, "2"]) -> NodePoints:
    center = jnp.mean(x, axis=0)
    image = _backwards(x - center)
    reflected = 2 * jnp.outer(image @ axis, axis) - image
    return center + 0.5 * (x - center + reflected)


def _mirrored(f: Nodes, parity: Scalar) -> Nodes:
    return 0.5 * (f + parity * _backwards(f))
