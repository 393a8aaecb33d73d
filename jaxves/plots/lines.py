"""Streamlines and electric field lines around the membranes at one instant."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..observables.fields import fields_at
from ..physics import membrane
from .run_plots import membranes
from .style import COLUMN, STYLE, SYMBOLS, time_label
from .windows import Into, aspect, figure_of, given_axes, window_of


def streamlines(equation: Equation, t: float, y: Unknowns, **how) -> Figure:
    """Draws streamlines at one instant; membranes are coloured by tension. `how` is as in `field_lines`."""
    return _lines(equation, t, y, "tension", **how)


def field_lines(equation: Equation, t: float, y: Unknowns, **how) -> Figure:
    """Draws electric field lines at one instant; membranes are coloured by V_m.

    Args:
        equation: the equation of the scene.
        t: the time.
        y: the state.
        how: `window` is (x_min, x_max, y_min, y_max); by default it has all vesicles with a margin of 0.8. `resolution`
            is the number of points along its longer side (160). `density` is that of matplotlib's `streamplot` (1.3).
            `ax` is an axes to draw into.

    Raises:
        ValueError: the scene has no field.
    """
    if equation.scene.field is None:
        raise ValueError("Field lines need a scene with a field.")
    return _lines(equation, t, y, "V_m", **how)


@rc_context(STYLE)
def _lines(equation, t, y, color, *, window=None, resolution=160, density=1.3, ax: Into = None) -> Figure:
    x = np.asarray(y.x)
    # The window is slightly asymmetric, because a line that starts on an axis of symmetry ends in a stagnation point.
    window = window_of(x, margin=0.8) + 0.02 if window is None else np.asarray(window)
    longer = max(window[1] - window[0], window[3] - window[2])
    across, upward = (
        np.linspace(low, high, max(2, round((high - low) / longer * resolution)))
        for low, high in (window[:2], window[2:])
    )
    points = np.stack(np.meshgrid(across, upward), axis=-1)
    found, tension, V_m = _evaluate(equation, jnp.asarray(t, dtype=float), y, jnp.asarray(points.reshape(-1, 2)))
    vectors = found.velocity if color == "tension" else found.electric_field
    u, v = np.moveaxis(np.asarray(vectors).reshape(points.shape), -1, 0)

    given = given_axes(ax, 1)
    size = (COLUMN, (COLUMN - 1.0) * aspect(window) + 0.6)
    axes = Figure(figsize=size).add_subplot() if given is None else given[0]
    density = (density, density * aspect(window))
    axes.streamplot(across, upward, u, v, density=density, color="0.55", linewidth=0.5, arrowsize=0.5)
    drawn = membranes(axes, x, np.asarray(tension if color == "tension" else V_m))
    axes.set(xlim=window[:2], ylim=window[2:], xlabel="$x/a$", ylabel="$y/a$", title=time_label(t))
    figure_of(axes).colorbar(drawn, ax=axes, label=SYMBOLS[color], shrink=0.8, aspect=22)
    return figure_of(axes)


@eqx.filter_jit
def _evaluate(equation, t, y, points):
    motion = equation.motion(t, y)
    tension = jax.vmap(membrane.physical_tension)(motion.surfaces.curves, motion.sigma, equation.scene.bending)
    V_m = None if motion.electric is None else motion.electric.potential(y.scalars)
    return fields_at(equation, t, y, points), tension, V_m
