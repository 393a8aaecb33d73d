"""How far a long call has come: one type of callback for runs, sweeps, fits and searches; no JAX.

`progress=print` shows each call as a line.
"""

from collections.abc import Callable

Progress = Callable[[float, float, str], None]  # what is done, what is to be done in total, a text
Told = Callable[[float, str], None]  # the same inside of a run, whose total is known: time reached, a text


def silent(done: float | int, total: float | int, text: str) -> None:
    """Shows nothing."""
