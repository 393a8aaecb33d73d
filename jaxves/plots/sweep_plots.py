"""Figures of sweeps: phase diagrams with class boundaries, maps and families of curves.

Functions take a `SweepRecord` and return a matplotlib `Figure`. With `ax`, they draw into the axes of the caller.
A grid with three axes becomes one panel for each value of the first axis. Cases without a result are hatched, and are
crosses among samples. Cases that were skipped by the refinement have the colour of the nearest computed case.
"""

import difflib
import itertools
from typing import NamedTuple

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..base import status
from ..base.physical_numbers import declared
from ..results.sweep_store import DUE, SKIPPED, SweepRecord
from . import grid_cells
from .style import COLUMN, INK, PAGE, STYLE, quantity_label, scale
from .windows import Into, figure_of, given_axes

_COLORS = {"P": "#8fbfe0", "O": "#f0b27a", "POP": "#8ccfb5", "breathing": "#b7a5d9", "open": "0.85"}
_MORE = ("#d9a5c7", "#e8d98a", "#b0b7e0", "#c9c9c9")
_LINES = ("-", "--", "-.", ":")
_MARKERS = ("o", "s", "^", "D", "v", "x")
_KINDS = {"final": "{}", "average": "mean {}", "min": "least {}", "max": "greatest {}"}


def axis_label(name: str) -> str:
    """Returns symbol and unit of a number; the name itself for one of several vesicles or for an entry of a vector."""
    number = declared(name)
    return name if number is None or "[" in name else number.label()


def value_label(record: SweepRecord, name: str) -> str:
    """Returns the symbol and unit of a quantity of the cases."""
    base, _, kind = name.rpartition("_")
    if kind in _KINDS and base:
        return _KINDS[kind].format(quantity_label(base))
    return name.replace("_", " ")


def default_quantity(record: SweepRecord) -> str:
    """Returns the quantity that is drawn by default; averages are preferred to final values."""
    for name in ("effective_viscosity_average", "effective_viscosity_final", "deformation_average"):
        if name in record.data:
            return name
    return "deformation_final"


class _Cells(NamedTuple):
    """Values of the cases (NaN where there is none), and which were skipped, computed, or still change at t_end."""

    values: np.ndarray
    skipped: np.ndarray
    computed: np.ndarray
    changing: np.ndarray

    @classmethod
    def of(cls, record: SweepRecord, values: np.ndarray) -> "_Cells":
        computed = ~np.isin(record.status, [*DUE, SKIPPED])
        return cls(np.where(_good(record), values, np.nan), record.status == SKIPPED, computed, record.changing)

    @property
    def missing(self) -> np.ndarray:
        """The cases without a value, although the refinement did not skip them."""
        return ~np.isfinite(self.values) & ~self.skipped


@rc_context(STYLE)
def phase_diagram(record: SweepRecord, *, ax: Into = None) -> Figure:
    """Draws the classes over the last two axes with the boundaries between them; samples are drawn as points.

    An open diamond marks a case that is still changing at `t_end`, so that its class may be another one later.

    Raises:
        ValueError: the sweep has no classes, or fewer than two numbers vary.
    """
    if record.classes is None:
        raise ValueError("A phase diagram needs classes, which only scenes with a field have.")
    known = record.classes[_good(record)]
    words = [word for word in _COLORS if word in known]
    words += [str(word) for word in np.unique(known) if word and word not in words]
    colors = [_COLORS.get(word, _MORE[i % len(_MORE)]) for i, word in enumerate(words)]
    codes = np.select([record.classes == word for word in words], np.arange(len(words)), np.nan)
    cells = _Cells.of(record, codes)

    def draw(ax: Axes, x, y, cells: _Cells):
        codes, points = cells.values, _points(x, y, cells.computed & ~cells.missing)
        if codes.ndim == 1:
            there = np.isfinite(codes)
            ax.scatter(x[there], y[there], c=[colors[int(c)] for c in codes[there]], s=14, linewidths=0)
        else:
            across, upward, shown = grid_cells.edges(x), grid_cells.edges(y), grid_cells.filled(codes, cells.skipped)
            ax.pcolormesh(across, upward, shown.T, cmap=ListedColormap(colors), vmin=-0.5, vmax=len(words) - 0.5)
            lines = grid_cells.borders(across, upward, shown)
            ax.add_collection(LineCollection(lines, colors=INK, linewidths=0.8, capstyle="round"))
            grid_cells.hatch(ax, across, upward, ~np.isfinite(shown))
            ax.plot(*points, ".", color=INK, markersize=1.0, alpha=0.35, clip_on=False)
        if cells.changing.any():
            ax.plot(*_points(x, y, cells.changing), **_CHANGING)

    figure, axes = _panels(record, cells, draw, ax)
    handles = [axes[0].plot([], [], "s", color=color, label=word)[0] for word, color in zip(words, colors, strict=True)]
    if cells.changing.any():
        handles.append(Line2D([], [], label="still changing", **_CHANGING))
    _legend(figure, handles, cells, "no result")
    return figure


