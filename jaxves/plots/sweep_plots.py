"""Figures of sweeps: phase diagrams with class boundaries, maps and families of curves.

Functions take a `SweepRecord` and return a matplotlib `Figure`. With `ax`, they draw into the axes of the caller.
A grid with three axes becomes one panel for each value of the first axis. Failed cases are marked with a cross. Cases
that were skipped by the refinement have the colour of the nearest computed case.
"""

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from scipy.interpolate import NearestNDInterpolator
from scipy.ndimage import distance_transform_edt

from ..base import status
from ..base.physical_numbers import declared
from ..results.sweep_store import DUE, SKIPPED, SweepRecord
from .style import COLUMN, INK, PAGE, STYLE, quantity_label, scale
from .windows import Into, figure_of, given_axes

_COLORS = {"P": "#8fbfe0", "O": "#f0b27a", "POP": "#8ccfb5", "breathing": "#b7a5d9", "open": "0.85"}
_MORE = ("#d9a5c7", "#e8d98a", "#b0b7e0", "#c9c9c9")
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


@rc_context(STYLE)
def phase_diagram(record: SweepRecord, *, ax: Into = None) -> Figure:
    """Draws the classes over the last two axes with the boundaries between them; samples are drawn as points.

    Raises:
        ValueError: the sweep has no classes, or fewer than two numbers vary.
    """
    if record.classes is None:
        raise ValueError("A phase diagram needs classes, which only scenes with a field have.")
    words = [word for word in _COLORS if word in record.classes]
    words += [str(word) for word in np.unique(record.classes) if word and word not in words]
    colors = [_COLORS.get(word, _MORE[i % len(_MORE)]) for i, word in enumerate(words)]
    codes = np.select([record.classes == word for word in words], np.arange(len(words)), np.nan)

    def draw(ax: Axes, x, y, codes, good, computed):
        if codes.ndim == 1:
            ax.scatter(x, y, c=[colors[int(c)] if np.isfinite(c) else "none" for c in codes], s=14, linewidths=0)
            return
        filled = _filled(codes)
        ax.pcolormesh(x, y, filled.T, cmap=ListedColormap(colors), vmin=-0.5, vmax=len(words) - 0.5, shading="nearest")
        ax.add_collection(LineCollection(_borders(x, y, filled), colors=INK, linewidths=0.8, capstyle="round"))
        ax.plot(*_points(x, y, computed), ".", color=INK, markersize=1.0, alpha=0.35)
        for code, word in enumerate(words):
            _write(ax, word, x, y, filled == code)

    figure, axes = _panels(record, codes, draw, ax)
    handles = [axes[0].plot([], [], "s", color=color, label=word)[0] for word, color in zip(words, colors, strict=True)]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(words), handlelength=1)
    return figure


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

    def draw(ax: Axes, x, y, values, good, computed):
        if values.ndim == 1:
            ax.scatter(x, y, c=values, norm=colors.norm, cmap=colors.cmap, s=14, linewidths=0)
        else:
            ax.pcolormesh(x, y, _filled(values).T, norm=colors.norm, cmap=colors.cmap, shading="nearest")

    figure, axes = _panels(record, values, draw, ax)
    figure.colorbar(ScalarMappable(colors.norm, colors.cmap), ax=axes, label=value_label(record, name))
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
    for family, column in zip(families, values.T, strict=True):
        there = np.isfinite(column)
        color = shades.to_rgba(family) if others and len(families) > 6 else None
        label = f"{axis_label(others[0])} = {family:.4g}" if others else None
        ax.plot(x[there], column[there], ".-", markersize=3, color=color, label=label)
    if others and len(families) > 6:
        figure_of(ax).colorbar(shades, ax=ax, label=axis_label(others[0]))
    elif others:
        ax.legend()
    ax.set(xlabel=axis_label(record.dims[along]), ylabel=value_label(record, name))
    _scale_axis(ax.set_xscale, x)
    ax.spines[["top", "right"]].set_visible(False)
    return figure_of(ax)


def _values(record: SweepRecord, name: str | None, component) -> tuple[str, np.ndarray]:
    name = default_quantity(record) if name is None else name
    if name not in record.data:
        raise ValueError(f"{name} is no quantity of this sweep, expected one of {', '.join(sorted(record.data))}.")
    values = np.asarray(record.data[name], dtype=float)
    inner = values.ndim - record.status.ndim
    component = (0,) * inner if component is None else tuple(component)
    if len(component) != inner:
        raise ValueError(f"{name} has {inner} further axes, but the component is {component}.")
    values = values[(..., *component)] if inner else values
    return name, np.where(_good(record), values, np.nan)


