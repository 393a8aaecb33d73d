"""Films of runs: as a file, or for a notebook to play."""

import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FFMpegWriter, HTMLWriter, PillowWriter
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from .forcing import draw_forcing, forcing_of
from .run_plots import membranes
from .style import COLUMN, STYLE, SYMBOLS, scale, time_label
from .windows import aspect, coloring, window_of

_WRITERS = {".gif": PillowWriter, ".mp4": FFMpegWriter, ".html": HTMLWriter}


@rc_context(STYLE)
def animation(record, path: str | Path, *, color: str | None = None, frames: int = 150, per_second: int = 20) -> None:
    """Writes an animation of at most `frames` equally spaced saved times.

    The name of the file ends in .gif, in .html (a page with a player), or in .mp4, which needs the program ffmpeg.

    Raises:
        ValueError: the name of the file has another ending.
        RuntimeError: an .mp4 is asked for and ffmpeg is not installed.
    """
    require_writer(path)
    t, x = np.asarray(record.t), np.asarray(record.x)
    there = np.flatnonzero(np.isfinite(x).all(axis=(1, 2, 3)))
    color, values = coloring(record, color)
    colors = scale(values)
    window = window_of(x, margin=0.2)
    forcing = forcing_of(record)
    widths = [1.0] if forcing.is_absent() else [0.2, 1.0]
    height = min((COLUMN - 0.6) / sum(widths) * aspect(window) + 0.3, 2 * COLUMN)
    figure = Figure(figsize=(COLUMN, max(height, 0.25 * COLUMN)))
    panels = figure.subplots(1, len(widths), width_ratios=widths, squeeze=False)[0]
    if not forcing.is_absent():
        draw_forcing(panels[0], forcing)
    ax = panels[-1]
    ax.set(xlim=window[:2], ylim=window[2:])
    ax.set_axis_off()
    figure.colorbar(colors, ax=ax, label=SYMBOLS[color], shrink=0.8)

    def frame(row):
        drawn = membranes(ax, x[row], values[row], colors)
        ax.set_title(time_label(float(t[row])))
        return drawn

    rows = there[np.unique(np.linspace(0, len(there) - 1, frames).round().astype(int))]
    written(figure, path, frame, rows.tolist(), per_second)


def require_writer(path: str | Path) -> None:
    """Raises ValueError if a film cannot have this name, or RuntimeError if it needs ffmpeg, which is missing."""
    path = Path(path)
    if path.suffix not in _WRITERS:
        raise ValueError(f"A film is written as .gif, .html or .mp4, not as {path.name!r}.")
    if path.suffix == ".mp4" and not FFMpegWriter.isAvailable():
        raise RuntimeError(f"{path.name!r} needs the program ffmpeg, which is not installed; write a .gif instead.")


def written(
    figure: Figure, path: str | Path, frame: Callable[[int], Artist], rows: Iterable[int], per_second: int
) -> None:
    """Writes a film with one frame for each row. `frame` draws a row and returns what is removed after it."""
    require_writer(path)
    path = Path(path)
    embedded = {"embed_frames": True} if path.suffix == ".html" else {}
    writer = _WRITERS[path.suffix](fps=per_second, **embedded)
    with writer.saving(figure, str(path), dpi=figure.dpi):
        for row in rows:
            drawn = frame(row)
            writer.grab_frame()
            drawn.remove()


class Film:
    """A film that a notebook plays. `save` writes it to a file."""

    def __init__(self, record: Any, how: dict[str, Any]):
        self._record, self._how = record, how

    def save(self, path: str | Path) -> None:
        """Writes the film as .gif, .html or .mp4; errors are those of `animation`."""
        animation(self._record, path, **self._how)

    def _repr_html_(self) -> str:
        with tempfile.TemporaryDirectory() as folder:
            page = Path(folder) / "film.html"
            self.save(page)
            return page.read_text(encoding="utf-8")


def film(record: Any, *, color: str | None = None, frames: int = 60, per_second: int = 20) -> Film:
    """Returns a film of at most `frames` saved times; membranes are coloured as in `snapshots`."""
    return Film(record, {"color": color, "frames": frames, "per_second": per_second})
