"""The space that vesicles are in.

Whatever depends on the distance of two vesicles asks the domain for the vector between them, so that a periodic cell is
another domain.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base.arguments import is_known, refusal
from ..numerics.arrays import Scalar, ScalarLike, as_float


class AbstractDomain(eqx.Module):
    """A space with a vector between any two of its points."""

    @abc.abstractmethod
    def displacement(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Float[Array, "*c 2"]:
        """The shortest vector from `start` to `to`, for points or arrays of points that broadcast."""

    def at(self, t: Scalar) -> "AbstractDomain":
        """Returns the space at time t."""
        return self


class Free(AbstractDomain):
    """The plane without boundaries."""

    def displacement(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Float[Array, "*c 2"]:
        return to - start


class Cell(AbstractDomain):
    """The plane with everything repeated by two vectors, the rows of `lattice`.

    With a shear `rate` γ̇, the flow (γ̇ y, 0) carries the lattice along: a₂ becomes a₂ + γ̇ t (y₂, 0), less a whole
    multiple of a₁, which must lie along x. This is the same lattice with the shortest a₂ (Lees and Edwards [L]).

    Vectors between points are the shortest ones if the lattice is reduced, that is if neither vector can be shortened
    by adding or subtracting the other. `aspect` is a power of two near |a₁|/|a₂|, which shapes the grids of sums.

    Raises:
        ValueError: a known lattice is not two vectors of finite numbers with a positive area, counter-clockwise; or a₁
            does not lie along x in a shear flow.

    [L] A. W. Lees, S. F. Edwards, The computer study of transport processes under extreme conditions, J. Phys. C 5
        (1972) 1921-1928.
    """

    lattice: Float[Array, "2 2"] = eqx.field(converter=as_float)
    rate: Scalar | None = None
    aspect: float = eqx.field(static=True, default=1.0)

    @classmethod
    def of(cls, lattice, rate: ScalarLike | None = None) -> "Cell":
        """Builds the cell of two vectors, the rows of `lattice`; a known lattice is checked."""
        if not is_known(lattice):
            return cls(lattice, None if rate is None else as_float(rate))
        try:
            known = np.asarray(lattice, dtype=float)
        except (TypeError, ValueError):
            known = np.empty(0)
        if known.shape != (2, 2) or not np.all(np.isfinite(known)) or np.linalg.det(known) <= 0:
            raise refusal("lattice", lattice, "two vectors [[x, y], [x, y]], the second to the left of the first")
        if rate is not None and known[0, 1] != 0:
            raise refusal("lattice", lattice, "a first vector along x, [L, 0], in a shear flow")
        long, high = np.linalg.norm(known, axis=1)
        return cls(lattice, None if rate is None else as_float(rate), 2.0 ** round(np.log2(long / high)))

    def at(self, t: Scalar) -> "Cell":
        if self.rate is None:
            return self
        first, second = self.lattice
        second = second.at[0].add(self.rate * t * second[1])
        second = second - jnp.round(second[0] / first[0]) * first
        return Cell(jnp.stack([first, second]), None, self.aspect)

    def lattices(self, t: Float[Array | np.ndarray, "T"]) -> Float[Array, "T 2 2"]:
        """Returns the vectors of the cell at several times, as rows."""
        return jax.vmap(lambda t: self.at(t).lattice)(jnp.asarray(t))

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
