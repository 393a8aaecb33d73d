"""Pictures and films of suspensions in a periodic cell: every image of a vesicle that the picture shows is drawn."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from ..base.arguments import refusal
from .films import written
from .style import COLUMN, INK, PAGE, STYLE, scale, time_label
from .windows import Into, aspect, figure_of, given_axes

_PLAIN = "#9ec5e0"
_STEPS = np.stack(np.meshgrid(*[np.arange(-2, 3)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)


def view_of(lattice: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "4"]:
    """Returns the rectangle (x_min, x_max, y_min, y_max) that a picture shows.

    If the first vector lies along x, it is as long as this vector and as high as the cell. It then has the same area
    and shows all vesicles once. Otherwise it contains the cell.
    """
    lattice = np.asarray(lattice)
    if lattice[0, 1] == 0:
        return np.array([0.0, lattice[0, 0], 0.0, lattice[1, 1]])
    corners = np.array([[0.0, 0.0], lattice[0], lattice[1], lattice[0] + lattice[1]])
    return np.stack([corners.min(axis=0), corners.max(axis=0)], axis=-1).reshape(-1)


def images_in_view(
    x: Float[np.ndarray, "M N 2"], lattice: Float[np.ndarray, "2 2"], view: Float[np.ndarray, "4"]
) -> tuple[Float[np.ndarray, "K N 2"], Int[np.ndarray, "K"]]:
    """Returns the nodes of all images that may reach into the rectangle `view`, and the vesicle of each."""
    low, high = view[::2], view[1::2]
    center = x.mean(axis=1)
    radius = np.sqrt(((x - center[:, None]) ** 2).sum(axis=-1).max(axis=1))
    near = np.round((0.5 * (low + high) - center) @ np.linalg.inv(lattice))
    moves = (near[:, None] + _STEPS) @ lattice
    there = center[:, None] + moves
    reached = np.all((there > low - radius[:, None, None]) & (there < high + radius[:, None, None]), axis=-1)
    vesicle, image = np.nonzero(reached)
    return x[vesicle] + moves[vesicle, image][:, None], vesicle


def draw_suspension(
    ax: Axes, x, lattice, values=None, colors: ScalarMappable | None = None, view: Float[np.ndarray, "4"] | None = None
) -> PolyCollection:
    """Draws all vesicles in the rectangle of the cell, filled with the colours of one value for each, (M,)."""
    x, lattice = np.asarray(x), np.asarray(lattice)
    view = view_of(lattice) if view is None else view
    nodes, vesicle = images_in_view(x, lattice, view)
    found = PolyCollection(nodes, edgecolors=INK, linewidths=0.5 if len(x) > 64 else 0.8, joinstyle="round")
    if values is None:
        found.set_facecolor(_PLAIN)
    else:
        colors = scale(np.asarray(values)) if colors is None else colors
        found.set(array=np.asarray(values)[vesicle], norm=colors.norm, cmap=colors.cmap)
    ax.add_collection(found)
    ax.set(xlim=view[:2], ylim=view[2:], xticks=[], yticks=[], aspect="equal")
    return found


@rc_context(STYLE)
def suspension(x, lattice, values=None, *, label: str = "", ax: Into = None) -> Figure:
    """Returns a picture of a suspension at one instant.

    Args:
        x: nodes (M, N, 2), such as `result.x[-1]`.
        lattice: the vectors of the cell as rows, (2, 2), at this instant (`Cell.lattices`).
        values: one value for each vesicle, (M,), shown as colours.
        label: what the values are.
        ax: axes to draw into.
    """
    axes = given_axes(ax, 1)
    view = view_of(lattice)
    if axes is None:
        figure = Figure(figsize=(0.5 * PAGE, 0.5 * PAGE * min(aspect(view), 2.0)))
        axes = [figure.subplots()]
    drawn = draw_suspension(axes[0], x, lattice, values, view=view)
    figure = figure_of(axes[0])
    if values is not None:
        figure.colorbar(drawn, ax=axes[0], label=label, shrink=0.8)
    return figure


@rc_context(STYLE)
def suspension_film(
    t: Sequence[float], x, lattices, path: str | Path, values=None, *, label: str = "", per_second: int = 20
) -> None:
    """Writes a film of a suspension as .gif, .html or .mp4; errors are those of `animation`.

    Args:
        t: times (T,).
        x: nodes (T, M, N, 2).
        lattices: the vectors of the cell at each time, (T, 2, 2), or of all times, (2, 2).
        path: the file.
        values: one value for each time and vesicle, (T, M), shown as colours.
        label: what the values are.
        per_second: frames per second.
    """
    x = np.asarray(x)
    lattices = np.broadcast_to(np.asarray(lattices), (len(x), 2, 2))
    if len(t) != len(x):
        raise refusal("t", np.shape(t), f"one time for each of {len(x)} rows")
    views = np.array([view_of(lattice) for lattice in lattices])
    view = np.array([views[:, 0].min(), views[:, 1].max(), views[:, 2].min(), views[:, 3].max()])
    figure = Figure(figsize=(COLUMN, COLUMN * min(aspect(view), 2.0) + 0.2))
    ax = figure.subplots()
    colors = None if values is None else scale(np.asarray(values))
    if colors is not None:
        figure.colorbar(colors, ax=ax, label=label, shrink=0.8)

    def frame(row):
        drawn = draw_suspension(
            ax, x[row], lattices[row], None if values is None else np.asarray(values)[row], colors, view
        )
        ax.set_title(time_label(float(t[row])))
        return drawn

    rows = np.flatnonzero(np.isfinite(x).all(axis=(1, 2, 3)))
    written(figure, path, frame, rows.tolist(), per_second)
