"""Runs and sweeps from the command line: progress bars, exit statuses, the compilation cache, use of all cores.

Modules that import JAX are imported inside these functions, after the input has been checked.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..base import status
from ..inputs.scene_files import SceneError, SceneFile
from ..results import run_store, sweep_store
from ..results.hdf5 import StoreError
from ..results.ownership import LostFile
from ..results.sweep_store import SweepRecord
from . import interrupts
from .console import BROKE_DOWN, err, out, refused, say, start_jax
from .run_summary import Session

_BETWEEN_LINES = 60.0  # seconds between lines in a log


def simulate(scene_file: SceneFile, file: Path, limit: float | None, **how) -> tuple[int, Session]:
    """Runs a scene and writes the result file, for at most `limit` seconds; returns the exit status and the session."""
    began = time.monotonic()
    before = run_store.read_result(file).t if how.get("resume") else None
    code = _simulated(scene_file, file, limit, how)
    return code, Session(time.monotonic() - began, before)


def _simulated(scene_file: SceneFile, file: Path, limit: float | None, how: dict) -> int:
    columns = (
        TextColumn("t = {task.completed:.3g} / {task.total:.3g}"),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with (
        Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar,
        _interrupted(limit) as found,
    ):
        task = bar.add_task("starting", total=scene_file.t_end)
        say_now_and_then = _Log()

        def show(t: float, t_end: float, text: str) -> None:
            found.check()
            say_now_and_then(f"t = {t:.4g} of {t_end:.4g}, {text}")
            bar.update(task, completed=t, description=text)

        start_jax()
        from ..runs import runner

        try:
            word = runner.run(scene_file, file, progress=show, **how)
        except (runner.Broken, LostFile) as error:
            say(error)
            raise typer.Exit(BROKE_DOWN) from None
        except (SceneError, StoreError) as error:
            raise refused(error) from None
        if word == status.WORDS[status.INTERRUPTED]:
            return _told(found)
    return 0 if word in status.SUCCESS else BROKE_DOWN


def sweep(file: Path, results: Path, limit: float | None, **how) -> SweepRecord | None:
    """Computes a sweep file and writes the result file, for at most `limit` seconds.

    Returns the record in the first of several processes, and None in the others.
    """
    from ..sweeps import processes, sweeping

    columns = (
        TextColumn("{task.completed} of {task.total} {task.description}"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    bars = Progress(
        *columns,
        console=err,
        transient=True,
        disable=not (processes.is_first() and err.is_terminal),
        speed_estimate_period=600,
    )
    with bars as bar, _interrupted(limit) as found:
        task = bar.add_task("compiling", total=None, rate="")
        there, say_now_and_then = [], _Log(processes.is_first())

        def show(done: int, total: int, text: str) -> None:
            found.check()
            say_now_and_then(f"{done} of {total} {text}")
            if text != "compiling":
                there.append((time.monotonic(), done))
            (began, first), (now, _) = (there[0], there[-1]) if there else ((0, 0), (0, 0))
            rate = f"{(done - first) / (now - began):.3g}/s" if now > began else ""
            bar.update(task, completed=done, total=total, description=text, rate=rate)

        try:
            record = sweeping.sweep(file, results, progress=show, **how)
        except LostFile as error:
            say(error)
            raise typer.Exit(BROKE_DOWN) from None
        except (SceneError, StoreError) as error:
            raise refused(error) from None
    if not processes.is_first():
        return None
    before = sweep_store.count_computed(record.status) - record.computed
    out.print(f"{record.computed} cases computed now, {before} were there")
    return record


class _Log:
    """Says about once a minute how far the work is, if there is no terminal for a progress bar."""

    def __init__(self, is_first: bool = True):
        self.is_wanted, self.last = is_first and not err.is_terminal, time.monotonic()

    def __call__(self, text: str) -> None:
        if self.is_wanted and time.monotonic() - self.last >= _BETWEEN_LINES:
            self.last = time.monotonic()
            say(text)


def use_all_cores(devices: int | None) -> None:
    """Makes one device for each core; by default JAX has one for all cores. Call it before JAX starts."""
    flag = "--xla_force_host_platform_device_count"
    given = os.environ.get("XLA_FLAGS", "")
    if flag not in given:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        os.environ["XLA_FLAGS"] = f"{given} {flag}={devices or cores}".strip()


@contextmanager
def _interrupted(limit: float | None) -> Iterator[interrupts.Interrupts]:
    """Like `interrupts.heard`, and turns KeyboardInterrupt into the exit status."""
    with interrupts.heard(limit) as found:
        try:
            yield found
        except KeyboardInterrupt:
            raise typer.Exit(_told(found)) from None


def _told(found: interrupts.Interrupts) -> int:
    """Prints a line if the time limit interrupted the work; returns the exit status."""
    if found.time_is_up:
        say("interrupted before the time limit of --max-time.")
    return found.exit_status
