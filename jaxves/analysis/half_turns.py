r"""The time of half a turn of a tumbling vesicle, averages over whole half-turns, and the derivatives of both.

A window that is fixed in time holds a part of a half-turn, and the average over it depends on where it ends. The window
here ends at the last saved time b and starts at the latest time a at which the inclination θ differs by kπ:

    θ(a; p) = θ(b; p) ± k π,      da/dp = (∂_p θ(b) - ∂_p θ(a))/θ'(a)
    T = (b - a)/k,                ⟨Q⟩ = ∫_a^b Q dt/(b - a)

The derivatives contain this motion of the window with the numbers p. They are those of a periodic motion if the run is
long enough for it to become periodic before a. θ and Q are cubic splines through the saved values.
"""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import CubicSpline

from ..base.arguments import refusal, require_count
from ..inputs.scene_tables import SceneFile
from ..observables.shear_motion import is_sheared
from ..runs.case import Case
from ..stepping.march import AbstractMarch
from .sensitivity import chosen, names_of, supported

_HALVINGS = 60  # of an interval between saved times, to round-off


class Window(NamedTuple):
    """The interval of saved times in which a window starts, its start relative to this interval, and half a turn."""

    interval: Array
    start: Array  # from the beginning of the interval
    period: Array  # NaN if there are not enough half-turns


def splines(t: Float[np.ndarray, "T"]) -> Float[np.ndarray, "4 S T"]:
    """Returns the coefficients of cubic splines through T values, as matrices on the values: highest power first."""
    return CubicSpline(t, np.eye(len(t))).c


def last_window(t: Float[np.ndarray, "T"], inclination: Float[Array, "T"], turns: int) -> Window:
    """Returns the window of the last `turns` half-turns, from unwrapped inclinations at known times. Differentiable."""
    sense = jnp.sign(inclination[-1] - inclination[0])
    off = inclination - (inclination[-1] - sense * turns * np.pi)
    crosses = (off[:-1] * off[1:] <= 0) & (sense != 0)
    interval = jnp.max(jnp.where(crosses, jnp.arange(len(t) - 1), 0))
    coefficients = jnp.asarray(splines(t))[:, interval] @ off
    known = jax.lax.stop_gradient(coefficients)
    width = jnp.asarray(np.diff(t))[interval]

    def halved(_, ends):
        low, high = ends
        middle = 0.5 * (low + high)
        after = jnp.polyval(known, low) * jnp.polyval(known, middle) > 0
        return jnp.where(after, middle, low), jnp.where(after, high, middle)

    start, _ = jax.lax.fori_loop(0, _HALVINGS, halved, (jnp.zeros(()), width))
    # One step of Newton's method, whose derivative is that of the implicit function theorem.
    start = start - jnp.polyval(coefficients, start) / jnp.polyval(jnp.polyder(known), start)
    period = (t[-1] - jnp.asarray(t)[interval] - start) / turns
    return Window(interval, start, jnp.where(jnp.any(crosses), period, jnp.nan))


def over(t: Float[np.ndarray, "T"], window: Window, values: Float[Array, "T *rest"], turns: int) -> Array:
    """Returns the average over a window of a quantity with these `values` at the saved times."""
    pieces = jnp.tensordot(jnp.asarray(splines(t)), values, axes=1)  # (4, T - 1, *rest)
    powers = 1.0 / jnp.arange(4, 0, -1)

    def until(piece, end):
        """The integral from the start of an interval to `end`."""
        return jnp.tensordot(powers * end ** jnp.arange(4, 0, -1), piece, axes=1)

    whole = jax.vmap(until, in_axes=(1, 0))(pieces, jnp.asarray(np.diff(t)))
    inside = jnp.arange(len(t) - 1) >= window.interval
    total = jnp.tensordot(inside.astype(float), whole, axes=1)
    total = total - until(pieces[:, window.interval], window.start)
    return total / (turns * window.period)


class OverHalfTurns(eqx.Module):
    """Averages of diagnostics over the last half-turns of a tumbling vesicle, as functions of the scene's numbers.

    The result has the averages by the names of the `quantities`, and "half_turn", the time of half a turn. It is a
    function for `jacobian`, `gradient` and `second_order`. Values are NaN if the vesicle makes fewer than `turns`
    half-turns or the run breaks down. Derivatives include the motion of the window with the numbers.

    Raises:
        SceneError: the file has a key that sensitivities do not support.
        ValueError: the scene is not one vesicle in a constant shear flow, or a diagnostic is unknown.
    """

    scene_file: SceneFile = eqx.field(static=True, converter=supported)
    quantities: tuple[str, ...] = eqx.field(static=True, converter=names_of, default=("effective_viscosity",))
    turns: int = eqx.field(static=True, default=1)
    march: AbstractMarch | None = eqx.field(default=None)  # the file's

    def __check_init__(self):
        require_count("turns", self.turns)
        tables = self.scene_file.model_dump(by_alias=True, exclude_none=True)
        if not is_sheared(tables) or len(self.scene_file.vesicles()) != 1:
            raise refusal("scene_file", "a scene", "one vesicle, not a circle, in a constant shear flow")

    def _march(self) -> AbstractMarch:
        return Case(self.scene_file).march() if self.march is None else self.march

    def forwards(self) -> "OverHalfTurns":
        """Returns the same function for forward mode only, which does not have to record the steps."""
        return dataclasses.replace(self, march=self._march().forwards())

    def __call__(self, values):
        file = self.scene_file
        result = Case(file).simulate(values, saves=file.saves, march=self._march())
        t = file.t_end * np.arange(file.saves + 1) / file.saves
        window = last_window(t, result.diagnostics["inclination_unwrapped"][:, 0], self.turns)
        found = chosen(result.diagnostics, self.quantities)
        averages = {name: over(t, window, history, self.turns) for name, history in found.items()}
        return averages | {"half_turn": window.period}
