"""The text that `jaxves run` and `jaxves show` print for a run: its status, its motion, quantities, error estimates.

Nothing here imports JAX, except for the line of `--stability`.
"""

import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from ..base import status
from ..geometry.outlines import measured
from ..observables import classes, pair_classes
from ..observables.angles import only_jumps
from ..observables.certificate import Link, certificate, weakest
from ..observables.rotor import threshold_of
from ..observables.shear_motion import Motion, is_sheared, motion_of
from ..observables.wrinkles import missed_wrinkles
from ..results.ownership import writer_of
from ..results.run_store import Record
from ..results.sweep_store import SweepRecord

_ANGLE = "inclination_unwrapped"
_SHOWN = (
    "deformation",
    "deformation_period_mean",
    _ANGLE,
    "tank_treading_speed",
    "max_V_m",
    "tension_min",
    "tension_max",
    "lipid_tension_max",
    "interfacial_charge",
    "bending_energy",
    "separation",
    "line_angle",
    "min_gap",
    "film_error",
    "effective_viscosity",
)


_UNFINISHED = (status.WORDS[status.RUNNING], status.WORDS[status.INTERRUPTED])
_ROUND_OFF = 1e-10  # in units of the model, in which quantities are of the order of one; smaller ones are shown as 0
_OUTLINES = 4  # largest number of outlines with a line each


class Session(NamedTuple):
    """One call of `jaxves run`: its seconds and, if it continued a file, the saved times (T,) that were there."""

    seconds: float
    before: np.ndarray | None = None


def brief(record: Record, path: Path, session: Session) -> Iterator[RenderableType]:
    """Yields what `jaxves run` prints at its end: a few lines, and the commands that tell more."""
    yield from _ended(record, path, session)
    if len(record.t) == 0:
        return
    yield from _motion(record)
    yield from _accuracy(record, certificate(record.diagnostics, record.attributes.get("error")))
    if warning := _missed_wrinkles(record):
        yield warning
    yield f"`jaxves show {path}` prints more, `jaxves plot {path}` draws figures."


def summary(record: Record, path: Path) -> Iterator[RenderableType]:
    """Yields what `jaxves show` prints: lines and tables."""
    yield from _ended(record, path)
    if len(record.t) == 0:
        return
    links = certificate(record.diagnostics, record.attributes.get("error"))
    yield from _motion(record)
    yield from _accuracy(record, links)
    yield from _hints(record, path)
    yield _quantities(record)
    yield "errors: " + ", ".join(f"{name} {link.value:.1e}" for name, link in links.items())
    for name, value in (record.averages or {}).items():
        yield f"average {name}: {value.tolist()}"


def _hints(record: Record, path: Path) -> Iterator[str]:
    """Yields what the run cannot show, because its start is symmetric or smooth, each with what to do about it."""
    if kept := record.attributes.get("symmetry"):
        yield (
            f"kept symmetric {kept}, like its start: set `disturbance = 1e-6` of the vesicle to see whether it stays "
            f"so, or test a steady state with `jaxves show {path} --stability`"
        )
        tables = tomllib.loads(record.scene)
        threshold = threshold_of(tables)
        if threshold is not None and tables["field"]["beta"] > threshold:
            yield (
                f"β = {tables['field']['beta']:.3g} exceeds {threshold:.3g}: a round vesicle would turn by itself "
                "(Quincke rotation), which the kept symmetry excludes: set its `disturbance = 1e-6` to see it"
            )
    if warning := _missed_wrinkles(record):
        yield warning


