"""Commands: run, sweep, show, plot, check-grad, scenes, init, units. `jaxves.console` has the exit statuses.

Nothing here computes; modules that import JAX are imported inside what needs them, after the input has been checked.
"""

import math
from pathlib import Path
from typing import Annotated

import typer

from .. import __version__
from ..base import status
from ..inputs import sweep_files
from ..inputs.scene_files import SceneError, built_in_scenes, read_scene
from ..inputs.template import TEMPLATE
from ..results import run_store, sweep_store
from ..results.ownership import refuse_written
from ..results.run_store import Record, StoreError
from ..results.sweep_store import SweepRecord
from ..runs import continuation
from . import console, interrupts, long_runs, pictures, sweep_summary
from .pictures import Picture
from .run_summary import derivatives, summary

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Vesicles in two-dimensional Stokes flow under electric fields. Start with: jaxves run pop --out pop.h5",
)
_UsageError = typer.BadParameter.__base__  # typer has it in different places

Force = Annotated[bool, typer.Option("--force", help="Replace what is there already.")]
MaxTime = Annotated[
    str | None,
    typer.Option(
        "--max-time",
        help="Stop in time to be done by then, as Ctrl-C does: seconds, 90m, 1.5h, 1:30:00, 2-12:00:00. A tenth of it, "
        "at most a minute, is left for the end. Exit status 130.",
    ),
]


def answer(arguments: list[str]) -> int:
    """Runs one command; returns its exit status. All complaints are one line."""
    with console.warnings_in_one_line():
        return _answered(arguments)


def _answered(arguments: list[str]) -> int:
    try:
        return app(arguments or ["--help"], prog_name="jaxves", standalone_mode=False) or 0
    except _UsageError as error:
        return console.refused(error.format_message()).exit_code
    except (KeyboardInterrupt, typer.Abort):
        return console.INTERRUPTED
    except OSError as error:  # of the disk that the output goes to, or a picture
        console.say(error)
        return console.BROKE_DOWN


def _version(wanted: bool) -> bool:
    if wanted:
        console.out.print(__version__)
        raise typer.Exit
    return wanted


@app.callback()
def _main(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which.")] = False,
) -> None:
    pass


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="A scene file (TOML), or the name of a built-in scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The result file (HDF5).")],
    force: Force = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on where the result file ends, also to a larger t_end of the scene.")
    ] = False,
    start: Annotated[
        Path | None,
        typer.Option(
            "--from",
            help="Start from the end of this result file: its nodes and, where both have a field, its membrane "
            "potential replace shapes, places, `relaxed` and `disturbance` of the scene's vesicles.",
        ),
    ] = None,
    at: Annotated[float | None, typer.Option("--at", help="With --from: at its saved time nearest to this.")] = None,
    max_time: MaxTime = None,
) -> None:
    """Simulate a scene."""
    limit = _limit(max_time)
    try:
        scene_file = read_scene(scene)
        if force and resume:
            raise console.refused("--force replaces the result file and --resume continues it: give one of them.")
        if start is not None and resume:
            raise console.refused("--from is for a new run: a result file has its own start, --resume needs no other.")
        if at is not None and start is None:
            raise console.refused(f"--at = {at}, expected --from FILE with it.")
        refuse_written(out)
        if resume and continuation.is_done(out, scene_file):
            word = run_store.read_result(out).status
            met = "" if word == status.WORDS[status.COMPLETE] else " Its stop condition is met; --from goes on from it."
            console.out.print(f"{out} is done ({word}): there is nothing to resume.{met}", markup=False)
            return
    except (SceneError, StoreError) as error:
        raise console.refused(error) from None
    if not resume:
        console.refuse_existing([out], force, "use --force to replace it or --resume to continue it")

    code = long_runs.simulate(scene_file, out, limit, force=force, resume=resume, start=start, at=at)
    _summarise(run_store.read_result(out), out)
    raise typer.Exit(code)


