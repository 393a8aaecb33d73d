r"""Figures of runs: shapes, time series, streamlines, field lines, animations.

Functions take data and return a matplotlib `Figure`. They need no display and do not change the settings of pyplot. A
`record` is what `read_result` or `simulate` returns. The latter has no scene, so its field and flow are not drawn.

Membranes are coloured by V_m or by the tension λ. `style` has the units and the colours.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib import rc_context
from matplotlib.animation import FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..numerics import fourier
from ..observables.fields import fields_at
from ..physics import membrane
from . import moments
from .style import COLUMN, INK, PAGE, STYLE, SYMBOLS, component_label, quantity_label, scale, time_label

_GRADIENTS = {"shear": ((0, 1), (0, 0)), "extension": ((1, 0), (0, -1))}
_ANGLES = ("inclination", "inclination_unwrapped")
_HISTORY = ("deformation", "inclination_unwrapped", "effective_viscosity", "max_V_m", "min_gap")


def membranes(
    ax: Axes,
    x: Float[np.ndarray, "M N 2"],
    values: Float[np.ndarray, "M N"] | None = None,
    colors: ScalarMappable | None = None,
) -> LineCollection:
    """Draws closed curves through the nodes.

    They are coloured by `values` at the nodes with the colour scale `colors`, or drawn in one colour without values.
    The curve is the trigonometric interpolant of the nodes, as in the computation.
    """

    def edges(f):
        fine = np.asarray(fourier.resample(jnp.asarray(f), max(512, x.shape[1]), axis=1))
        return np.stack([fine, np.roll(fine, -1, axis=1)], axis=2)

    lines = LineCollection(edges(x).reshape(-1, 2, 2), linewidths=1.8, capstyle="round", zorder=3)
    if values is None:
        lines.set_color(INK)
    else:
        colors = scale(values) if colors is None else colors
        lines.set(array=edges(values).mean(axis=2).ravel(), norm=colors.norm, cmap=colors.cmap)
    ax.add_collection(lines)
    ax.set_aspect("equal")
    return lines


@rc_context(STYLE)
def snapshots(record, times: Sequence[float] | None = None, *, count: int = 5, color: str | None = None) -> Figure:
    """Draws the shapes side by side at several saved times.

    These are the saved times nearest to `times`. Without `times` they are up to `count` times that show how the shapes
    change: the first, the last, and others spread evenly along the change of shapes and positions. A short transition
    is therefore drawn, and a long rest is not drawn twice. If hardly anything changes, they are spread evenly in time.
    `color` is "V_m" (the default with a field) or "tension". All panels have the same scales.
    """
    t, x = np.asarray(record.t), np.asarray(record.x)
    rows = moments.instants(t, x, count) if times is None else [int(np.argmin(np.abs(t - time))) for time in times]
    color, values = _coloring(record, color)
    colors = scale(values[rows])
    window = _window(x[rows], margin=0.2, below=0.45)
    tables = tomllib.loads(getattr(record, "scene", ""))
    forced = int("field" in tables or "flow" in tables)

    columns = min(len(rows), 6)
    lines = -(-len(rows) // columns)
    widths = [0.5] * forced + [1.0] * columns
    height = (PAGE - 0.7) / sum(widths) * _aspect(window) + 0.25
    figure = Figure(figsize=(PAGE, lines * min(height, 4.0)))
    grid = figure.add_gridspec(lines, len(widths), width_ratios=widths)
    if forced:
        _draw_forcing(figure.add_subplot(grid[0, 0]), tables)
    panels = [figure.add_subplot(grid[i // columns, i % columns + forced]) for i in range(len(rows))]
    for ax, row in zip(panels, rows, strict=True):
        membranes(ax, x[row], values[row], colors)
        ax.set(xlim=window[:2], ylim=window[2:], title=time_label(t[row]))
        ax.set_axis_off()
    bar = np.mean(window[:2]) + np.array([-0.5, 0.5])
    panels[0].plot(bar, [window[2] + 0.05] * 2, color=INK, linewidth=1.5, solid_capstyle="butt")
    panels[0].annotate("$a$", (bar[1], window[2] + 0.05), (3, 0), textcoords="offset points", va="center")
    figure.colorbar(colors, ax=panels, label=SYMBOLS[color], shrink=0.8, aspect=18 * lines, pad=0.02)
    return figure


@rc_context(STYLE)
def history(record, names: Sequence[str] | None = None) -> Figure:
    """Draws diagnostics against time in one panel each. Colours distinguish vesicles and components.

    Inclination angles are in degrees. The curve has a gap where a shape is as long as it is wide, because the angle is
    then undefined. Without `names` a default selection is drawn; it includes the inclination only if it changes by more
    than a degree.

    Raises:
        ValueError: the record does not have a diagnostic of this name.
    """
    known = record.diagnostics
    names = _usual(record) if names is None else list(names)
    if not names or not set(names) <= set(known):
        raise ValueError(f"Diagnostics to draw must be among {', '.join(sorted(known))}, but are {names}.")
    figure = Figure(figsize=(COLUMN, 0.35 + 1.05 * len(names)))
    axes = figure.subplots(len(names), sharex=True, squeeze=False)[:, 0]
    for ax, name in zip(axes, names, strict=True):
        values, label = _curves(record, name)
        for index in np.ndindex(values.shape[1:]):
            ax.plot(
                np.asarray(record.t), values[(slice(None), *index)], label=component_label(name, values.shape, index)
            )
        if values[0].size > 1:
            ax.legend(ncols=values[0].size, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0, handlelength=1.2)
        ax.set_ylabel(label)
        ax.margins(x=0)
        ax.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel(r"$t/t_\kappa$")
    figure.align_ylabels(axes)
    return figure


def _usual(record) -> list[str]:
    """Returns the names of the diagnostics that are drawn by default."""
    names = [name for name in _HISTORY if name in record.diagnostics]
    return [name for name in names if name not in _ANGLES or moments.turns(_curves(record, name)[0])]


def _curves(record, name: str) -> tuple[np.ndarray, str]:
    """Returns the values of a diagnostic for drawing, (T, …), and the label of the axis."""
    values = np.asarray(record.diagnostics[name])
    if name in _ANGLES:
        return moments.drawn_angle(np.asarray(record.x), values), f"{SYMBOLS[name]} (degrees)"
    return values, quantity_label(name)


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

    Raises:
        ValueError: the scene has no field.
    """
    if equation.scene.field is None:
        raise ValueError("Field lines need a scene with a field.")
    return _lines(equation, t, y, "V_m", **how)


