"""Interrupts of long work: by Ctrl-C, by a request to terminate (SIGTERM), or by a time limit.

Each of them raises KeyboardInterrupt in the code of this package, and the work then keeps its results. Python handles
signals only between its own instructions. If JAX is compiling a program, the compilation is finished first.

SIGHUP ends the process, as usual. A result file survives this (`results/run_writer.py`).
"""

import _thread
import os
import re
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from .console import say

_BEGAN = time.monotonic()  # approximate start of the command
_RESERVE = 60.0  # the work is interrupted at most so many seconds before the time limit
_SHARE = 0.1  # and at most this fraction of the limit before it
_GRACE = 1.0  # seconds for the interrupt if the limit has passed already
_UNITS = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86400}
WANTED = "a positive time: seconds as 5400, a number with a unit as 90m or 1.5h, or a clock as 1:30:00 or 2-12:00:00"


class Interrupts:
    """The signals that arrived, in order, whether they interrupted the work, and whether its time limit was reached."""

    def __init__(self):
        self.signals: list[int] = []
        self.time_is_up = False
        self.has_interrupted = False

    def check(self) -> None:
        """Raises KeyboardInterrupt if a signal arrived where it could not be raised."""
        if self.signals:
            self.interrupt()

    def interrupt(self) -> None:
        """Raises KeyboardInterrupt."""
        self.has_interrupted = True
        raise KeyboardInterrupt

    @property
    def exit_status(self) -> int:
        """128 plus the number of the first signal, as in shells. The time limit counts as Ctrl-C."""
        return 128 + (self.signals[0] if self.signals else signal.SIGINT)


def seconds(text: str) -> float:
    """Converts a duration to seconds.

    The text is a number of seconds, a number with s, m, h or d, or [[days-]hours:]minutes:seconds.

    Raises:
        ValueError: it is none of these, or not positive.
    """
    if clock := re.fullmatch(r"(?a:(?:(?:(\d+)-)?(\d+):)?(\d+):(\d+))", text):
        days, hours, minutes, rest = (int(part or 0) for part in clock.groups())
        found = float(((days * 24 + hours) * 60 + minutes) * 60 + rest)
    elif number := re.fullmatch(r"(?a:(\d+\.?\d*|\.\d+)([smhd]?))", text):
        found = float(number[1]) * _UNITS[number[2]]
    else:
        raise ValueError(text)
    if not found > 0:
        raise ValueError(text)
    return found


@contextmanager
def heard(limit: float | None = None) -> Iterator[Interrupts]:
    """Interrupts the work inside this context, at the latest shortly before `limit` seconds since the command started.

    KeyboardInterrupt is raised only in code of this package that does not write files. Inside a callback of JAX it
    would be ignored or crash. Inside the writing of a file it would leave the end of the work unrecorded. In these
    cases the signal is stored, and `Interrupts.check` raises. Later signals are counted but do not interrupt again.
    """
    found = Interrupts()
    package = os.path.dirname(os.path.dirname(__file__)) + os.sep
    files = os.path.join(package, "results", "")

    def hear(signum, frame):
        found.signals.append(signum)
        name = "" if frame is None else frame.f_code.co_filename
        if len(found.signals) == 1 and name.startswith(package) and not name.startswith(files):
            found.interrupt()

    before = {signum: signal.signal(signum, hear) for signum in (signal.SIGINT, signal.SIGTERM)}
    timers = [] if limit is None else _timers(limit, found)
    try:
        yield found
    finally:
        for timer in timers:
            timer.cancel()
        for signum, handler in before.items():
            signal.signal(signum, handler)


def _timers(limit: float, found: Interrupts) -> list[threading.Timer]:
    """Returns timers: one interrupts the work before the limit, one ends the process at the limit if that failed."""

    def interrupt():
        found.time_is_up = True
        _thread.interrupt_main()

    def end():
        if not found.has_interrupted:
            say("stopped by --max-time while a program was compiled; what was written before is kept.")
            os._exit(found.exit_status)

    left = limit - (time.monotonic() - _BEGAN)
    timers = [
        threading.Timer(max(left - min(_RESERVE, _SHARE * limit), 0.0), interrupt),
        threading.Timer(max(left, _GRACE), end),
    ]
    for timer in timers:
        timer.daemon = True
        timer.start()
    return timers