@app.command()
def sweep(
    file: Annotated[Path, typer.Argument(help="A sweep file (TOML): a scene, and which numbers take which values.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The file of results (HDF5).")],
    force: Force = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where the file of results ends.")] = False,
    devices: Annotated[int | None, typer.Option("--devices", min=1, help="Default: all cores, or all GPUs.")] = None,
    batch: Annotated[int | None, typer.Option("--batch", min=1, help="Cases per device and call.")] = None,
    method: Annotated[str | None, typer.Option("--method", help="map (default on CPU) or vmap (on GPU).")] = None,
    distributed: Annotated[bool, typer.Option("--distributed", help="One of several, as Slurm says.")] = False,
    coordinator: Annotated[str | None, typer.Option("--coordinator", help="HOST:PORT of process 0.")] = None,
    processes: Annotated[int | None, typer.Option("--processes", min=1, help="How many there are.")] = None,
    process: Annotated[int | None, typer.Option("--process", min=0, help="Which one this is, from 0.")] = None,
    max_time: MaxTime = None,
) -> None:
    """Compute many cases of one scene."""
    limit = _limit(max_time)
    by_hand = (coordinator, processes, process)
    if any(part is not None for part in by_hand) and None in by_hand:
        raise console.refused("--coordinator, --processes and --process belong together: give all of them.")
    is_alone = coordinator is None and not distributed
    try:
        sweep_files.read_sweep_file(file)
        if is_alone:
            refuse_written(out)
    except (SceneError, StoreError) as error:
        raise console.refused(error) from None
    if not resume and (process or 0) == 0 and not distributed:
        console.refuse_existing([out], force, "use --force to replace it or --resume to continue it")
    long_runs.use_all_cores(devices)
    long_runs.keep_compiled()
    if distributed or coordinator:
        import jax

        jax.distributed.initialize(coordinator, processes, process)
    record = long_runs.sweep(file, out, limit, force=force, resume=resume, devices=devices, batch=batch, method=method)
    if record is not None:
        _summarise(record, out)


def _limit(max_time: str | None) -> float | None:
    """The seconds of --max-time."""
    try:
        return None if max_time is None else interrupts.seconds(max_time)
    except ValueError:
        raise console.refused(f"--max-time = {max_time}, expected {interrupts.WANTED}.") from None


def _summarise(record: Record | SweepRecord, path: Path) -> None:
    told = sweep_summary.summary if isinstance(record, SweepRecord) else summary
    for part in told(record, path):
        console.out.print(part, markup=False)


def _loaded(path: Path) -> Record | SweepRecord:
    try:
        return sweep_store.read_sweep(path) if sweep_store.is_sweep(path) else run_store.read_result(path)
    except StoreError as error:
        raise console.refused(error) from None


@app.command()
def show(file: Annotated[Path, typer.Argument(help="A result file.")]) -> None:
    """Summarise a result in a few lines."""
    _summarise(_loaded(file), file)


@app.command()
def plot(
    file: Annotated[Path, typer.Argument(help="A result file.")],
    what: Annotated[
        list[Picture] | None,
        typer.Option("--what", "-w", help="May be repeated. Default: snapshots and history; of a sweep what suits it."),
    ] = None,
    quantity: Annotated[
        str | None, typer.Option("--quantity", "-q", help="Of a sweep: what map and curves show.")
    ] = None,
    at: Annotated[float | None, typer.Option("--at", help="Time of the lines, in t_κ. Default: the end.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Stem of the picture files. Default: FILE's.")] = None,
    force: Force = False,
) -> None:
    """Draw a result: FILE-snapshots.png and so on."""
    record, stem = _loaded(file), out or file.with_suffix("")
    if isinstance(record, SweepRecord):
        pictures.of_sweep(record, file, what, quantity, stem, force)
    else:
        pictures.of_run(record, file, what, at, stem, force)


