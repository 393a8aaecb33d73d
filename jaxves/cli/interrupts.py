"""How long work is interrupted: by Ctrl-C, by a request to terminate (SIGTERM), or by a limit on its time.

Each of them raises KeyboardInterrupt in the code of this package, and the work then keeps what it has. Python handles a
signal only between two of its own instructions, so a program that JAX is compiling is compiled to its end first.

SIGHUP keeps its meaning, which is the end of the process; a result file survives that (`store`).
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

_BEGAN = time.monotonic()  # about when the command started
_RESERVE = 60.0  # seconds before the limit of time at which the work is interrupted, at most
_SHARE = 0.1  # of that limit, at most
_GRACE = 1.0  # seconds to hear a limit that is over already
_UNITS = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86400}
WANTED = "a positive time: seconds as 5400, a number with a unit as 90m or 1.5h, or a clock as 1:30:00 or 2-12:00:00"


class Interrupts:
    """The signals that were heard, in order, whether they interrupted the work, and whether its limit was reached."""

    def __init__(self):
        self.signals: list[int] = []
        self.time_is_up = False
        self.has_interrupted = False

    def check(self) -> None:
        """Raises KeyboardInterrupt after a signal that could not raise it where it came."""
        if self.signals:
            self.interrupt()

    def interrupt(self) -> None:
        """Raises KeyboardInterrupt."""
        self.has_interrupted = True
        raise KeyboardInterrupt

    @property
    def exit_status(self) -> int:
        """128 and the number of the first signal, as shells have it; the limit of time counts as Ctrl-C."""
        return 128 + (self.signals[0] if self.signals else signal.SIGINT)


def seconds(text: str) -> float:
    """The seconds of a duration: a number of seconds, a number with s, m, h or d, or [[days-]hours:]minutes:seconds.

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
    """Interrupts what is done inside, at the latest shortly before `limit` seconds since the command started.

    KeyboardInterrupt is raised where code of this package runs that does not write files. Raised inside a callback of
    JAX it would be dropped, or crash what does not expect it; raised inside the writing of a file it would leave the
    end of the work unsaid. There the signal is remembered, and `Interrupts.check` raises. Signals after the first only
    count: they do not disturb the end of the work.
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
    """They interrupt the work a while before its limit, and end the process at the limit if that has had no effect."""

    def interrupt():
        found.time_is_up = True
        _thread.interrupt_main()

    def end():
        if not found.has_interrupted:
            say("stopped by --max-time while a program was compiled; what the file has is kept.")
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
