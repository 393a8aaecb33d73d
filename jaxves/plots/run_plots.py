"""Figures of runs: shapes and time series.

Functions take data and return a matplotlib `Figure`. They need no display and do not change the settings of pyplot. A
`record` is what `load` or `simulate` returns. With `ax`, figures are drawn into the axes of the caller.

Membranes are coloured by V_m or by the tension λ. `style` has the units and the colours.
"""

from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from ..base import status
from ..numerics import fourier
from ..observables.angles import turns
from . import moments
from .forcing import Forcing, draw_forcing, forcing_of
from .style import COLUMN, INK, PAGE, STYLE, SYMBOLS, component_label, quantity_label, scale, time_label
from .windows import Into, aspect, coloring, figure_of, given_axes, window_of

_ANGLES = ("inclination", "inclination_unwrapped")
_SIGNS = {"deformation": "$> 0$: long in $y$", "deformation_along_field": r"$> 0$: along $\mathbf{E}_\infty$"}
_DOT = "Dots are material points of the membranes."
_COLUMNS = 6  # snapshots beside each other
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
def snapshots(
    record, times: Sequence[float] | None = None, *, count: int = 5, color: str | None = None, ax: Into = None
) -> Figure:
    """Draws the shapes side by side at several saved times.

    These are the saved times nearest to `times`. Without `times` they are up to `count` times that show how the shapes
    change: the first, the last, and others spread evenly along the change of shapes and positions and, less, in time.
    A short transition is therefore drawn, and a long rest is not drawn twice. `color` is "V_m" (the default with a
    field) or "tension". All panels have the same scales. A dot marks a material point of each membrane, so that
    tank-treading can be seen. If the run did not reach its end, its status is above the last time.

    With `ax`, there is one panel for each of these axes. One axes shows the last saved time, or all of `times`.

    Raises:
        ValueError: `color` is not known, or the number of `ax` is not that of `times`.
    """
    t, x = np.asarray(record.t), np.asarray(record.x)
    given = given_axes(ax)
    rows = _rows(t, x, times, count if given is None else len(given))
    color, values = coloring(record, color)
    colors = scale(values[rows])
    window = window_of(x[rows], margin=0.2, below=0.45)
    panels = _snapshot_panels(len(rows), window, forcing_of(record)) if given is None else given
    if len(panels) == 1:
        panels = panels * len(rows)
    if times is None:
        for panel in panels[len(rows) :]:  # fewer times than axes are worth drawing
            panel.set_axis_off()
        panels = panels[: len(rows)]
    if len(panels) != len(rows):
        raise ValueError(f"ax must have {len(rows)} axes, one for each time, but has {len(panels)}.")
    for panel, row in zip(panels, rows, strict=True):
        membranes(panel, x[row], values[row], colors)
        panel.plot(*x[row, :, 0].T, "o", color=INK, markersize=2.5, zorder=4)
        panel.set(xlim=window[:2], ylim=window[2:], title=_early_end(record, row) + time_label(t[row]))
        panel.set_axis_off()
    bar = np.mean(window[:2]) + np.array([-0.5, 0.5])
    panels[0].plot(bar, [window[2] + 0.05] * 2, color=INK, linewidth=1.5, solid_capstyle="butt")
    panels[0].annotate("$a$", (bar[1], window[2] + 0.05), (3, 0), textcoords="offset points", va="center")
    figure, lines = figure_of(panels[0]), -(-len(rows) // _COLUMNS) if given is None else 1
    if given is None:
        figure.supxlabel(_DOT, fontsize="small")
    figure.colorbar(
        colors, ax=list(dict.fromkeys(panels)), label=SYMBOLS[color], shrink=0.8, aspect=18 * lines, pad=0.02
    )
    return figure


def _early_end(record, row: int) -> str:
    """Returns a line with the status of a run that did not reach its end, for its last saved time; otherwise ""."""
    word = getattr(record, "word", "complete")
    last = np.flatnonzero(np.isfinite(np.asarray(record.t)))[-1]
    return f"{word}\n" if row == last and word not in status.SUCCESS else ""


def _rows(t: np.ndarray, x: np.ndarray, times: Sequence[float] | None, count: int) -> list[int]:
    """Returns the rows to draw: those nearest to `times`, or `count` that show how the shapes change."""
    if times is not None:
        return [int(np.nanargmin(np.abs(t - time))) for time in times]
    return moments.instants(t, x, count)[-count:].tolist()


def _snapshot_panels(count: int, window: Float[np.ndarray, "4"], forcing: Forcing) -> list[Axes]:
    """Returns the axes of a new figure with `count` panels, beside a sketch of the field and the flow."""
    columns, forced = min(count, _COLUMNS), int(not forcing.is_absent())
    lines = -(-count // columns)
    widths = [0.5] * forced + [1.0] * columns
    height = (PAGE - 0.7) / sum(widths) * aspect(window) + 0.4
    figure = Figure(figsize=(PAGE, lines * min(height, 4.0)))
    grid = figure.add_gridspec(lines, len(widths), width_ratios=widths)
    if forced:
        draw_forcing(figure.add_subplot(grid[0, 0]), forcing)
    return [figure.add_subplot(grid[i // columns, i % columns + forced]) for i in range(count)]


@rc_context(STYLE)
def history(record, names: str | Sequence[str] | None = None, *, ax: Into = None) -> Figure:
    """Draws diagnostics against time in one panel each. Colours distinguish vesicles and components.

    Inclination angles are in degrees. The curve has a gap where a shape is as long as it is wide, because the angle is
    then undefined, and where it jumps from one saved time to the next. A point between two gaps is a dot. Without
    `names` a default selection is drawn; it includes the inclination only if it changes by more than a degree. With
    `ax`, there is one of these axes for each name.

    Raises:
        ValueError: the record does not have a diagnostic of this name, or the number of `ax` is not that of the names.
    """
    known = record.diagnostics
    names = _usual(record) if names is None else [names] if isinstance(names, str) else list(names)
    if not names or not set(names) <= set(known):
        raise ValueError(f"Diagnostics to draw must be among {', '.join(sorted(known))}, but are {names}.")
    axes = given_axes(ax, len(names))
    if axes is None:
        figure = Figure(figsize=(COLUMN, 0.35 + 1.05 * len(names)))
        axes = list(figure.subplots(len(names), sharex=True, squeeze=False)[:, 0])
        figure.align_ylabels(axes)
    for panel, name in zip(axes, names, strict=True):
        values, label = _curves(record, name)
        for index in np.ndindex(values.shape[1:]):
            column = values[(slice(None), *index)]
            t = np.asarray(record.t)
            if name in _ANGLES:
                t, column = moments.broken(t, column)
            (line,) = panel.plot(t, column, label=component_label(name, values.shape, index))
            if len(lone := moments.alone(column)):
                line.set(marker="o", markersize=2, markevery=lone.tolist())
        if values[0].size > 1:
            title = "vesicle" if values.ndim == 2 else None
            panel.legend(
                ncols=values[0].size, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0, handlelength=1.2,
                title=title, title_fontsize="small", alignment="right",
            )  # fmt: skip
        panel.set_ylabel(label)
        panel.margins(x=0)
        panel.spines[["top", "right"]].set_visible(False)
    axes[-1].set_xlabel(r"$t/t_\kappa$")
    return figure_of(axes[0])


def _usual(record) -> list[str]:
    """Returns the names of the diagnostics that are drawn by default."""
    names = [name for name in _HISTORY if name in record.diagnostics]
    return [name for name in names if name not in _ANGLES or turns(_curves(record, name)[0])]


def _curves(record, name: str) -> tuple[np.ndarray, str]:
    """Returns the values of a diagnostic for drawing, (T, …), and the label of the axis."""
    values = np.asarray(record.diagnostics[name])
    if name in _ANGLES:
        return moments.drawn_angle(np.asarray(record.x), values), f"{SYMBOLS[name]} (degrees)"
    return values, "\n".join([quantity_label(name), *([_SIGNS[name]] if name in _SIGNS else [])])
