"""A figure of outlines from a microscope: points, smooth curves, and the reduced area over time."""

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from .style import INK, PAGE, STYLE
from .windows import Into, aspect, figure_of, given_axes, window_of

_SHOWN = 4  # outlines beside each other


@rc_context(STYLE)
def outlines(frames: Any, *, ax: Into = None) -> Figure:
    """Draws points and curves of up to four frames side by side, and the reduced area of all frames over time.

    `frames` is what `read_frames` returns. With `ax`, the last of these axes shows the reduced area, and each of the
    others one frame. Frames are spread evenly. The band is the mean of all frames with its 95 % interval.

    Raises:
        ValueError: `ax` are fewer than two axes, or more than the frames have panels for.
    """
    given = given_axes(ax)
    count = min(_SHOWN, len(frames.numbers)) if given is None else len(given) - 1
    if not 1 <= count <= len(frames.numbers):
        raise ValueError(f"ax must have 2 to {len(frames.numbers) + 1} axes, but has {count + 1}.")
    rows = np.linspace(0, len(frames.numbers) - 1, count).astype(int)
    centers = [np.mean(frames.curves[row], axis=0) for row in rows]
    shown = [frames.curves[row] - center for row, center in zip(rows, centers, strict=True)]
    window = window_of(np.array(shown), margin=4.0, below=12.0)
    if given is None:
        height = PAGE / (count + 1.8) * aspect(window)
        figure = Figure(figsize=(PAGE, max(height + 0.4, 1.6)))
        given = list(figure.subplots(1, count + 1, width_ratios=[*[1.0] * count, 1.6]))
    for panel, row, center in zip(given, rows, centers, strict=False):
        curve = np.vstack([frames.curves[row], frames.curves[row][:1]]) - center
        panel.plot(*(frames.points[row] - center).T, ".", color="C1", markersize=1.5, label="points")
        panel.plot(*curve.T, color=INK, linewidth=0.8, label="curve")
        panel.set(xlim=window[:2], ylim=window[2:], aspect="equal", title=f"t = {frames.times[row]:.3g} s")
        panel.set_axis_off()
    bar = window[0] + np.array([0.0, 10.0])
    given[0].plot(bar, [window[2] + 3] * 2, color=INK, linewidth=1.5, solid_capstyle="butt")
    given[0].annotate("10 px", (bar[1], window[2] + 3), (3, 0), textcoords="offset points", va="center")
    last, each, mean = given[-1], frames.measures.reduced_area, frames.reduced_area
    last.errorbar(frames.times, each.value, each.error, fmt=".", color="C0", markersize=2, linewidth=0.5)
    last.axhspan(mean.value - 1.96 * mean.error, mean.value + 1.96 * mean.error, color="C1", alpha=0.5, linewidth=0)
    last.set(xlabel="time (s)", ylabel=r"reduced area $\Delta$")
    return figure_of(given[0])
