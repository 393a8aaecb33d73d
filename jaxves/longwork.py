"""Runs and sweeps from the command line: their progress, Ctrl-C, compiled programs that are kept, all cores in use.

Modules that import JAX are imported only in here, once the input has been checked.
"""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from . import sweepstore
from .console import BROKE_DOWN, err, out, refused, say
from .ownership import LostFile
from .scenefile import SceneError, SceneFile
from .store import StoreError
from .sweepstore import SweepRecord


def simulate(scene_file: SceneFile, file: Path, force: bool, resume: bool) -> str:
    """Runs a scene into the result file; returns the word it ended with."""
    columns = (
        TextColumn("t = {task.completed:.3g} / {task.total:.3g}"),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=err, transient=True) as bar, _heard_interrupts() as pressed:
        task = bar.add_task("starting", total=scene_file.t_end)

        def show(t: float, text: str) -> None:
            if pressed:
                raise KeyboardInterrupt
            bar.update(task, completed=t, description=text)

        keep_compiled()
        from . import runner

        try:
            return runner.run(scene_file, file, force=force, resume=resume, progress=show)
        except (runner.Broken, LostFile) as error:
            say(error)
            raise typer.Exit(BROKE_DOWN) from None
        except StoreError as error:
            raise refused(error) from None


def sweep(file: Path, results: Path, **how) -> SweepRecord | None:
    """Computes a sweep file into the file of results; returns the record, on the first of several processes."""
    from . import sweeping, team

    columns = (
        TextColumn("{task.completed} of {task.total} {task.description}"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    bars = Progress(*columns, console=err, transient=True, disable=not team.is_first(), speed_estimate_period=600)
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
            record = sweeping.sweep(file, results, progress=show, **how)
        except LostFile as error:
            say(error)
            raise typer.Exit(BROKE_DOWN) from None
        except (SceneError, StoreError) as error:
            raise refused(error) from None
    if not team.is_first():
        return None
    before = sweepstore.count_computed(record.status) - record.computed
    out.print(f"{record.computed} cases computed now, {before} were there")
    return record


def use_all_cores(devices: int | None) -> None:
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


def keep_compiled() -> None:
    """Compiled programs are kept between runs, apart for each jaxlib, whose formats differ."""
    import jax
    import jaxlib

    if jax.config.jax_compilation_cache_dir is None:
        folder = Path.home() / ".cache" / "jaxves" / f"jaxlib-{jaxlib.__version__}"
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
