"""Commands: run, sweep, show, plot, scenes, init, units.

Exit status: 0 done, 2 bad input, 3 broke down, 130 interrupted.

Nothing here computes; modules that import JAX are imported inside the commands that need them, after the input
has been checked.
"""

import enum
import math
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from . import __version__, status, store, sweepfile, sweepstore, sweepsummary
from .scenefile import SceneError, SceneFile, builtin_names, load, to_toml
from .store import Record, StoreError
from .summary import derivatives, summary
from .sweepstore import SweepRecord
from .template import TEMPLATE

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Vesicles in two-dimensional Stokes flow under electric fields. Start with: jaxves run pop --out pop.h5",
)
_out = Console(highlight=False, soft_wrap=True)
_err = Console(stderr=True, highlight=False, soft_wrap=True)

BAD_INPUT, BROKE_DOWN, INTERRUPTED = 2, 3, 130
_UsageError = typer.BadParameter.__base__  # typer has it in different places

Force = Annotated[bool, typer.Option("--force", help="Replace what is there already.")]


def answer(arguments: list[str]) -> int:
    """Runs one command; returns its exit status. All complaints are one line."""
    try:
        return app(arguments or ["--help"], prog_name="jaxves", standalone_mode=False) or 0
    except _UsageError as error:
        return _refuse(error.format_message()).exit_code
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED


def _say(message: object) -> None:
    _err.print(f"jaxves: {' '.join(str(message).split())}", markup=False)


def _refuse(message: object) -> typer.Exit:
    _say(message)
    return typer.Exit(BAD_INPUT)


def _refuse_existing(paths: list[Path], force: bool, remedy: str = "use --force to replace it") -> None:
    for path in paths:
        if path.exists() and not force:
            raise _refuse(f"{path} exists already: {remedy}.")
        if path.is_dir():
            raise _refuse(f"{path} is a folder, expected the name of a file.")
        if not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
            raise _refuse(f"{path.parent} is not a folder that can be written to.")


def _version(wanted: bool) -> bool:
    if wanted:
        _out.print(__version__)
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
    resume: Annotated[bool, typer.Option("--resume", help="Go on where the result file ends.")] = False,
) -> None:
    """Simulate a scene."""
    try:
        scene_file = load(scene)
        if force and resume:
            raise _refuse("--force replaces the result file and --resume continues it: give one of them.")
        if resume and store.is_done(out, to_toml(scene_file)):
            _out.print(f"{out} is done ({store.load(out).status}): there is nothing to resume.")
            return
    except (SceneError, StoreError) as error:
        raise _refuse(error) from None
    if not resume:
        _refuse_existing([out], force, "use --force to replace it or --resume to continue it")

    word = _simulate(scene_file, out, force, resume)
    _summarise(store.load(out), out)
    if word == status.WORDS[status.INTERRUPTED]:
        raise typer.Exit(INTERRUPTED)
    if word not in status.SUCCESS:
        raise typer.Exit(BROKE_DOWN)


def _simulate(scene_file: SceneFile, out: Path, force: bool, resume: bool) -> str:
    columns = (
        TextColumn("t = {task.completed:.3g} / {task.total:.3g}"),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=_err, transient=True) as bar, _heard_interrupts() as pressed:
        task = bar.add_task("starting", total=scene_file.t_end)

        def show(t: float, text: str) -> None:
            if pressed:
                raise KeyboardInterrupt
            bar.update(task, completed=t, description=text)

        _keep_compiled()
        from . import runner

        try:
            return runner.run(scene_file, out, force=force, resume=resume, progress=show)
        except StoreError as error:
            raise _refuse(error) from None
        except runner.Broken as error:
            _say(error)
            raise typer.Exit(BROKE_DOWN) from None


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
) -> None:
    """Compute many cases of one scene."""
    by_hand = (coordinator, processes, process)
    if any(part is not None for part in by_hand) and None in by_hand:
        raise _refuse("--coordinator, --processes and --process belong together: give all of them.")
    try:
        sweepfile.load(file)
    except SceneError as error:
        raise _refuse(error) from None
    if not resume and (process or 0) == 0 and not distributed:
        _refuse_existing([out], force, "use --force to replace it or --resume to continue it")
    _use_all_cores(devices)
    _keep_compiled()
    if distributed or coordinator:
        import jax

        jax.distributed.initialize(coordinator, processes, process)
    record = _sweep(file, out, force=force, resume=resume, devices=devices, batch=batch, method=method)
    if record is not None:
        _summarise(record, out)