@rc_context(STYLE)
def _lines(equation, t, y, color, *, window=None, resolution=160, density=1.3) -> Figure:
    x = np.asarray(y.x)
    # The window is slightly asymmetric, because a line that starts on an axis of symmetry ends in a stagnation point.
    window = _window(x, margin=0.8) + 0.02 if window is None else np.asarray(window)
    longer = max(window[1] - window[0], window[3] - window[2])
    across, upward = (
        np.linspace(low, high, max(2, round((high - low) / longer * resolution)))
        for low, high in (window[:2], window[2:])
    )
    points = np.stack(np.meshgrid(across, upward), axis=-1)
    found, tension = _evaluate(equation, jnp.asarray(t, dtype=float), y, jnp.asarray(points.reshape(-1, 2)))
    vectors = found.velocity if color == "tension" else found.electric_field
    u, v = np.moveaxis(np.asarray(vectors).reshape(points.shape), -1, 0)

    figure = Figure(figsize=(COLUMN, (COLUMN - 1.0) * _aspect(window) + 0.6))
    ax = figure.add_subplot()
    density = (density, density * _aspect(window))
    ax.streamplot(across, upward, u, v, density=density, color="0.55", linewidth=0.5, arrowsize=0.5)
    drawn = membranes(ax, x, np.asarray(tension if color == "tension" else y.V_m))
    ax.set(xlim=window[:2], ylim=window[2:], xlabel="$x/a$", ylabel="$y/a$", title=time_label(t))
    figure.colorbar(drawn, ax=ax, label=SYMBOLS[color], shrink=0.8, aspect=22)
    return figure


@eqx.filter_jit
def _evaluate(equation, t, y, points):
    motion = equation.motion(t, y)
    tension = jax.vmap(membrane.physical_tension)(motion.surfaces.curves, motion.sigma, equation.scene.bending)
    return fields_at(equation, t, y, points), tension


