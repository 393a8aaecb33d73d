"""The text that `jaxves show` prints for a sweep: numbers of cases by status, failed cases with reasons, and results.

Nothing here imports JAX.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from ..base import status
from ..observables import classes
from ..results.ownership import writer_of
from ..results.sweep_store import DUE, SKIPPED, SweepRecord

_SHOWN = (
    "deformation_final",
    "deformation_min",
    "deformation_max",
    "inclination_average",
    "tank_treading_speed_average",
    "effective_viscosity_average",
    "effective_viscosity_tumbling",
    "half_turn",
    "inclination_final",
    "tank_treading_speed_final",
    "effective_viscosity_final",
    "max_V_m_max",
    "tension_min_min",
    "tension_max_max",
    "min_gap_min",
    "steps",
)
_LISTED = 20  # largest number of failed cases with a line each
_NAMED = 3  # largest number of cases named in one line


def summary(record: SweepRecord, path: Path) -> Iterator[RenderableType]:
    """Yields lines and tables."""
    grid = " × ".join(f"{n} {dim}" for dim, n in zip(record.dims, record.status.shape, strict=True))
    wall = record.attributes["wall_time"]
    what = f"{grid}, {record.attributes['nodes']} nodes"
    if record.attributes["status"] != "running":
        yield f"{path}: sweep {record.attributes['status']} after {wall:.1f} s; {what}"
    elif who := writer_of(path):
        yield f"{path}: sweep running so far, written by {who}; {what}"
    else:
        yield f"{path}: sweep cut off (its attribute `status` is still 'running'); {what}. Continue it with --resume."
    yield "cases: " + ", ".join(f"{count} {word}" for word, count in record.counts().items())
    for what, found in (("classes", record.classes), ("motions in shear", record.motions)):
        if found is not None:
            words, counts = np.unique(found[found != ""], return_counts=True)
            yield f"{what}: " + ", ".join(f"{count} {word}" for word, count in zip(words, counts, strict=True))
    yield from _still_changing(record)
    yield from failures(record)
    yield _quantities(record)


def _still_changing(record: SweepRecord) -> Iterator[str]:
    """Yields a line if the classes of some complete cases are not final, with the numbers of the first of them."""
    found = [_numbers(record, index) for index in map(tuple, np.argwhere(record.changing).tolist())]
    if not found:
        return
    named = "; ".join(found[:_NAMED]) + (f"; and {len(found) - _NAMED} more" if len(found) > _NAMED else "")
    verb, whose = ("is", "its class") if len(found) == 1 else ("are", "their class")
    yield (
        f"{len(found)} of the complete cases {verb} still changing at t_end ({named}): in as much time again, D would "
        f"change by more than {classes.THRESHOLD} at its last rate, and {whose} may be another one."
    )


def _numbers(record: SweepRecord, index: tuple[int, ...]) -> str:
    """Returns the numbers of one case in words."""
    return ", ".join(f"{name} = {value:.6g}" for name, value in record.at(index).items())


def failures(record: SweepRecord) -> Iterator[str]:
    """Yields a line for each failed case with its numbers and the reason, up to a limit."""
    failed = np.argwhere(~np.isin(record.status, [*status.SUCCESS, *DUE, SKIPPED]))
    for index in map(tuple, failed[:_LISTED].tolist()):
        yield f"{_numbers(record, index)}: {record.status[index]}. {record.reasons[index]}".rstrip()
    if len(failed) > _LISTED:
        yield f"and {len(failed) - _LISTED} more"


def _quantities(record: SweepRecord) -> Table:
    table = Table("quantity", "least", "greatest", box=None, padding=(0, 2, 0, 0))
    good = np.isin(record.status, list(status.SUCCESS))
    for name in _SHOWN:
        values = record.data.get(name)
        if values is None:
            continue
        found = values[good]
        found = found[np.isfinite(found)]
        if len(found):
            table.add_row(name, f"{found.min():.6g}", f"{found.max():.6g}")
    return table