_CHANGING = {"marker": "D", "linestyle": "none", "color": INK, "markersize": 3, "markerfacecolor": "none",
             "markeredgewidth": 0.6, "clip_on": False}  # fmt: skip


def _legend(figure: Figure, handles: list, cells: _Cells, without: str) -> None:
    """Draws the legend above the panels; `without` says what hatched cells and crosses are."""
    if cells.missing.any():
        handles = [*handles, grid_cells.hatched_patch(without) if cells.values.ndim > 1 else _crosses([], [], without)]
    if handles:
        figure.legend(
            handles=handles, loc="outside upper center", ncols=len(handles), handlelength=1, columnspacing=1.2,
            handletextpad=0.5,
        )  # fmt: skip


@rc_context(STYLE)
def quantity_map(
    record: SweepRecord, name: str | None = None, component: tuple[int, ...] | None = None, *, ax: Into = None
) -> Figure:
    """Draws one quantity over the last two axes. `component` chooses a vesicle or an entry if a case has several.

    Raises:
        ValueError: the record has no such quantity, or fewer than two numbers vary.
    """
    name, values = _values(record, name, component)
    colors = scale(np.where(np.isfinite(values), values, np.nan))
    cells = _Cells.of(record, values)

    def draw(ax: Axes, x, y, cells: _Cells):
        if cells.values.ndim == 1:
            ax.scatter(x, y, c=cells.values, norm=colors.norm, cmap=colors.cmap, s=14, linewidths=0)
            return
        across, upward = grid_cells.edges(x), grid_cells.edges(y)
        shown = grid_cells.filled(cells.values, cells.skipped)
        ax.pcolormesh(across, upward, shown.T, norm=colors.norm, cmap=colors.cmap)
        grid_cells.hatch(ax, across, upward, ~np.isfinite(shown))

    figure, axes = _panels(record, cells, draw, ax)
    figure.colorbar(ScalarMappable(colors.norm, colors.cmap), ax=axes, label=value_label(record, name))
    _legend(figure, [], cells, "no value")
    return figure


@rc_context(STYLE)
def curves(
    record: SweepRecord, name: str | None = None, component: tuple[int, ...] | None = None, *, ax: Into = None
) -> Figure:
    """Draws one quantity against the axis with the most values, with one curve for each value of the other axis.

    Raises:
        ValueError: the record has no such quantity, is a sample, or has more than two axes.
    """
    if record.dims == ("case",) or len(record.dims) > 2:
        raise ValueError("Curves need a grid of one or two axes.")
    name, values = _values(record, name, component)
    along = int(np.argmax(values.shape))
    x = record.coordinates[record.dims[along]][1]
    given = given_axes(ax, 1)
    ax = Figure(figsize=(COLUMN, 2.6)).add_subplot() if given is None else given[0]
    values = np.moveaxis(values, along, 0).reshape(len(x), -1)
    others = [dim for i, dim in enumerate(record.dims) if i != along]
    families = record.coordinates[others[0]][1] if others else [None]
    shades = scale(np.asarray(families, dtype=float)) if others else None
    skipped = np.moveaxis(record.status == SKIPPED, along, 0).reshape(len(x), -1)
    looks = itertools.cycle(zip(itertools.cycle(_LINES), _MARKERS * 2, strict=False))  # curves may lie on each other
    for family, column, left_out, (line, marker) in zip(families, values.T, skipped.T, looks, strict=False):
        there = ~left_out  # a case without a value is a gap
        color = shades.to_rgba(family) if others and len(families) > 6 else None
        label = f"{axis_label(others[0])} = {family:.4g}" if others else None
        look = {"linestyle": line, "marker": marker, "markersize": 3, "markerfacecolor": "none", "markeredgewidth": 0.8}
        ax.plot(x[there], column[there], color=color, label=label, **look)
    if others and len(families) > 6:
        figure_of(ax).colorbar(shades, ax=ax, label=axis_label(others[0]))
    elif others:
        ax.legend()
    ax.set(xlabel=axis_label(record.dims[along]), ylabel=value_label(record, name))
    _scale_axis(ax.set_xscale, ax.get_xlim, ax.set_xlim, x)
    ax.spines[["top", "right"]].set_visible(False)
    return figure_of(ax)


