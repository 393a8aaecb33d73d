"""Commands: run, show, plot, scenes. Exit status 0 done, 2 bad input, 3 broke down, 130 interrupted.

Nothing here computes; modules that import JAX are imported inside the commands that need them.
"""

import enum
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from . import __version__
from .scenefile import SceneError, builtin_names, load
from .store import Record, StoreError
from .store import load as load_record

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Vesicles in two-dimensional Stokes flow under electric fields. Start with: jaxves run pop --out pop.h5",
)
_out = Console(highlight=False, soft_wrap=True)
_err = Console(stderr=True, highlight=False, soft_wrap=True)

BAD_INPUT, BROKE_DOWN, INTERRUPTED = 2, 3, 130


def _refuse(message: object) -> typer.Exit:
    _err.print(f"jaxves: {message}", markup=False)
    return typer.Exit(BAD_INPUT)


def _version(wanted: bool) -> None:
    if wanted:
        _out.print(__version__)
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which.")] = False,
) -> None:
    pass


def _keep_compiled() -> None:
    """Compiled programs are kept between runs, apart for each jaxlib, whose formats differ."""
    import jax
    import jaxlib

    if jax.config.jax_compilation_cache_dir is None:
        folder = Path.home() / ".cache" / "jaxves" / f"jaxlib-{jaxlib.__version__}"
        jax.config.update("jax_compilation_cache_dir", str(folder))


@app.command()
def run(
    scene: Annotated[str, typer.Argument(help="A scene file (TOML), or the name of a built-in scene.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The result file (HDF5).")],
    force: Annotated[bool, typer.Option("--force", help="Replace an existing result file.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on where the result file ends.")] = False,
    plot: Annotated[bool, typer.Option("--plot", help="Draw snapshots and histories next to the result.")] = False,
) -> None:
    """Simulate a scene."""
    try:
        scene_file = load(scene)
    except SceneError as error:
        raise _refuse(error) from None
    if force and resume:
        raise _refuse("--force replaces the result file and --resume continues it: give one of them.")
    if resume and not out.exists():
        raise _refuse(f"{out} does not exist: there is nothing to resume.")
    if not resume and out.exists() and not force:
        raise _refuse(f"{out} exists already: use --force to replace it or --resume to continue it.")
    if not out.parent.is_dir():
        raise _refuse(f"{out.parent} is not a folder: --out must name a file in an existing one.")

    columns = (
        TextColumn("t = {task.completed:.3g} / {task.total:.3g}"),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=_err, transient=True) as bar:
        task = bar.add_task("starting", total=scene_file.t_end)
        _keep_compiled()
        from . import runner

        try:
            word = runner.run(
                scene_file,
                out,
                force=force,
                resume=resume,
                progress=lambda t, text: bar.update(task, completed=t, description=text),
            )
        except StoreError as error:
            raise _refuse(error) from None
        except RuntimeError as error:
            _err.print(f"jaxves: {error}", markup=False)
            raise typer.Exit(BROKE_DOWN) from None
    record = load_record(out)
    _summarise(record, out)
    if plot:
        _draw(record, out, [Picture.snapshots, Picture.history], out.with_suffix(""))
    from . import status

    if word == "interrupted":
        raise typer.Exit(INTERRUPTED)
    if word not in status.SUCCESS:
        raise typer.Exit(BROKE_DOWN)


def _summarise(record: Record, path: Path) -> None:
    advice = record.attributes.get("advice", "")
    wall = record.attributes.get("wall_time", 0.0)
    _out.print(f"{path}: {record.status} at t = {record.t[-1]:.6g} after {wall:.1f} s" + (f". {advice}" if advice else ""))
    M, N = record.x.shape[1:3]
    _out.print(f"{M} vesicle{'s' * (M > 1)}, {N} nodes each, {len(record.t)} saved times")
    found = record.diagnostics
    if "deformation_along_field" in found:
        from . import phases

        codes = phases.classify(found["deformation_along_field"])
        _out.print("class: " + ", ".join(phases.NAMES[int(code)] for code in codes))
    table = Table("quantity", "first", "last", "least", "greatest", box=None, padding=(0, 2, 0, 0))
    names = ("deformation", "inclination_unwrapped", "tank_treading_speed", "max_V_m", "tension_min", "tension_max",
             "bending_energy", "effective_viscosity")  # fmt: skip
    for name in names:
        if name in found:
            for label, values in _components(name, found[name]):
                cells = (values[0], values[-1], values.min(), values.max())
                table.add_row(label, *(f"{value:.6g}" for value in cells))
    _out.print(table)
    quality = {
        "area drift": abs(found["area"] / found["area"][0] - 1).max(),
        "perimeter drift": abs(found["length"] / found["length"][0] - 1).max(),
        "spectral tail": found["spectral_tail"].max(),
        "energy balance": abs(found["power_balance"]).max() / max(abs(found["dissipation"]).max(), 1e-300),
        "solver residual": found["residual"].max(),
    }
    _out.print("quality: " + ", ".join(f"{name} {value:.1e}" for name, value in quality.items()))
    for name, value in (record.averages or {}).items():
        _out.print(f"average {name}: {value.tolist()}")


def _components(name: str, values):
    if values.ndim == 1 or values.shape[1] == 1:
        return [(name, values.reshape(-1))]
    return [(f"{name} [{m}]", values[:, m]) for m in range(values.shape[1])]


def _loaded(path: Path) -> Record:
    try:
        return load_record(path)
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


@app.command()
def plot(
    file: Annotated[Path, typer.Argument(help="A result file.")],
    what: Annotated[list[Picture] | None, typer.Option("--what", "-w", help="Default: snapshots, history.")] = None,
    at: Annotated[float | None, typer.Option("--at", help="Time of lines; default: the end.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Stem of the picture files.")] = None,
) -> None:
    """Draw a result: FILE-snapshots.png and so on."""
    record = _loaded(file)
    _draw(record, file, what or [Picture.snapshots, Picture.history], out or file.with_suffix(""), at)


def _draw(record: Record, source: Path, pictures: list[Picture], stem: Path, at: float | None = None) -> None:
    from . import plot as plotting

    for picture in pictures:
        target = stem.parent / f"{stem.name}-{picture}.{'gif' if picture == Picture.animation else 'png'}"
        if picture == Picture.animation:
            plotting.animation(record, target)
        elif picture == Picture.snapshots:
            plotting.snapshots(record).savefig(target)
        elif picture == Picture.history:
            plotting.history(record).savefig(target)
        else:
            _lines(plotting, record, picture, at, source).savefig(target)
        _out.print(f"drew {target}")


def _lines(plotting, record: Record, picture: Picture, at: float | None, source: Path):
    from .runner import reconstructed

    if picture == Picture.field_lines and record.V_m is None:
        raise _refuse(f"{source} holds no field: field-lines cannot be drawn.")
    equation, t, y = reconstructed(record, float(record.t[-1]) if at is None else at)
    return (plotting.field_lines if picture == Picture.field_lines else plotting.streamlines)(equation, t, y)


@app.command()
def scenes() -> None:
    """List the built-in scenes."""
    for name, text in builtin_names().items():
        _out.print(f"{name:15} {text}", markup=False)


if __name__ == "__main__":
    sys.exit(app())
