"""Runs experiments by name, each in its own process: at toy size several at a time, in full one after the other.

    python -m experiments._running NAME          # runs one at toy size; the parent process calls this

A crash, or memory that is not freed, then affects only that experiment.
"""

import contextlib
import importlib
import io
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import NamedTuple

from ._compiling import QUICKLY

_NO_QUICK = 3  # exit status
# Toys spend their time in compiling, and some programs they have in common.
_COMPILING = {"XLA_FLAGS": QUICKLY, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "1"}


class Outcome(NamedTuple):
    """The end of one experiment: "done", "no QUICK" or the error, and the seconds."""

    name: str
    word: str
    seconds: float


def run_quickly(name: str, compiled: str) -> Outcome:
    """Runs `run(**QUICK)` of one experiment; compiled programs are kept in the folder `compiled`.

    It prints only tracebacks.
    """
    start = time.perf_counter()
    command = [sys.executable, "-m", __name__, name]
    environment = _COMPILING | {"JAX_COMPILATION_CACHE_DIR": compiled} | os.environ
    ended = subprocess.run(command, check=False, stderr=subprocess.PIPE, text=True, env=environment)
    if ended.returncode == 0:
        word = "done"
    elif ended.returncode == _NO_QUICK:
        word = "no QUICK"
    else:
        sys.stderr.write(ended.stderr)
        word = (ended.stderr.strip().splitlines() or [f"exit status {ended.returncode}"])[-1]
    return Outcome(name, word, time.perf_counter() - start)


def run_fully(name: str) -> Outcome:
    """Runs `main()` of one experiment."""
    start = time.perf_counter()
    ended = subprocess.run([sys.executable, "-m", f"experiments.{name}"], check=False)
    word = "done" if ended.returncode == 0 else f"exit status {ended.returncode}"
    return Outcome(name, word, time.perf_counter() - start)


def outcomes(chosen: list[str], quick: bool) -> Iterator[Outcome]:
    """Yields the outcomes as they end.

    In full each experiment has all cores. At toy size each has one core, because most of the time is compilation.
    """
    if not quick:
        yield from map(run_fully, chosen)
        return
    with tempfile.TemporaryDirectory() as compiled, ThreadPoolExecutor(min(len(chosen), os.cpu_count())) as pool:
        for ended in as_completed([pool.submit(run_quickly, name, compiled) for name in chosen]):
            yield ended.result()


def main() -> None:
    module = importlib.import_module(f"experiments.{sys.argv[1]}")
    if not hasattr(module, "QUICK"):
        sys.exit(_NO_QUICK)
    with contextlib.redirect_stdout(io.StringIO()):
        module.run(**module.QUICK)


if __name__ == "__main__":
    main()