def _sweep(file: Path, out: Path, **how) -> SweepRecord | None:
    """The record, on the first of several processes."""
    from . import sweeping, team

    columns = (
        TextColumn("{task.completed} of {task.total} {task.description}"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    bars = Progress(*columns, console=_err, transient=True, disable=not team.is_first(), speed_estimate_period=600)
    with bars as bar, _heard_interrupts() as pressed:
        task = bar.add_task("compiling", total=None, rate="")
        there = []

        def show(done: int, total: int, text: str) -> None:
            if pressed:
                raise KeyboardInterrupt
            if text != "compiling":
                there.append((time.monotonic(), done))
            (began, first), (now, _) = (there[0], there[-1]) if there else ((0, 0), (0, 0))
            rate = f"{(done - first) / (now - began):.3g}/s" if now > began else ""
            bar.update(task, completed=done, total=total, description=text, rate=rate)

        try:
            record = sweeping.sweep(file, out, progress=show, **how)
        except (SceneError, StoreError) as error:
            raise _refuse(error) from None
    if not team.is_first():
        return None
    before = sweepstore.count_computed(record.status) - record.computed
    _out.print(f"{record.computed} cases computed now, {before} were there")
    return record


def _use_all_cores(devices: int | None) -> None:
    """One device for each core: JAX takes the whole machine for one. To be called before JAX starts."""
    flag = "--xla_force_host_platform_device_count"
    given = os.environ.get("XLA_FLAGS", "")
    if flag not in given:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        os.environ["XLA_FLAGS"] = f"{given} {flag}={devices or cores}".strip()


@contextmanager
def _heard_interrupts() -> Iterator[list]:
    """Ctrl-C is remembered, for whoever shows progress, and raised at once where only code of this package runs.

    Raised inside a callback of JAX it would be dropped, or crash what does not expect it.
    """
    pressed = []
    here = os.path.dirname(__file__)

    def hear(signum, frame):
        pressed.append(signum)
        if frame is not None and os.path.dirname(frame.f_code.co_filename) == here:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, hear)
    try:
        yield pressed
    finally:
        signal.signal(signal.SIGINT, before)


def _keep_compiled() -> None:
    """Compiled programs are kept between runs, apart for each jaxlib, whose formats differ."""
    import jax
    import jaxlib

    if jax.config.jax_compilation_cache_dir is None:
        folder = Path.home() / ".cache" / "jaxves" / f"jaxlib-{jaxlib.__version__}"
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)


def _summarise(record: Record | SweepRecord, path: Path) -> None:
    told = sweepsummary.summary if isinstance(record, SweepRecord) else summary
    for part in told(record, path):
        _out.print(part, markup=False)


def _loaded(path: Path) -> Record | SweepRecord:
    try:
        return sweepstore.load(path) if sweepstore.is_sweep(path) else store.load(path)
    except StoreError as error:
        raise _refuse(error) from None


@app.command()
def show(file: Annotated[Path, typer.Argument(help="A result file.")]) -> None:
    """Summarise a result in a few lines."""
    _summarise(_loaded(file), file)


class Picture(enum.StrEnum):
    """What can be drawn of a result."""

    snapshots = "snapshots"
    history = "history"
    streamlines = "streamlines"
    field_lines = "field-lines"
    animation = "animation"
    phases = "phases"
    map = "map"
    curves = "curves"


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
    record = _loaded(file)
    if isinstance(record, SweepRecord):
        return _plot_sweep(record, file, what, quantity, out or file.with_suffix(""), force)
    if unsuited := _SWEPT & set(what or ()):
        raise _refuse(f"--what = {min(unsuited)}, expected another picture: {file} is not the file of a sweep.")
    if len(record.t) == 0:
        raise _refuse(f"{file} holds no saved time: there is nothing to draw.")
    at = float(record.t[-1]) if at is None else at
    if not record.t[0] <= at <= record.t[-1]:
        raise _refuse(f"--at = {at}, expected a time in [{record.t[0]:.6g}, {record.t[-1]:.6g}].")
    pictures = what or [Picture.snapshots, Picture.history]
    if Picture.field_lines in pictures and record.V_m is None:
        raise _refuse(f"--what = field-lines, expected another picture: {file} holds no field.")
    stem = out or file.with_suffix("")
    targets = {
        picture: stem.with_name(f"{stem.name}-{picture}.{'gif' if picture == Picture.animation else 'png'}")
        for picture in pictures
    }
    _refuse_existing(list(targets.values()), force)
    for picture, target in targets.items():
        _draw(record, picture, at, target)
        _out.print(f"drew {target}", markup=False)


_SWEPT = {Picture.phases, Picture.map, Picture.curves}


