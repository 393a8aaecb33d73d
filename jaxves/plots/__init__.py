"""Figures of runs and sweeps. The functions take what `simulate`, `read_result` or `read_sweep` return.

style           sizes, colours, labels
moments         choice of the instants that show how a shape changes
run_plots       snapshots, time series, streamlines, field lines, animations
sweep_plots     phase diagrams, maps, curves
"""

from .run_plots import animation, field_lines, history, membranes, snapshots, streamlines
from .style import COLUMN, INK, PAGE, STYLE
from .sweep_plots import curves, phase_diagram, quantity_map

__all__ = [
    "COLUMN",
    "INK",
    "PAGE",
    "STYLE",
    "animation",
    "curves",
    "field_lines",
    "history",
    "membranes",
    "phase_diagram",
    "quantity_map",
    "snapshots",
    "streamlines",
]
