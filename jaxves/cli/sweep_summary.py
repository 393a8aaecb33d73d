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
_LISTED = 20


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
    if still := int(np.sum(record.changing)):
        yield (
            f"{still} of the complete cases are still changing at t_end: in as much time again, D would change by more "
            f"than {classes.THRESHOLD} at its last rate, and their class may be another one."
        )
    yield from failures(record)
    yield _quantities(record)


def failures(record: SweepRecord) -> Iterator[str]:
    """Yields a line for each failed case with its numbers and the reason, up to a limit."""
    failed = np.argwhere(~np.isin(record.status, [*status.SUCCESS, *DUE, SKIPPED]))
    for index in map(tuple, failed[:_LISTED].tolist()):
        numbers = ", ".join(f"{name} = {value:.6g}" for name, value in record.at(index).items())
        yield f"{numbers}: {record.status[index]}. {record.reasons[index]}".rstrip()
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