def _ended(record: Record, path: Path, session: Session | None = None) -> Iterator[str]:
    """Yields how a run ended, its size, and where its shapes come from."""
    advice = record.attributes["advice"] or status.ADVICE.get(record.status, "")
    running = record.status == status.WORDS[status.RUNNING]
    who = None if record.is_cut_off or not running else writer_of(path)
    word = f"{record.word} (its attribute `status` is still {record.status!r})" if record.is_cut_off else record.word
    if len(record.t) == 0:
        yield f"{path}: {word}, and no saved time. {'' if who else advice}".rstrip()
        return
    if who:
        rows = f"{len(record.t)} of {record.attributes['saves']} saved times"
        yield f"{path}: running, written by {who}, at t = {record.t[-1]:.6g} so far with {rows}"
    else:
        # The time is unknown for a result that Python saved. That of a killed run ends with its last saved times.
        wall = session.seconds if session else record.attributes["wall_time"] or np.nan
        seconds = "" if np.isnan(wall) else f" after {wall:.1f} s"
        yield f"{path}: {word} at t = {record.t[-1]:.6g}{seconds}. {advice}".rstrip()
    if session and session.before is not None and len(session.before):
        yield (
            f"continued at t = {session.before[-1]:.6g} ({len(session.before)} saved times were there); "
            "the seconds are those of this call"
        )
    M = record.x.shape[1]
    nodes = " or ".join(str(N) for N in np.unique(record.nodes))
    yield f"{M} vesicle{'s' * (M > 1)} of {nodes} nodes, {len(record.t)} saved times"
    if origin := record.attributes.get("started_from"):
        yield f"started from {origin} instead of the shapes of the scene"
    else:
        yield from _outlines(tomllib.loads(record.scene))


def _outlines(tables: dict) -> Iterator[str]:
    """Yields the size and the reduced area of each outline that was given as points, before it is scaled to `length`.

    If there are many outlines, nothing is said.
    """
    given = [(m, table) for m, table in enumerate(tables.get("vesicle", ())) if table.get("shape") == "points"]
    for m, table in given if len(given) <= _OUTLINES else ():
        radius, area = measured(np.array(table["points"]), table.get("modes"))
        which = f" of vesicle[{m}]" if len(tables["vesicle"]) > 1 else ""
        yield (
            f"outline{which}: perimeter / 2π = {radius:.4g} in the units of its points, scaled to "
            f"{table.get('length', 1.0):.4g} a; reduced area {area:.3f}"
        )


def _motion(record: Record) -> Iterator[str]:
    """Yields the class of the vesicles, or of a pair, and the motion in shear; nothing after a breakdown."""
    ended = record.status in (*status.SUCCESS, status.WORDS[status.INACCURATE])
    if not ended and record.status not in _UNFINISHED:
        return
    so_far, tables = "" if ended else " so far", tomllib.loads(record.scene)
    if "deformation_along_field" in record.diagnostics:
        means = " (by means over periods)" * (classes.MEAN in record.diagnostics)
        names = ", ".join(classes.class_names(record.diagnostics))
        yield f"class{so_far}: {names}{means}{_still_changing(record)}"
    if "line_angle" in record.diagnostics and "direction" in tables.get("field", {}):
        yield f"pair{so_far}: {pair_class(record)}"
    if "vesicle" in tables and is_sheared(tables):
        yield f"motion in shear{so_far}: {motion_words(record)}"


def _still_changing(record: Record) -> str:
    """Returns a warning if the class at the end of a complete run is not final, otherwise an empty text."""
    if record.status != status.WORDS[status.COMPLETE] or len(record.t) < 2:
        return ""
    change = np.max(np.abs(classes.trend(record.diagnostics, record.t)))
    if not change > classes.THRESHOLD:
        return ""
    return f" at t_end, still changing (in as much time again, by {change:.2g} in D at its last rate)"


def _accuracy(record: Record, links: dict[str, Link]) -> Iterator[str]:
    weak = weakest(links)
    yield f"About {max(links[weak].digits, 0):.1f} correct digits; the weakest link is {weak}: {links[weak].long_name}"
    if "error" in record.attributes:
        yield _error_of_run(record)


def stability_line(record: Record | SweepRecord) -> str:
    """Returns whether small disturbances of the last state grow, which takes seconds."""
    from .stability_words import words

    return words(record)


def _missed_wrinkles(record: Record) -> str | None:
    """Returns a line if the run missed wrinkles because nothing disturbs its start; None for other starts."""
    if record.attributes.get("started_from"):
        return None
    found = record.diagnostics
    return missed_wrinkles(tomllib.loads(record.scene), record.t, found["tension_min"], found["length"])


