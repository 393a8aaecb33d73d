"""Chooses the figures that `jaxves plot` draws, and the names of their files."""

import enum
from pathlib import Path

from ..results.run_store import Record
from ..results.sweep_store import SweepRecord
from . import console


class Picture(enum.StrEnum):
    """The figures that can be drawn of a result."""

    snapshots = "snapshots"
    history = "history"
    streamlines = "streamlines"
    field_lines = "field-lines"
    animation = "animation"
    phases = "phases"
    map = "map"
    curves = "curves"


_LINES = {Picture.streamlines, Picture.field_lines}
_SWEPT = {Picture.phases, Picture.map, Picture.curves}


def of_sweep(
    record: SweepRecord, file: Path, what: list[Picture] | None, quantity: str | None, stem: Path, force: bool
) -> None:
    """Draws phase diagrams, maps and curves of a sweep. The default depends on the number of axes."""
    for picture in what or ():
        if picture not in _SWEPT:
            raise console.refused(f"--what = {picture}, expected phases, map or curves: {file} is the file of a sweep.")
    if what is None:
        if len(record.coordinates) == 1:
            what = [Picture.curves]
        else:
            what = [Picture.phases] if record.classes is not None and quantity is None else [Picture.map]
    from ..plots import sweep_plots

    names = {picture: f"{quantity}-" if quantity and picture != Picture.phases else "" for picture in what}
    targets = {picture: stem.with_name(f"{stem.name}-{names[picture]}{picture}.png") for picture in what}
    console.refuse_existing(list(targets.values()), force)
    draws = {
        Picture.phases: lambda: sweep_plots.phase_diagram(record),
        Picture.map: lambda: sweep_plots.quantity_map(record, quantity),
        Picture.curves: lambda: sweep_plots.curves(record, quantity),
    }
    for picture, target in targets.items():
        try:
            figure = draws[picture]()
        except ValueError as error:
            raise console.refused(error) from None
        figure.savefig(target)
        console.out.print(f"drew {target}", markup=False)


def of_run(record: Record, file: Path, what: list[Picture] | None, at: float | None, stem: Path, force: bool) -> None:
    """Draws figures of a run: by default snapshots and history. `at` is the time of lines, by default the last."""
    if unsuited := _SWEPT & set(what or ()):
        raise console.refused(f"--what = {min(unsuited)}, expected another picture: {file} is not the file of a sweep.")
    if len(record.t) == 0:
        raise console.refused(f"{file} holds no saved time: there is nothing to draw.")
    at = float(record.t[-1]) if at is None else at
    if not record.t[0] <= at <= record.t[-1]:
        raise console.refused(f"--at = {at}, expected a time in [{record.t[0]:.6g}, {record.t[-1]:.6g}].")
    pictures = what or [Picture.snapshots, Picture.history]
    if needing := _LINES & set(pictures) if record.attributes.get("made_in") == "Python" else None:
        raise console.refused(
            f"{file} was written by `Result.save` in Python and has no scene, which {min(needing)} need: "
            f'call `result.plot("{min(needing)}", t=...)` in Python.'
        )
    if Picture.field_lines in pictures and record.V_m is None:
        raise console.refused(f"--what = field-lines, expected another picture: {file} holds no field.")
    targets = {
        picture: stem.with_name(f"{stem.name}-{picture}.{'gif' if picture == Picture.animation else 'png'}")
        for picture in pictures
    }
    console.refuse_existing(list(targets.values()), force)
    for picture, target in targets.items():
        _draw(record, picture, at, target)
        console.out.print(f"drew {target}", markup=False)


def _draw(record: Record, picture: Picture, at: float, target: Path) -> None:
    from .. import plots as plotting

    match picture:
        case Picture.animation:
            plotting.animation(record, target)
        case Picture.snapshots:
            plotting.snapshots(record).savefig(target)
        case Picture.history:
            plotting.history(record).savefig(target)
        case _:
            console.start_jax()
            from ..runs.problem import reconstructed

            lines = plotting.field_lines if picture == Picture.field_lines else plotting.streamlines
            lines(*reconstructed(record, at)).savefig(target)