@app.command("check-grad")
def check_grad(
    scene: Annotated[str, typer.Argument(help="A scene file (TOML), or the name of a built-in scene.")],
    t_end: Annotated[float, typer.Option("--t-end", help="Where diagnostics are taken, in t_κ.")] = 0.02,
    steps: Annotated[int, typer.Option("--steps", min=1, help="Fixed steps until then.")] = 20,
) -> None:
    """Compare derivatives in all numbers of a scene: forward, reverse, differences. Exit status 3 if they disagree."""
    try:
        scene_file = read_scene(scene)
    except SceneError as error:
        raise console.refused(error) from None
    if not (math.isfinite(t_end) and t_end > 0):
        raise console.refused(f"--t-end = {t_end}, expected a positive finite number.")
    long_runs.keep_compiled()
    from ..analysis import gradcheck

    with console.err.status("running") as said:
        try:
            rows = list(gradcheck.check_gradients(scene_file, t_end, steps, progress=said.update))
        except gradcheck.BrokenDown as word:
            console.say(
                f"the run to be differentiated ends as {word}: give it more nodes, more --steps or a smaller --t-end."
            )
            raise typer.Exit(console.BROKE_DOWN) from None
    for part in derivatives(rows):
        console.out.print(part)
    if any(row.verdict == "DISAGREE" for row in rows):
        raise typer.Exit(console.BROKE_DOWN)


@app.command()
def scenes() -> None:
    """List the built-in scenes."""
    for name, text in built_in_scenes().items():
        console.out.print(f"{name:15} {text}", markup=False)


@app.command()
def init(
    file: Annotated[Path, typer.Argument(help="The scene file to write.")] = Path("scene.toml"), force: Force = False
) -> None:
    """Write a commented scene file to start from."""
    console.refuse_existing([file], force)
    file.write_text(TEMPLATE, encoding="utf-8")
    console.out.print(
        f"wrote {file}; simulate it with: jaxves run {file} --out {file.with_suffix('.h5')}", markup=False
    )


@app.command()
def units(
    a: Annotated[float, typer.Option("--a", help="Size, perimeter / 2π, in m.")],
    E: Annotated[float, typer.Option("--E", help="Field strength, in V/m.")],
    sigma_i: Annotated[float, typer.Option("--sigma-i", help="Conductivity inside, in S/m.")],
    sigma_e: Annotated[float, typer.Option("--sigma-e", help="Conductivity outside, in S/m.")],
    epsilon: Annotated[
        float, typer.Option("--epsilon", help="Permittivity outside, absolute, in F/m; of water 7e-10.")
    ],
    C_m: Annotated[float, typer.Option("--C-m", help="Membrane capacitance, in F/m².")],
    kappa_B: Annotated[float, typer.Option("--kappa-B", help="Bending stiffness, in J.")],
    mu: Annotated[float, typer.Option("--mu", help="Viscosity, in Pa s.")],
    G_m: Annotated[float, typer.Option("--G-m", help="Membrane conductance, in S/m².")] = 0.0,
    shear_rate: Annotated[float, typer.Option("--shear-rate", help="Shear rate, in 1/s.")] = 0.0,
    reduced_area: Annotated[
        float, typer.Option("--reduced-area", help="4π area / perimeter², for the estimates of the regime.")
    ] = 0.9,
) -> None:
    """Convert laboratory quantities to the model's numbers, and say where the model ends for them.

    Prints the dimensionless numbers, the units of results, the regime of the vesicle (wrinkles, inertia, voltage,
    charge relaxation) with a warning for each limit that is passed, and the tables of a scene file.
    """
    quantities = dict(
        a=a, E=E, sigma_i=sigma_i, sigma_e=sigma_e, epsilon=epsilon, C_m=C_m, kappa_B=kappa_B, mu=mu, G_m=G_m,
        shear_rate=shear_rate,
    )  # fmt: skip
    for name, value in quantities.items():
        may_vanish = name in ("E", "sigma_i", "G_m", "shear_rate")
        if not math.isfinite(value) or (value < 0 and name != "shear_rate") or (value == 0 and not may_vanish):
            wanted = "a finite number" if name == "shear_rate" else f"a finite number {'>=' if may_vanish else '>'} 0"
            raise console.refused(f"--{name.replace('_', '-')} = {value}, expected {wanted}.")
    if not 0 < reduced_area < 1:
        raise console.refused(f"--reduced-area = {reduced_area}, expected a number > 0 and < 1.")
    from ..physics.units import LabQuantities
    from .units_report import conversion

    for part in conversion(LabQuantities(**quantities), reduced_area):
        console.out.print(part, markup=False)