def pair_class(record: Record) -> str:
    """Returns the class of the motion of two vesicles in a field."""
    x, y = tomllib.loads(record.scene)["field"]["direction"]
    found = record.diagnostics
    history = (found[name] for name in ("line_angle", "separation", "min_gap"))
    return pair_classes.classify(record.t, *history, float(np.arctan2(y, x)))


def motion_words(record: Record) -> str:
    """Returns the motion of each vesicle in shear, with the time of half a turn and the average of [μ] over them."""
    tables = tomllib.loads(record.scene)
    usual = tables.get("fluid", {}).get("viscosity_ratio", 1.0)
    M = record.x.shape[1]
    own = [vesicle.get("viscosity_ratio", usual) for vesicle in tables["vesicle"]]
    ratio = np.resize(own, M)  # both vesicles of a pair are the one that the scene has
    angle = record.diagnostics[_ANGLE]
    found = motion_of(record.t, angle, ratio, record.diagnostics.get("effective_viscosity"))
    return "; ".join(_motion_of_one(found, m, np.degrees(angle[-1, m])) for m in range(M))


def _motion_of_one(found: Motion, m: int, angle: float) -> str:
    name = found.names[m]
    if name == "treading":
        return f"treading at {angle:.3g} degrees"
    if name != "tumbling":
        return name
    text = f"tumbling, {found.half_turn[m]:.4g} for half a turn"
    return text if np.isnan(found.viscosity) else f"{text}, average of [μ] over whole half-turns {found.viscosity:.4g}"


def _error_of_run(record: Record) -> str:
    """Returns a line with the error of nodes and steps together, and why it is larger than the tolerance if it is."""
    error, tolerance = record.attributes["error"], tomllib.loads(record.scene)["numerics"].get("tolerance")
    if np.isnan(error):
        return "error of the whole run: not known, because the estimate was interrupted"
    if np.isinf(error):
        return "error of the whole run: not known, because runs with other nodes and steps broke down"
    text = f"error of the whole run: about {error:.1e} a in positions"
    if record.V_m is not None:
        text = f"error of the whole run: about {error:.1e}, of positions in a and of V_m in a E_inf"
    if tolerance is None or error <= 10 * tolerance:
        return text
    return (
        f"{text}. The tolerance {tolerance:g} is for one step; the errors of all steps and of the nodes add up to "
        "more. For a smaller error use more nodes or a lower tolerance"
    )


def _quantities(record: Record) -> Table:
    table = Table("quantity", "first", "last", "least", "greatest", box=None, padding=(0, 2, 0, 0))
    for name in _SHOWN:
        values = record.diagnostics.get(name)
        if values is None:
            continue
        columns = values.reshape(len(values), -1).T
        if name == _ANGLE and only_jumps(np.degrees(columns.T)):
            continue
        for m, column in enumerate(columns):
            label = name if len(columns) == 1 else f"{name}[{m}]"
            there = column[~np.isnan(column)]  # a mean over a period is not known before the first one has ended
            if not len(there):
                continue
            cells = (there[0], there[-1], there.min(), there.max())
            table.add_row(label, *("0" if abs(cell) < _ROUND_OFF else f"{cell:.6g}" for cell in cells))
    return table


def derivatives(rows: Sequence) -> Iterator[RenderableType]:
    """Yields the rows of `gradcheck.check_gradients` as a table, and a summary line."""
    columns = ("number", "diagnostic", "forward", "reverse", "differences", "modes", "deviation", "± itself", "")
    table = Table(*columns, box=None, padding=(0, 2, 0, 0))
    for row in rows:
        values = (row.forward, row.reverse, row.differences)
        cells = [*(f"{value:.8g}" for value in values), *(f"{part:.0e}" for part in row[5:8])]
        skipped = np.isnan(row.forward) and row.quantity == "all"
        table.add_row(row.number, row.quantity, *(["–"] * 6 if skipped else cells), row.verdict)
    yield table
    wrong = sum(row.verdict == "DISAGREE" for row in rows)
    agree = sum(row.verdict == "agree" for row in rows)
    yield f"{agree} of {len(rows)} agree, {wrong} disagree; deviations are relative, worst component of a diagnostic"
