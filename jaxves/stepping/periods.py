"""The deformation along the field over the last whole period of an AC field: its mean, extremes and change.

In a field with a period T, shapes follow the field within every period. Whether a vesicle is prolate or oblate is a
question to the mean over a period. The mean is ∫ D dt / T between two multiples of T. The running integral of D is part
of the state, so it is as accurate as the steps. Steps need not end at multiples of T: the integral there is that of the
cubic polynomial through the integrals and the values of D at both ends of a step. The least and the greatest value are
those at ends of steps, of which each period has eight or more. The change from the start to the end of the period tells
a vesicle that swings from one that passes from one shape to another.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..geometry.curve import Curve
from ..numerics.arrays import PerVesicle, Scalar, VesiclePoints
from ..observables import classes
from ..observables.diagnostics import has_period
from ..observables.of_field import deformation_along
from ..physics.scene import Scene

_ALONG = classes.DEFORMATION
_NAMES = (classes.MEAN, classes.LEAST, classes.GREATEST, classes.CHANGE)
_NEAR = 1e-9  # in periods: an end of a step this close to a multiple of the period is there


class PeriodMeans(eqx.Module):
    """The deformation along the field in the present period so far, and over the last whole one; (M,) each.

    The values of the last whole period are NaN before the first one has ended.
    """

    now: PerVesicle
    begun: PerVesicle  # the running integral at the start of the present period
    first: PerVesicle  # the value there
    lowest: PerVesicle
    highest: PerVesicle
    mean: PerVesicle
    least: PerVesicle
    greatest: PerVesicle
    change: PerVesicle

    @classmethod
    def of(cls, scene: Scene, y: Unknowns) -> "PeriodMeans | None":
        """Returns what is known at t = 0, or None for a scene without a period of the field."""
        if not has_period(scene) or _ALONG not in y.integrals:
            return None
        now = _along_field(scene, y.x)
        unknown = jnp.full_like(now, jnp.nan)
        return cls(now, jnp.zeros_like(now), *3 * (now,), *4 * (unknown,))

    def after(self, scene: Scene, t: Scalar, y: Unknowns, t_new: Scalar, y_new: Unknowns) -> "PeriodMeans":
        """Returns what is known after a step from (t, y) to (t_new, y_new)."""
        period = scene.field.period()
        before, count = _whole(t, period), _whole(t_new, period)
        passed, end = count > before, count * period
        now = _along_field(scene, y_new.x)
        step = t, t_new, y.integrals[_ALONG], y_new.integrals[_ALONG], self.now, now
        integral, value = _within(end, *step)
        begun, first = (
            jnp.where(end - period > t, inside, stored)
            for inside, stored in zip(_within(end - period, *step), (self.begun, self.first), strict=True)
        )
        there = t_new / period <= count + _NEAR  # the end of the step belongs to both periods
        lowest, highest = jnp.minimum(self.lowest, now), jnp.maximum(self.highest, now)
        values = (
            now,
            jnp.where(passed, integral, self.begun),
            jnp.where(passed, value, self.first),
            jnp.where(passed, now, lowest),
            jnp.where(passed, now, highest),
            jnp.where(passed, (integral - begun) / period, self.mean),
            jnp.where(passed, jnp.where(there, lowest, self.lowest), self.least),
            jnp.where(passed, jnp.where(there, highest, self.highest), self.greatest),
            jnp.where(passed, value - first, self.change),
        )
        return PeriodMeans(*values)

    def diagnostics(self) -> dict[str, PerVesicle]:
        """Returns the values of the last whole period by the names of the diagnostics."""
        return dict(zip(_NAMES, (self.mean, self.least, self.greatest, self.change), strict=True))


def of_steps(
    equation: Equation, times: Float[Array, "S"], y: Unknowns, last: Array, t: Scalar
) -> dict[str, PerVesicle]:
    """Returns the diagnostics at time t from the states after all steps, of which number `last` is at t.

    `times` and `y` have the states as their first axis. This is what `PeriodMeans` finds step by step, as one function
    with a derivative. It is NaN if the last whole period began before the first state.
    """
    scene, period = equation.scene, equation.scene.field.period()
    deformation = jax.vmap(_along_field, in_axes=(None, 0))(scene, y.x)
    count, made = _whole(t, period), jnp.arange(len(times)) <= last

    def at(time):
        k = jnp.clip(jnp.sum(made & (times <= time)) - 1, 0, jnp.maximum(last - 1, 0))
        ends = (of[k + i] for of in (y.integrals[_ALONG], deformation) for i in (0, 1))
        return _within(time, times[k], times[k + 1], *ends)

    end = count * period
    (begun, first), (integral, value) = at(end - period), at(end)
    phase = times / period - count
    inside = (made & (phase > -1 - _NEAR) & (phase <= _NEAR))[:, None]
    least = jnp.min(jnp.where(inside, deformation, jnp.inf), axis=0)
    greatest = jnp.max(jnp.where(inside, deformation, -jnp.inf), axis=0)
    known = (count >= 1) & (end - period >= times[0] - _NEAR * period)
    found = ((integral - begun) / period, least, greatest, value - first)
    return {name: jnp.where(known, of, jnp.nan) for name, of in zip(_NAMES, found, strict=True)}


def _along_field(scene: Scene, x: VesiclePoints) -> PerVesicle:
    """Returns the deformation along the field, (M,)."""
    return deformation_along(scene.field, jax.vmap(Curve.from_nodes)(x))


def _whole(t: Scalar, period: Scalar) -> Scalar:
    """Returns how many whole periods have ended at t."""
    return jnp.floor(jax.lax.stop_gradient(t / period) + _NEAR)


def _within(time, t, t_new, integral, integral_new, value, value_new) -> tuple[PerVesicle, PerVesicle]:
    """Returns integral and integrand at a time within a step, from those at both ends."""
    h = jnp.where(t_new > t, t_new - t, 1.0)
    u = (time - t) / h
    gain = integral_new - integral
    inside = integral + u**2 * (3 - 2 * u) * gain + h * (u * (1 - u) ** 2 * value - u**2 * (1 - u) * value_new)
    return inside, 6 * u * (1 - u) * gain / h + (1 - u) * (1 - 3 * u) * value - u * (2 - 3 * u) * value_new
