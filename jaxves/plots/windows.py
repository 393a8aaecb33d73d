"""The part of the plane that a figure shows, the colours of membranes, and the axes to draw into."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

Into = Axes | Sequence[Axes] | np.ndarray | None  # as `Figure.subplots` returns them


def coloring(record: Any, color: str | None) -> tuple[str, np.ndarray]:
    """Returns the name and the values (T, M, N) that colour the membranes of a result.

    Raises:
        ValueError: the result has no such quantity.
    """
    color = color or ("tension" if record.V_m is None else "V_m")
    if color not in ("V_m", "tension") or getattr(record, color) is None:
        known = "'tension'" if record.V_m is None else "'V_m' or 'tension'"
        raise ValueError(f"Argument `color` must be {known} for this record, but is {color!r}.")
    return color, np.asarray(getattr(record, color))


def window_of(x: np.ndarray, margin: float, below: float | None = None) -> Float[np.ndarray, "4"]:
    """Returns (x_min, x_max, y_min, y_max) of all finite nodes with a `margin`, and `below` at the bottom if given."""
    low, high = np.nanmin(x.reshape(-1, 2), axis=0), np.nanmax(x.reshape(-1, 2), axis=0)
    return np.array([low[0] - margin, high[0] + margin, low[1] - (below or margin), high[1] + margin])


def aspect(window: np.ndarray) -> float:
    """Returns the height of a window over its width."""
    return float((window[3] - window[2]) / (window[1] - window[0]))


def given_axes(ax: Into, count: int | None = None) -> list[Axes] | None:
    """Returns the axes of the caller as a list, or None if the figure is to be made here.

    Raises:
        ValueError: there are not as many axes as panels to draw.
    """
    if ax is None:
        return None
    axes = [ax] if isinstance(ax, Axes) else [one for one in np.ravel(np.asarray(ax, dtype=object))]
    if count is not None and len(axes) != count:
        raise ValueError(f"ax must have {count} axes, one for each panel, but has {len(axes)}.")
    return axes


def figure_of(ax: Axes) -> Figure:
    """Returns the figure that has these axes."""
    return ax.get_figure(root=True)
