"""The space that vesicles are in.

Whatever depends on the distance of two vesicles asks the domain for the vector between them, so that a periodic cell is
another domain.
"""

import abc

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..numerics.arrays import as_float


class AbstractDomain(eqx.Module):
    """A space with a vector between any two of its points."""

    @abc.abstractmethod
    def displacement(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Float[Array, "*c 2"]:
        """The shortest vector from `start` to `to`, for points or arrays of points that broadcast."""


class Free(AbstractDomain):
    """The plane without boundaries."""

    def displacement(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Float[Array, "*c 2"]:
        return to - start


class Cell(AbstractDomain):
    """The plane with everything repeated by two vectors, the rows of `lattice`.

    Vectors between points are the shortest ones if the lattice is reduced, that is if neither vector can be shortened
    by adding or subtracting the other.
    """

    lattice: Float[Array, "2 2"] = eqx.field(converter=as_float)

    def displacement(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Float[Array, "*c 2"]:
        apart = to - start
        nearest = apart - jnp.round(self.coordinates(apart)) @ self.lattice
        steps = jnp.stack(jnp.meshgrid(jnp.arange(-1.0, 2), jnp.arange(-1.0, 2)), axis=-1).reshape(-1, 2)
        candidates = nearest[..., None, :] - steps @ self.lattice
        least = jnp.argmin(jnp.sum(candidates**2, axis=-1), axis=-1)
        return jnp.take_along_axis(candidates, least[..., None, None], axis=-2)[..., 0, :]

    def coordinates(self, x: Float[Array, "*a 2"]) -> Float[Array, "*a 2"]:
        """Returns s with x = s₁ a₁ + s₂ a₂."""
        (ax, ay), (bx, by) = self.lattice
        x, y = x[..., 0], x[..., 1]
        return jnp.stack([by * x - bx * y, ax * y - ay * x], axis=-1) / (ax * by - ay * bx)

    def nearest_image(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Int[Array, "*c 2"]:
        """Returns the integers m for which start + m₁ a₁ + m₂ a₂ is nearest to `to` in lattice coordinates."""
        return jnp.round(self.coordinates(to - start)).astype(jnp.int32)

    def area(self) -> Float[Array, ""]:
        """Returns the area of the cell; negative if a₂ is to the right of a₁."""
        (ax, ay), (bx, by) = self.lattice
        return ax * by - ay * bx

    def heights(self) -> Float[Array, "2"]:
        """Returns the distances of opposite sides of the cell."""
        lengths = jnp.sqrt(jnp.sum(self.lattice**2, axis=1))
        return jnp.abs(self.area()) / lengths[::-1]