def _values(record: SweepRecord, name: str | None, component) -> tuple[str, np.ndarray]:
    name = default_quantity(record) if name is None else name
    if name not in record.data:
        raise ValueError(f"{name} is no quantity of this sweep{_instead(name, record)}")
    values = np.asarray(record.data[name], dtype=float)
    inner = values.ndim - record.status.ndim
    component = (0,) * inner if component is None else tuple(component)
    if len(component) != inner:
        raise ValueError(f"{name} has {inner} further axes, but the component is {component}.")
    values = values[(..., *component)] if inner else values
    return name, np.where(_good(record), values, np.nan)


def _instead(name: str, record: SweepRecord) -> str:
    """Returns the end of a sentence with the most similar quantities or, if none is similar, with what there is."""
    near = difflib.get_close_matches(name, record.data, n=3, cutoff=0.5)
    if near:
        return f": did you mean {' or '.join(near)}?"
    parts = [known.rpartition("_") for known in record.data]
    bases = sorted({base for base, _, kind in parts if kind in _KINDS})
    others = sorted(known for known, (_, _, kind) in zip(record.data, parts, strict=True) if kind not in _KINDS)
    kinds = ", ".join(f"_{kind}" for kind in _KINDS)
    return f", expected {', '.join(others)}; or with {kinds} where it exists: {', '.join(bases)}."


def _good(record: SweepRecord) -> np.ndarray:
    return np.isin(record.status, list(status.SUCCESS))


def _panels(record: SweepRecord, cells: _Cells, draw, ax: Into) -> tuple[Figure, list[Axes]]:
    """Makes a panel, or one for each value of the first of three axes. `draw(ax, x, y, cells)` draws into a panel."""
    names = list(record.coordinates)
    if len(names) < 2:
        raise ValueError(f"A map needs two axes, but this sweep has only {names[0]}.")
    is_sample = record.dims == ("case",)
    if len(names) > 3 and not is_sample:
        raise ValueError(f"A map needs two or three axes, but this sweep has {len(names)}.")
    shown = names[:2] if is_sample else names[-2:]
    x, y = (record.coordinates[name][1] for name in shown)
    parts = [(None, cells)]
    if len(names) == 3 and not is_sample:
        values = record.coordinates[names[0]][1]
        parts = [(value, _Cells(*(part[i] for part in cells))) for i, value in enumerate(values)]
    axes = given_axes(ax, len(parts))
    if axes is None:
        figure = Figure(figsize=(COLUMN, 2.9) if len(parts) == 1 else (PAGE, 2.6))
        axes = list(figure.subplots(1, len(parts), squeeze=False, sharey=True)[0])
    for ax, (value, part) in zip(axes, parts, strict=True):
        draw(ax, x, y, part)
        if is_sample:
            ax.add_line(_crosses(x[part.missing], y[part.missing]))
        _scale_axis(ax.set_xscale, ax.get_xlim, ax.set_xlim, x)
        _scale_axis(ax.set_yscale, ax.get_ylim, ax.set_ylim, y)
        ax.set_xlabel(axis_label(shown[0]))
        if value is not None:
            ax.set_title(f"{axis_label(names[0])} = {value:.4g}")
    axes[0].set_ylabel(axis_label(shown[1]))
    return figure_of(axes[0]), axes


def _crosses(x, y, label: str | None = None) -> Line2D:
    """Returns crosses for the cases of a sample that have no result."""
    return Line2D(x, y, linestyle="none", marker="x", color=INK, markersize=3, markeredgewidth=0.6, label=label)


def _points(x: np.ndarray, y: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the coordinates of the cases in a mask, of a grid (x, y) or of samples."""
    if mask.ndim == 1:
        return x[mask], y[mask]
    i, j = np.nonzero(mask)
    return x[i], y[j]


def _scale_axis(set_scale, limits, set_limits, values: np.ndarray) -> None:
    """Makes an axis logarithmic if its values have equal ratios, and lets it begin at 0 if none is negative."""
    if grid_cells.is_geometric(values):
        set_scale("log")
    elif np.all(values >= 0) and limits()[0] < 0:
        set_limits(0.0, limits()[1])
