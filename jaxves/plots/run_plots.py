r"""Pictures of runs: shapes, histories, stream lines and field lines, films.

Functions take data and return a matplotlib `Figure`; none needs a display, touches pyplot or changes its
settings. A `record` is what `store.load` returns; the result of a simulation has the same attributes but
for the scene, whose field and flow are then not drawn.

Membranes are coloured by V_m or by the tension λ; `plotstyle` has the units and the colours.
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
    """Draws closed curves through the nodes, coloured by `values` at them on the scale `colors`, or plain.

    The curve is the trigonometric interpolant, as in the computation, not the polygon.
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
    """Shapes side by side at the saved times nearest to `times`, or at up to `count` that show how the shape changed.

    These are the first, the last, and others spread evenly along the change of shapes and places, so that a square
    which lasts a moment is drawn and a long rest is not drawn twice. Hardly any change: evenly spread in time.
    `color` is "V_m" (default where there is one) or "tension"; all panels share lengths and colours.
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
    """Diagnostics against time, one under the other; vesicles and components of each told apart by colour.

    Inclinations are in degrees, with a gap where a shape as long as it is broad has none. Without `names` the
    usual diagnostics that the record has are drawn, the inclination only where it moves by more than a degree.
    Raises ValueError for a name that the record has not.
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
    """The names that a history shows by default."""
    names = [name for name in _HISTORY if name in record.diagnostics]
    return [name for name in names if name not in _ANGLES or moments.turns(_curves(record, name)[0])]


def _curves(record, name: str) -> tuple[np.ndarray, str]:
    """The values of a diagnostic as they are drawn, (T, …), and the label of their axis."""
    values = np.asarray(record.diagnostics[name])
    if name in _ANGLES:
        return moments.drawn_angle(np.asarray(record.x), values), f"{SYMBOLS[name]} (degrees)"
    return values, quantity_label(name)


def streamlines(equation: Equation, t: float, y: Unknowns, **how) -> Figure:
    """Stream lines of the fluid at one instant, membranes coloured by tension; `how` as in `field_lines`."""
    return _lines(equation, t, y, "tension", **how)


def field_lines(equation: Equation, t: float, y: Unknowns, **how) -> Figure:
    """Electric field lines at one instant, membranes coloured by V_m.

    Keywords: `window` (x_min, x_max, y_min, y_max), default all vesicles and 0.8 around; `resolution`, points along
    its longer side (160); `density` of the lines (1.3, matplotlib's measure). Raises ValueError without a field.
    """
    if equation.scene.field is None:
        raise ValueError("Field lines need a scene with a field.")
    return _lines(equation, t, y, "V_m", **how)


@rc_context(STYLE)
def _lines(equation, t, y, color, *, window=None, resolution=160, density=1.3) -> Figure:
    x = np.asarray(y.x)
    # A little off the symmetric place: a line seeded on an axis of symmetry runs into a stagnation point.
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
    """Writes a film of at most `frames` equally spaced saves: .gif, or .mp4 through the program ffmpeg.

    Raises ValueError for another ending and RuntimeError where ffmpeg is missing.
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
    """(x_min, x_max, y_min, y_max) of all finite nodes and `margin` around, or `below` at the bottom."""
    low, high = np.nanmin(x.reshape(-1, 2), axis=0), np.nanmax(x.reshape(-1, 2), axis=0)
    return np.array([low[0] - margin, high[0] + margin, low[1] - (below or margin), high[1] + margin])


def _aspect(window: np.ndarray) -> float:
    return float((window[3] - window[2]) / (window[1] - window[0]))


def _draw_forcing(ax: Axes, tables: dict) -> None:
    """The imposed field as one arrow, the imposed flow as a few, one below the other."""
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