def _plot_sweep(
    record: SweepRecord, file: Path, what: list[Picture] | None, quantity: str | None, stem: Path, force: bool
) -> None:
    for picture in what or ():
        if picture not in _SWEPT:
            raise _refuse(f"--what = {picture}, expected phases, map or curves: {file} is the file of a sweep.")
    if what is None:
        if len(record.coordinates) == 1:
            what = [Picture.curves]
        else:
            what = [Picture.phases] if record.classes is not None and quantity is None else [Picture.map]
    from . import sweepplot

    names = {picture: f"{quantity}-" if quantity and picture != Picture.phases else "" for picture in what}
    targets = {picture: stem.with_name(f"{stem.name}-{names[picture]}{picture}.png") for picture in what}
    _refuse_existing(list(targets.values()), force)
    draws = {
        Picture.phases: lambda: sweepplot.phase_diagram(record),
        Picture.map: lambda: sweepplot.quantity_map(record, quantity),
        Picture.curves: lambda: sweepplot.curves(record, quantity),
    }
    for picture, target in targets.items():
        try:
            figure = draws[picture]()
        except ValueError as error:
            raise _refuse(error) from None
        figure.savefig(target)
        _out.print(f"drew {target}", markup=False)


def _draw(record: Record, picture: Picture, at: float, target: Path) -> None:
    from . import plot as plotting

    match picture:
        case Picture.animation:
            plotting.animation(record, target)
        case Picture.snapshots:
            plotting.snapshots(record).savefig(target)
        case Picture.history:
            plotting.history(record).savefig(target)
        case _:
            from .problem import reconstructed

            lines = plotting.field_lines if picture == Picture.field_lines else plotting.streamlines
            lines(*reconstructed(record, at)).savefig(target)


@app.command("check-grad")
def check_grad(
    scene: Annotated[str, typer.Argument(help="A scene file (TOML), or the name of a built-in scene.")],
    t_end: Annotated[float, typer.Option("--t-end", help="Where diagnostics are taken, in t_κ.")] = 0.02,
    steps: Annotated[int, typer.Option("--steps", min=1, help="Fixed steps until then.")] = 20,
) -> None:
    """Compare derivatives in all numbers of a scene: forward, reverse, differences. Exit status 3 if they disagree."""
    try:
        scene_file = load(scene)
    except SceneError as error:
        raise _refuse(error) from None
    if not (math.isfinite(t_end) and t_end > 0):
        raise _refuse(f"--t-end = {t_end}, expected a positive finite number.")
    _keep_compiled()
    from . import gradcheck

    with _err.status("running") as said:
        try:
            rows = list(gradcheck.check(scene_file, t_end, steps, progress=said.update))
        except gradcheck.BrokenDown as word:
            _say(f"the run to be differentiated ends as {word}: give it more nodes, more --steps or a smaller --t-end.")
            raise typer.Exit(BROKE_DOWN) from None
    for part in derivatives(rows):
        _out.print(part)
    if any(row.verdict == "DISAGREE" for row in rows):
        raise typer.Exit(BROKE_DOWN)


@app.command()
def scenes() -> None:
    """List the built-in scenes."""
    for name, text in builtin_names().items():
        _out.print(f"{name:15} {text}", markup=False)


@app.command()
def init(
    file: Annotated[Path, typer.Argument(help="The scene file to write.")] = Path("scene.toml"), force: Force = False
) -> None:
    """Write a commented scene file to start from."""
    _refuse_existing([file], force)
    file.write_text(TEMPLATE, encoding="utf-8")
    _out.print(f"wrote {file}; simulate it with: jaxves run {file} --out {file.with_suffix('.h5')}", markup=False)


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
) -> None:
    """Convert laboratory quantities to dimensionless numbers and to tables of a scene file."""
    quantities = dict(
        a=a, E=E, sigma_i=sigma_i, sigma_e=sigma_e, epsilon=epsilon, C_m=C_m, kappa_B=kappa_B, mu=mu, G_m=G_m,
        shear_rate=shear_rate,
    )  # fmt: skip
    for name, value in quantities.items():
        may_vanish = name in ("E", "sigma_i", "G_m", "shear_rate")
        if not math.isfinite(value) or (value < 0 and name != "shear_rate") or (value == 0 and not may_vanish):
            wanted = "a finite number" if name == "shear_rate" else f"a finite number {'>=' if may_vanish else '>'} 0"
            raise _refuse(f"--{name.replace('_', '-')} = {value}, expected {wanted}.")
    from .conversion import conversion
    from .units import Physical

    for part in conversion(Physical(**quantities)):
        _out.print(part, markup=False)