@rc_context(STYLE)
def animation(record, path: str | Path, *, color: str | None = None, frames: int = 150, per_second: int = 20) -> None:
    """Writes an animation of at most `frames` equally spaced saved times: a .gif, or an .mp4 with the program ffmpeg.

    Raises:
        ValueError: the name of the file ends in neither .gif nor .mp4.
        RuntimeError: an .mp4 is asked for and ffmpeg is not installed.
    """
    path = Path(path)
    if path.suffix not in (".gif", ".mp4"):
        raise ValueError(f"A film is written as .gif or .mp4, not as {path.name!r}.")
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise RuntimeError(f"{path.name!r} needs the program ffmpeg, which is not installed; write a .gif instead.")
    writer = (PillowWriter if path.suffix == ".gif" else FFMpegWriter)(fps=per_second)
    x = np.asarray(record.x)
    color, values = _coloring(record, color)
    colors = scale(values)
    window = _window(x, margin=0.2)
    figure = Figure(figsize=(COLUMN, min((COLUMN - 0.6) * _aspect(window) + 0.3, 2 * COLUMN)))
    ax = figure.add_subplot(xlim=window[:2], ylim=window[2:])
    ax.set_axis_off()
    figure.colorbar(colors, ax=ax, label=SYMBOLS[color], shrink=0.8)
    with writer.saving(figure, str(path), dpi=figure.dpi):
        for row in np.unique(np.linspace(0, len(x) - 1, frames).round().astype(int)):
            drawn = membranes(ax, x[row], values[row], colors)
            ax.set_title(time_label(record.t[row]))
            writer.grab_frame()
            drawn.remove()


def _coloring(record, color: str | None) -> tuple[str, np.ndarray]:
    color = color or ("tension" if record.V_m is None else "V_m")
    if color not in ("V_m", "tension") or getattr(record, color) is None:
        known = "'tension'" if record.V_m is None else "'V_m' or 'tension'"
        raise ValueError(f"Argument `color` must be {known} for this record, but is {color!r}.")
    return color, np.asarray(getattr(record, color))


def _window(x: np.ndarray, margin: float, below: float | None = None) -> np.ndarray:
    """Returns (x_min, x_max, y_min, y_max) of all finite nodes with a `margin`, and `below` at the bottom if given."""
    low, high = np.nanmin(x.reshape(-1, 2), axis=0), np.nanmax(x.reshape(-1, 2), axis=0)
    return np.array([low[0] - margin, high[0] + margin, low[1] - (below or margin), high[1] + margin])


def _aspect(window: np.ndarray) -> float:
    return float((window[3] - window[2]) / (window[1] - window[0]))


def _draw_forcing(ax: Axes, tables: dict) -> None:
    """Draws the imposed field as one arrow and, below it, the imposed flow as several."""
    both = "field" in tables and "flow" in tables
    ax.set(xlim=(-1, 1), ylim=(-2, 2) if both else (-1, 1), aspect="equal")
    ax.set_axis_off()
    text = dict(textcoords="offset points", ha="center", va="center")
    if "field" in tables:
        half = np.array(tables["field"].get("direction", (0.0, 1.0)), dtype=float)
        half = 0.6 * half / np.linalg.norm(half)
        center = np.array([0.0, 1.0 if both else 0.0])
        arrow = dict(arrowstyle="-|>", color=INK, linewidth=1.0, shrinkA=0, shrinkB=0)
        ax.annotate("", center + half, center - half, arrowprops=arrow)
        ax.annotate(r"$\mathbf{E}_\infty$", center, 18 * np.array([half[1], -half[0]]), **text)
    if "flow" in tables:
        flow = tables["flow"]
        gradient = np.array(flow["gradient"] if flow["kind"] == "linear" else _GRADIENTS[flow["kind"]], dtype=float)
        gradient = np.sign(flow.get("capillary_number", 1.0)) * gradient / np.abs(gradient).max()
        places = 0.6 * np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 2)
        center = -1.0 if both else 0.0
        ax.quiver(
            *places.T + np.array([[0.0], [center]]), *gradient @ places.T, color=INK, angles="xy", scale_units="xy",
            scale=1.2, pivot="mid", units="xy", width=0.08,
        )  # fmt: skip
        ax.annotate(r"$\mathbf{v}_\infty$", (0.0, center - 0.75), (0, -5), **text)
