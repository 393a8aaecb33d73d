"""The space that vesicles are in.

Whatever depends on the distance of two vesicles asks the domain for the vector between them, so that a periodic cell is
another domain.
"""

import abc

import equinox as eqx
from jaxtyping import Array, Float


class AbstractDomain(eqx.Module):
    """A space with a vector between any two of its points."""

    @abc.abstractmethod
    def displacement(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Float[Array, "*c 2"]:
        """The shortest vector from `start` to `to`, for points or arrays of points that broadcast."""


class Free(AbstractDomain):
    """The plane without boundaries."""

    def displacement(self, to: Float[Array, "*a 2"], start: Float[Array, "*b 2"]) -> Float[Array, "*c 2"]:
        return to - start