def _good(record: SweepRecord) -> np.ndarray:
    return np.isin(record.status, list(status.SUCCESS))


def _panels(record: SweepRecord, values: np.ndarray, draw, ax: Into) -> tuple[Figure, list[Axes]]:
    """Makes a panel, or one for each value of the first of three axes.

    `draw(ax, x, y, values, good, computed)` draws into a panel.
    """
    names = list(record.coordinates)
    good, computed = _good(record), ~np.isin(record.status, [*DUE, SKIPPED])
    if len(names) < 2:
        raise ValueError(f"A map needs two axes, but this sweep has only {names[0]}.")
    if record.dims == ("case",):
        x, y = (record.coordinates[name][1] for name in names[:2])
        parts = [(None, values, good, computed)]
    elif len(names) > 3:
        raise ValueError(f"A map needs two or three axes, but this sweep has {len(names)}.")
    else:
        x, y = (record.coordinates[name][1] for name in names[-2:])
        if len(names) == 2:
            parts = [(None, values, good, computed)]
        else:
            parts = list(zip(record.coordinates[names[0]][1], values, good, computed, strict=True))
    shown = names[:2] if record.dims == ("case",) else names[-2:]
    axes = given_axes(ax, len(parts))
    if axes is None:
        figure = Figure(figsize=(COLUMN, 2.9) if len(parts) == 1 else (PAGE, 2.6))
        axes = list(figure.subplots(1, len(parts), squeeze=False, sharey=True)[0])
    for ax, (value, inside, fine, there) in zip(axes, parts, strict=True):
        draw(ax, x, y, inside, fine, there)
        failed = there & ~fine
        if failed.ndim == 2:
            ax.plot(*_points(x, y, failed), "x", color=INK, markersize=3, markeredgewidth=0.6)
        else:
            ax.plot(x[failed], y[failed], "x", color=INK, markersize=3, markeredgewidth=0.6)
        _scale_axis(ax.set_xscale, x)
        _scale_axis(ax.set_yscale, y)
        ax.set_xlabel(axis_label(shown[0]))
        if value is not None:
            ax.set_title(f"{axis_label(names[0])} = {value:.4g}")
    axes[0].set_ylabel(axis_label(shown[1]))
    return figure_of(axes[0]), axes


def _points(x: np.ndarray, y: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    i, j = np.nonzero(mask)
    return x[i], y[j]


def _filled(values: np.ndarray) -> np.ndarray:
    """Returns the grid with missing values replaced by that of the nearest point."""
    there = np.isfinite(values)
    if there.all() or not there.any():
        return values
    near = NearestNDInterpolator(np.argwhere(there), values[there])
    return near(*np.indices(values.shape))


def _edges(centers: np.ndarray) -> np.ndarray:
    """Returns the edges of the cells that `pcolormesh` draws around these values."""
    middle = 0.5 * (centers[1:] + centers[:-1])
    return np.concatenate([[2 * centers[0] - middle[0]], middle, [2 * centers[-1] - middle[-1]]])


def _borders(x: np.ndarray, y: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Returns the edges (K, 2, 2) between neighbouring cells with different values; `cells` has the shape (x, y)."""
    across, upward = _edges(x), _edges(y)
    i, j = np.nonzero(cells[1:] != cells[:-1])
    vertical = np.stack([np.stack([across[i + 1], upward[j + k]], axis=-1) for k in (0, 1)], axis=1)
    i, j = np.nonzero(cells[:, 1:] != cells[:, :-1])
    level = np.stack([np.stack([across[i + k], upward[j + 1]], axis=-1) for k in (0, 1)], axis=1)
    return np.concatenate([vertical, level])


def _write(ax: Axes, word: str, x: np.ndarray, y: np.ndarray, region: np.ndarray) -> None:
    """Writes the name of a class where its region is widest, if there is room."""
    if region.mean() > 0.03:
        depth = distance_transform_edt(np.pad(region, 1))[1:-1, 1:-1]
        i, j = np.nonzero(depth > depth.max() - 0.5)
        k = np.argmin((i - i.mean()) ** 2 + (j - j.mean()) ** 2)  # the middle of the widest part
        i, j = i[k], j[k]
        ax.text(x[i], y[j], word, ha="center", va="center", fontsize=9, color=INK)


def _scale_axis(set_scale, values: np.ndarray) -> None:
    """Makes the axis logarithmic if the values have equal ratios rather than equal differences."""
    if len(values) > 2 and np.all(values > 0):
        ratios, steps = np.diff(np.log(values)), np.diff(values)
        if np.ptp(ratios) < 1e-6 * abs(ratios).max() < np.ptp(steps):
            set_scale("log")
