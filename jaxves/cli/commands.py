"""The commands: run, sweep, show, plot, export, check-grad, scenes, init, units. `console` has the exit statuses.

Modules that import JAX are imported inside the functions that need them, after the input has been checked.
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
from ..inputs.uses import RUN, for_use
from ..results import run_store, sweep_store
from ..results.hdf5 import StoreError
from ..results.ownership import refuse_written
from ..runs import continuation
from . import console, interrupts, long_runs, options, pictures, sweep_summary
from .run_summary import brief, derivatives, stability_line, summary

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Vesicles in two-dimensional Stokes flow under electric fields. Start with: jaxves run pop --out pop.h5",
)
_UsageError = typer.BadParameter.__base__  # its place depends on the version of typer


def answer(arguments: list[str]) -> int:
    """Runs one command; returns its exit status. Every error message is one line."""
    with console.warnings_in_one_line():
        return _answered(arguments)


def _answered(arguments: list[str]) -> int:
    try:
        return app(arguments or ["--help"], prog_name="jaxves", standalone_mode=False) or 0
    except _UsageError as error:
        return console.refused(error.format_message()).exit_code
    except (KeyboardInterrupt, typer.Abort):
        return console.INTERRUPTED
    except OSError as error:  # of the disk, for output or a figure
        console.say(error)
        return console.BROKE_DOWN


def _version(wanted: bool) -> bool:
    if wanted:
        console.out.print(__version__)
        raise typer.Exit
    return wanted


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


@app.command()
def run(
    scene: options.Scene,
    out: options.RunOut,
    force: options.Force = False,
    resume: options.RunResume = False,
    start: options.From = None,
    at: options.At = None,
    max_time: options.MaxTime = None,
) -> None:
    """Simulate a scene."""
    limit = _limit(max_time)
    try:
        scene_file = for_use(read_scene(scene), RUN)
        if force and resume:
            raise console.refused("--force replaces the result file and --resume continues it: give one of them.")
        if start is not None and resume:
            raise console.refused("--from is for a new run and --resume continues a file: give one of them.")
        if at is not None and start is None:
            raise console.refused(f"--at = {at}, expected --from FILE with it.")
        refuse_written(out)
        if resume and continuation.is_done(out, scene_file):
            word = run_store.read_result(out).status
            met = "" if word == status.WORDS[status.COMPLETE] else " Its stop condition is met; --from starts from it."
            console.out.print(f"{out} is done ({word}): there is nothing to resume.{met}", markup=False)
            return
    except (SceneError, StoreError) as error:
        raise console.refused(error) from None
    if not resume:
        console.refuse_existing([out], force, "use --force to replace it or --resume to continue it")

    code, session = long_runs.simulate(scene_file, out, limit, force=force, resume=resume, start=start, at=at)
    for part in brief(run_store.read_result(out), out, session):
        console.out.print(part, markup=False)
    raise typer.Exit(code)


@app.command()
def sweep(
    file: options.SweepFile,
    out: options.SweepOut,
    force: options.Force = False,
    resume: options.SweepResume = False,
    devices: options.Devices = None,
    batch: options.Batch = None,
    method: options.Method = None,
    distributed: options.Distributed = False,
    coordinator: options.Coordinator = None,
    processes: options.Processes = None,
    process: options.Process = None,
    max_time: options.MaxTime = None,
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
    console.start_jax()
    if distributed or coordinator:
        import jax

        jax.distributed.initialize(coordinator, processes, process)
    record = long_runs.sweep(file, out, limit, force=force, resume=resume, devices=devices, batch=batch, method=method)
    if record is not None:
        _summarise(record, out)


def _limit(max_time: str | None) -> float | None:
    """Returns the seconds of --max-time."""
    try:
        return None if max_time is None else interrupts.seconds(max_time)
    except ValueError:
        raise console.refused(f"--max-time = {max_time}, expected {interrupts.WANTED}.") from None


def _summarise(record: run_store.Record | sweep_store.SweepRecord, path: Path) -> None:
    told = sweep_summary.summary if isinstance(record, sweep_store.SweepRecord) else summary
    for part in told(record, path):
        console.out.print(part, markup=False)


def _loaded(path: Path) -> run_store.Record | sweep_store.SweepRecord:
    try:
        return sweep_store.read_sweep(path) if sweep_store.is_sweep(path) else run_store.read_result(path)
    except StoreError as error:
        raise console.refused(error) from None


@app.command()
def show(file: options.ResultFile, stability: options.Stability = False) -> None:
    """Summarise a result."""
    _summarise(record := _loaded(file), file)
    if stability:
        console.out.print(stability_line(record), markup=False)


@app.command()
def plot(
    file: options.ResultFile,
    what: options.What = None,
    quantity: options.Quantity = None,
    at: options.PlotAt = None,
    out: options.Stem = None,
    force: options.Force = False,
) -> None:
    """Draw figures of a result, such as FILE-snapshots.png."""
    record, stem = _loaded(file), out or file.with_suffix("")
    if isinstance(record, sweep_store.SweepRecord):
        pictures.of_sweep(record, file, what, quantity, stem, force)
    else:
        pictures.of_run(record, file, what, at, stem, force)


@app.command()
def export(file: options.ResultFile, out: options.ExportOut, force: options.Force = False) -> None:
    """Write a result for other programs: a table in CSV, or shapes for ParaView."""
    record = _loaded(file)
    if out.suffix not in (".csv", ".pvd"):
        raise console.refused(f"--out = {out}, expected a name that ends in .csv or .pvd.")
    if out.suffix == ".pvd" and isinstance(record, sweep_store.SweepRecord):
        raise console.refused(f"--out = {out}, expected a name that ends in .csv: {file} is the file of a sweep.")
    console.refuse_existing([out], force)
    try:
        record.to_csv(out) if out.suffix == ".csv" else record.to_vtk(out)
    except (ImportError, StoreError) as error:
        raise console.refused(error) from None
    console.out.print(f"wrote {out}", markup=False)


@app.command("check-grad")
def check_grad(
    scene: options.Scene,
    t_end: options.CheckedTime = 0.02,
    steps: options.CheckedSteps = 20,
) -> None:
    """Compare derivatives in forward mode, reverse mode and by differences. Exit status 3 if they disagree."""
    try:
        scene_file = read_scene(scene)
    except SceneError as error:
        raise console.refused(error) from None
    if not (math.isfinite(t_end) and t_end > 0):
        raise console.refused(f"--t-end = {t_end}, expected a positive finite number.")
    console.start_jax()
    from ..analysis import gradcheck

    with console.err.status("running") as said:
        progress = lambda i, count, text: said.update(text)  # noqa: E731
        try:
            rows = list(gradcheck.check_gradients(scene_file, t_end, steps, progress=progress))
        except gradcheck.BrokenDown as word:
            console.say(
                f"the run to be differentiated ends as {word}: use more nodes, more --steps or a smaller --t-end."
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
def init(file: options.NewScene = Path("scene.toml"), force: options.Force = False) -> None:
    """Write a scene file with comments."""
    console.refuse_existing([file], force)
    file.write_text(TEMPLATE, encoding="utf-8")
    console.wrote_scene(file)


@app.command()
def units(
    a: options.Size,
    E: options.FieldStrength,
    sigma_i: options.SigmaInside,
    sigma_e: options.SigmaOutside,
    epsilon: options.Permittivity,
    C_m: options.Capacitance,
    kappa_B: options.BendingStiffness,
    mu: options.Viscosity,
    G_m: options.Conductance = 0.0,
    shear_rate: options.ShearRate = 0.0,
    reduced_area: options.ReducedArea = 0.9,
    out: options.ScenePath = None,
    force: options.Force = False,
) -> None:
    """Convert laboratory quantities to the numbers of the model, and warn where the model does not hold.

    Prints the numbers of the model, the units of results, the limits of the model with warnings, and a scene's tables.

    With --out, writes a scene: an ellipse of this reduced area along the field, for ten times the slowest time.
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
    if out is not None:
        console.refuse_existing([out], force)
    import tomli_w

    from ..physics.units import LabQuantities
    from .units_report import conversion, scene_of_laboratory

    physical = LabQuantities(**quantities)
    for part in conversion(physical, reduced_area):
        console.out.print(part, markup=False)
    if out is not None:
        out.write_text(tomli_w.dumps(scene_of_laboratory(physical, reduced_area)), encoding="utf-8")
        console.out.print()
        console.wrote_scene(out)
