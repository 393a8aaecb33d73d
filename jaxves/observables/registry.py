"""Diagnostics that register themselves: which function computes which quantities.

A function that is decorated with `gives` computes some of the `quantities` of an instant. `diagnostics.diagnose` calls
all of them. A new diagnostic is an entry in `quantities.QUANTITIES` and a function here in `observables`.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from jaxtyping import Array

from ..equation.equation import Equation
from ..equation.state import Motion, Unknowns
from ..physics.scene import Scene
from .quantities import QUANTITIES


class Instant(NamedTuple):
    """What is known at one time: the equation, the time, the state, and everything that F(t, y) computes."""

    equation: Equation
    t: Array
    y: Unknowns
    motion: Motion

    @property
    def scene(self) -> Scene:
        """The scene of the equation."""
        return self.equation.scene


# From an instant, and from the diagnostics that were computed before, to diagnostics by name.
Formula = Callable[[Instant, Mapping[str, Array]], dict[str, Array]]


class Group(NamedTuple):
    """A function, the names of all quantities that it may give, and the scenes that have them."""

    formula: Formula
    names: tuple[str, ...]
    needed: Callable[[Scene], bool]


GROUPS: list[Group] = []


def gives(*names: str, needed: Callable[[Scene], bool] = lambda scene: True) -> Callable[[Formula], Formula]:
    """Registers a function as the one that computes the quantities `names` of the scenes for which `needed` is true.

    `diagnostics.groups` has the order in which functions are called.

    Raises:
        ValueError: a name is not in `quantities.QUANTITIES`, or another function gives it.
    """
    taken = {name for group in GROUPS for name in group.names}
    for name in names:
        if name not in QUANTITIES or name in taken:
            wanted = "a name of quantities.QUANTITIES that no other function gives"
            raise ValueError(f"gives: {name!r}, expected {wanted}.")

    def register(formula: Any) -> Any:
        GROUPS.append(Group(formula, names, needed))
        return formula

    return register
