"""Running experiments by name: at toy size in processes side by side, or in full one after the other."""

import contextlib
import importlib
import io
import os
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import NamedTuple


class Outcome(NamedTuple):
    """How one experiment ended: "done", "no QUICK" or the error; seconds."""

    name: str
    word: str
    seconds: float


def run_quickly(name: str) -> Outcome:
    """`run(**QUICK)` of one experiment; what it prints is dropped."""
    import jax

    start = time.perf_counter()
    word = "done"
    try:
        module = importlib.import_module(f"experiments.{name}")
        if hasattr(module, "QUICK"):
            with contextlib.redirect_stdout(io.StringIO()):
                module.run(**module.QUICK)
        else:
            word = "no QUICK"
    except Exception as error:  # whatever one of them does, the others run
        traceback.print_exc()
        word = f"{type(error).__name__}: {error}".partition("\n")[0]
    jax.clear_caches()
    return Outcome(name, word, time.perf_counter() - start)


def run_fully(name: str) -> Outcome:
    """`main()` of one experiment, in a process of its own."""
    start = time.perf_counter()
    ended = subprocess.run([sys.executable, "-m", f"experiments.{name}"], check=False)
    word = "done" if ended.returncode == 0 else f"exit status {ended.returncode}"
    return Outcome(name, word, time.perf_counter() - start)


def outcomes(chosen: list[str], quick: bool) -> Iterator[Outcome]:
    """One after the other as they end: in full each on all cores, at toy size side by side, since most is compiling."""
    if not quick:
        yield from map(run_fully, chosen)
        return
    # Spawned processes do not import the `__main__` of a package: what they call stands in this module. Many programs
    # in one process would fill its memory.
    workers = min(len(chosen), os.cpu_count())
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn"), max_tasks_per_child=8) as pool:
        for ended in as_completed([pool.submit(run_quickly, name) for name in chosen]):
            yield ended.result()
