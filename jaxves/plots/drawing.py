"""Figures by their names: what `result.plot("history")` and `record.plot("map")` draw."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..base.arguments import refusal
from ..equation.equation import Equation, equation_for
from ..equation.state import Unknowns
from ..physics.scene import Scene
from ..runs.problem import reconstructed, state_at
from . import lines, run_plots, sweep_plots

_OF_RUN = {"snapshots": run_plots.snapshots, "history": run_plots.history}
_LINES = {"streamlines": lines.streamlines, "field-lines": lines.field_lines}
_OF_SWEEP = {"phases": sweep_plots.phase_diagram, "map": sweep_plots.quantity_map, "curves": sweep_plots.curves}


def draw(record: Any, what: str = "snapshots", *, t: float | None = None, **how: Any) -> Figure:
    """Draws the figure of a run that is called `what`, at the saved time nearest to `t` for lines.

    Raises:
        ValueError: there is no such figure, or its function refuses the options `how`.
    """
    if what in _LINES:
        return _LINES[what](*instant(record, float(np.nanmax(record.t)) if t is None else t), **how)
    if what not in _OF_RUN:
        raise refusal("what", what, f"one of {', '.join([*_OF_RUN, *_LINES])}")
    if t is not None:
        raise refusal("t", t, f"no time for {what}")
    return _OF_RUN[what](record, **how)


def instant(record: Any, t: float) -> tuple[Equation, float, Unknowns]:
    """Returns the equation of a result, the saved time nearest to t, and the state at this time.

    Raises:
        ValueError: the result does not have its scene.
    """
    scene = getattr(record, "scene", None)
    if not scene:
        raise ValueError("This result does not have its scene, which streamlines and field lines need.")
    if not isinstance(scene, Scene):
        return reconstructed(record, t)
    row = int(np.nanargmin(np.abs(np.asarray(record.t) - t)))
    return equation_for(scene), float(record.t[row]), state_at(record, row)


def draw_sweep(record: Any, what: str | None = None, **how: Any) -> Figure:
    """Draws the figure of a sweep that is called `what`, by default what suits its numbers and classes.

    Raises:
        ValueError: there is no such figure, or its function refuses the options `how`.
    """
    if what is None:
        grid = "phases" if record.classes is not None else "map"
        what = "curves" if len(record.coordinates) == 1 else grid
    if what not in _OF_SWEEP:
        raise refusal("what", what, f"one of {', '.join(_OF_SWEEP)}")
    return _OF_SWEEP[what](record, **how)
