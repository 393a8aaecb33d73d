"""What the schemes need of an equation y' = F(t, y) with a linear part A. They use nothing else.

`equation.Equation` is the one of this package. An equation with other unknowns needs only these methods.
"""

from typing import Protocol, runtime_checkable

from jaxtyping import Array, PyTree

from ..numerics.arrays import Scalar


@runtime_checkable
class Factorised(Protocol):
    """The factorised 1 - c A."""

    def solve(self, r: PyTree[Array]) -> PyTree[Array]:
        """Returns (1 - c A)⁻¹ r."""


@runtime_checkable
class LinearPart(Protocol):
    """A at one instant, which a step keeps ("frozen"). It may contain F at this instant."""

    def implicit(self, c: Scalar) -> Factorised:
        """Factorises 1 - c A."""


@runtime_checkable
class SplitEquation(Protocol):
    """An equation that is solved explicitly in F - A and implicitly in A.

    If it `is_staged`, some unknowns are wholly implicit, and it is a `StagedEquation`.
    """

    @property
    def is_staged(self) -> bool:
        """Whether some unknowns are solved for within the stages of a step."""

    def freeze(self, t: Scalar, y: PyTree[Array]) -> LinearPart:
        """Returns A at (t, y)."""

    def rate(self, t: Scalar, y: PyTree[Array]) -> PyTree[Array]:
        """Returns F(t, y)."""

    def near(self, frozen: LinearPart) -> "SplitEquation":
        """Returns the same equation, with `rate` and `stage` for states near that of `frozen`."""

    def rate_of(self, frozen: LinearPart, t: Scalar) -> PyTree[Array]:
        """Returns F at the instant of `frozen`, which need not be computed again."""


@runtime_checkable
class StagedEquation(SplitEquation, Protocol):
    """An equation of which some unknowns are wholly implicit: d = r + c F(y + d) for them, and d = r + c A d otherwise.

    The unknowns have a method `shapes_and_scalars()`, which splits a rate into the part for A and the implicit part.
    """

    def stage(
        self, solver: Factorised, t: Scalar, y: PyTree[Array], r: PyTree[Array], c: Scalar
    ) -> tuple[PyTree[Array], PyTree[Array]]:
        """Returns the increment d of a stage at time t, and F(y + d)."""
