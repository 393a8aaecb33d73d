"""Figures of runs and sweeps. The functions take what `simulate`, `load` and `sweep` return.

style           sizes, colours, labels
moments         choice of the instants that show how a shape changes
windows         the part of the plane that is shown, colours of membranes, axes of the caller
forcing         the imposed field and flow as a sketch
run_plots       shapes and time series
lines           streamlines and field lines
films           animations
cell_plots      suspensions in a periodic cell
frame_plots     outlines from a microscope
grid_cells      the cells of a grid of cases: edges, borders between classes, cells without a result
sweep_plots     phase diagrams, maps, curves
drawing         figures by name, for the methods of results
"""

from .cell_plots import suspension, suspension_film
from .drawing import draw, draw_sweep, instant
from .films import animation, film
from .frame_plots import outlines
from .lines import field_lines, streamlines
from .run_plots import history, membranes, snapshots
from .style import COLUMN, INK, PAGE, STYLE
from .sweep_plots import curves, phase_diagram, quantity_map

__all__ = [
    "COLUMN",
    "INK",
    "PAGE",
    "STYLE",
    "animation",
    "curves",
    "draw",
    "draw_sweep",
    "field_lines",
    "film",
    "history",
    "instant",
    "membranes",
    "outlines",
    "phase_diagram",
    "quantity_map",
    "snapshots",
    "streamlines",
    "suspension",
    "suspension_film",
]
