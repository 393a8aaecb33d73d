"""Arguments and options of the commands: their names, types and help texts. Their defaults stand with the commands."""

from pathlib import Path
from typing import Annotated

import typer

from .pictures import Picture

# Several commands
Scene = Annotated[str, typer.Argument(help="A scene file (TOML), or the name of a built-in scene.")]
ResultFile = Annotated[Path, typer.Argument(help="A result file.")]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there already.")]
MaxTime = Annotated[
    str | None,
    typer.Option(
        "--max-time",
        help="Stop in time to be done by then, as Ctrl-C does: seconds, 90m, 1.5h, 1:30:00, 2-12:00:00. A tenth of it, "
        "at most a minute, is left for the end. Exit status 130.",
    ),
]

# run
RunOut = Annotated[Path, typer.Option("--out", "-o", help="The result file (HDF5).")]
RunResume = Annotated[
    bool, typer.Option("--resume", help="Go on where the result file ends, also to a larger t_end of the scene.")
]
From = Annotated[
    Path | None,
    typer.Option(
        "--from",
        help="Start from the end of this result file: its nodes and, where both have a field, its membrane "
        "potential replace shapes, places, `relaxed` and `disturbance` of the scene's vesicles.",
    ),
]
At = Annotated[float | None, typer.Option("--at", help="With --from: at its saved time nearest to this.")]

# sweep
SweepFile = Annotated[Path, typer.Argument(help="A sweep file (TOML): a scene, and which numbers take which values.")]
SweepOut = Annotated[Path, typer.Option("--out", "-o", help="The file of results (HDF5).")]
SweepResume = Annotated[bool, typer.Option("--resume", help="Go on where the file of results ends.")]
Devices = Annotated[int | None, typer.Option("--devices", min=1, help="Default: all cores, or all GPUs.")]
Batch = Annotated[int | None, typer.Option("--batch", min=1, help="Cases per device and call.")]
Method = Annotated[str | None, typer.Option("--method", help="map (default on CPU) or vmap (on GPU).")]
Distributed = Annotated[bool, typer.Option("--distributed", help="One of several, as Slurm says.")]
Coordinator = Annotated[str | None, typer.Option("--coordinator", help="HOST:PORT of process 0.")]
Processes = Annotated[int | None, typer.Option("--processes", min=1, help="How many there are.")]
Process = Annotated[int | None, typer.Option("--process", min=0, help="Which one this is, from 0.")]

# plot
What = Annotated[
    list[Picture] | None,
    typer.Option("--what", "-w", help="May be repeated. Default: snapshots and history; of a sweep what suits it."),
]
Quantity = Annotated[str | None, typer.Option("--quantity", "-q", help="Of a sweep: what map and curves show.")]
PlotAt = Annotated[float | None, typer.Option("--at", help="Time of the lines, in t_κ. Default: the end.")]
Stem = Annotated[Path | None, typer.Option("--out", "-o", help="Stem of the picture files. Default: FILE's.")]

# check-grad and init
CheckedTime = Annotated[float, typer.Option("--t-end", help="Where diagnostics are taken, in t_κ.")]
CheckedSteps = Annotated[int, typer.Option("--steps", min=1, help="Fixed steps until then.")]
NewScene = Annotated[Path, typer.Argument(help="The scene file to write.")]

# units
Size = Annotated[float, typer.Option("--a", help="Size, perimeter / 2π, in m.")]
FieldStrength = Annotated[float, typer.Option("--E", help="Field strength, in V/m.")]
SigmaInside = Annotated[float, typer.Option("--sigma-i", help="Conductivity inside, in S/m.")]
SigmaOutside = Annotated[float, typer.Option("--sigma-e", help="Conductivity outside, in S/m.")]
Permittivity = Annotated[
    float, typer.Option("--epsilon", help="Permittivity outside, absolute, in F/m; of water 7e-10.")
]
Capacitance = Annotated[float, typer.Option("--C-m", help="Membrane capacitance, in F/m².")]
BendingStiffness = Annotated[float, typer.Option("--kappa-B", help="Bending stiffness, in J.")]
Viscosity = Annotated[float, typer.Option("--mu", help="Viscosity, in Pa s.")]
Conductance = Annotated[float, typer.Option("--G-m", help="Membrane conductance, in S/m².")]
ShearRate = Annotated[float, typer.Option("--shear-rate", help="Shear rate, in 1/s.")]
ReducedArea = Annotated[
    float, typer.Option("--reduced-area", help="4π area / perimeter², for the estimates of the regime.")
]
