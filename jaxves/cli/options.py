"""Arguments and options of the commands: names, types and help texts. `commands` has their defaults."""

from pathlib import Path
from typing import Annotated

import typer

from .pictures import Picture

# Several commands
Scene = Annotated[str, typer.Argument(help="A scene file (TOML), or the name of a built-in scene.")]
ResultFile = Annotated[Path, typer.Argument(help="A result file.")]
Stability = Annotated[
    bool,
    typer.Option("--stability", help="Also compute whether disturbances of the last state grow, if it is steady."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace existing files.")]
MaxTime = Annotated[
    str | None,
    typer.Option(
        "--max-time",
        help="Time limit: seconds, 90m, 1.5h, 1:30:00 or 2-12:00:00. The work is interrupted, as by Ctrl-C, a tenth of "
        "the limit before its end, and at most a minute before. Exit status 130.",
    ),
]

# run
RunOut = Annotated[Path, typer.Option("--out", "-o", help="The result file (HDF5).")]
RunResume = Annotated[
    bool, typer.Option("--resume", help="Continue the result file, also to a larger t_end of the scene.")
]
From = Annotated[
    Path | None,
    typer.Option(
        "--from",
        help="Start from the last saved time of this result file: from its nodes and, if both have a field, its "
        "membrane potential. Shapes, positions, `relaxed` and `disturbance` of the scene are not used.",
    ),
]
At = Annotated[float | None, typer.Option("--at", help="With --from: start from the saved time nearest to this.")]

# sweep
SweepFile = Annotated[Path, typer.Argument(help="A sweep file (TOML): a scene, and the values of some of its numbers.")]
SweepOut = Annotated[Path, typer.Option("--out", "-o", help="The result file (HDF5).")]
SweepResume = Annotated[bool, typer.Option("--resume", help="Continue the result file.")]
Devices = Annotated[
    int | None, typer.Option("--devices", min=1, help="Number of devices. Default: all cores, or all GPUs.")
]
Batch = Annotated[int | None, typer.Option("--batch", min=1, help="Cases per device and call.")]
Method = Annotated[
    str | None,
    typer.Option("--method", help="map: one case after the other (default on CPU). vmap: together (default on GPU)."),
]
Distributed = Annotated[bool, typer.Option("--distributed", help="Run as one task of a Slurm job.")]
Coordinator = Annotated[str | None, typer.Option("--coordinator", help="HOST:PORT of process 0.")]
Processes = Annotated[int | None, typer.Option("--processes", min=1, help="Number of processes.")]
Process = Annotated[int | None, typer.Option("--process", min=0, help="Number of this process, from 0.")]

# plot
What = Annotated[
    list[Picture] | None,
    typer.Option(
        "--what", "-w", help="Figure to draw; may be repeated. Default: snapshots and history; for sweeps by dimension."
    ),
]
Quantity = Annotated[
    str | None, typer.Option("--quantity", "-q", help="Quantity that maps and curves of a sweep show.")
]
PlotAt = Annotated[
    float | None, typer.Option("--at", help="Time of streamlines and field lines, in t_κ. Default: the end.")
]
Stem = Annotated[
    Path | None, typer.Option("--out", "-o", help="First part of the names of the figures. Default: that of FILE.")
]

# check-grad and init
CheckedTime = Annotated[float, typer.Option("--t-end", help="Time of the diagnostics, in t_κ.")]
CheckedSteps = Annotated[int, typer.Option("--steps", min=1, help="Number of fixed steps.")]
NewScene = Annotated[Path, typer.Argument(help="The scene file to write.")]

# units
Size = Annotated[float, typer.Option("--a", help="Size, perimeter / 2π, in m.")]
FieldStrength = Annotated[float, typer.Option("--E", help="Field strength, in V/m.")]
SigmaInside = Annotated[float, typer.Option("--sigma-i", help="Conductivity inside, in S/m.")]
SigmaOutside = Annotated[float, typer.Option("--sigma-e", help="Conductivity outside, in S/m.")]
Permittivity = Annotated[
    float, typer.Option("--epsilon", help="Absolute permittivity outside, in F/m; 7e-10 for water.")
]
Capacitance = Annotated[float, typer.Option("--C-m", help="Membrane capacitance, in F/m².")]
BendingStiffness = Annotated[float, typer.Option("--kappa-B", help="Bending stiffness, in J.")]
Viscosity = Annotated[float, typer.Option("--mu", help="Viscosity, in Pa s.")]
Conductance = Annotated[float, typer.Option("--G-m", help="Membrane conductance, in S/m².")]
ShearRate = Annotated[float, typer.Option("--shear-rate", help="Shear rate, in 1/s.")]
ReducedArea = Annotated[
    float, typer.Option("--reduced-area", help="4π area / perimeter², for the regime and the scene.")
]
ScenePath = Annotated[Path | None, typer.Option("--out", "-o", help="Also write a scene file with these numbers.")]

# export
ExportOut = Annotated[
    Path,
    typer.Option("--out", "-o", help="FILE.csv: a table of diagnostics, or of cases. FILE.pvd: shapes for ParaView."),
]
