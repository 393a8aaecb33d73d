"""Messages and exit statuses of all commands.

Exit status: 0 done, 2 wrong input, 3 broke down, 130 interrupted by Ctrl-C or --max-time, 143 by SIGTERM.
"""

import io
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import typer
from rich.console import Console

from ..base.compiling import fast_start
from ..geometry.outlines import OutlineNoise
from ..results.hdf5 import StoreError, refuse_special

BAD_INPUT, BROKE_DOWN, INTERRUPTED, TERMINATED = 2, 3, 130, 143


class _Console(Console):
    """A console that ignores a closed pipe, as after `| head`; the exit status stays that of the work."""

    def on_broken_pipe(self) -> None:
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


out = _Console(highlight=False, soft_wrap=True)
err = _Console(stderr=True, highlight=False, soft_wrap=True)


def write_in_any_encoding() -> None:
    """Makes standard output replace characters that its encoding does not have, instead of raising an error.

    Standard error does this by default.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


def say(message: object) -> None:
    """Prints a message as one line on standard error."""
    err.print(f"jaxves: {' '.join(str(message).split())}", markup=False)


def refused(message: object) -> typer.Exit:
    """Prints what is wrong with the input; returns the exception to raise."""
    say(message)
    return typer.Exit(BAD_INPUT)


def wrote_scene(path: Path) -> None:
    """Tells that a scene file was written, and the command that simulates it."""
    out.print(f"wrote {path}; simulate it with: jaxves run {path} --out {path.with_suffix('.h5')}", markup=False)


def start_jax() -> None:
    """Refuses single precision before anything is computed; then keeps compiled programs (`fast_start`)."""
    import jax

    if not jax.config.jax_enable_x64:
        given = os.environ.get("JAX_ENABLE_X64")
        raise refused(f"JAX_ENABLE_X64 = {given}, expected 1, or no such variable: jaxves needs double precision.")
    fast_start()


def refuse_existing(paths: list[Path], force: bool, remedy: str = "use --force to replace it") -> None:
    """Refuses files that exist already or cannot be written, before slow work begins."""
    for path in paths:
        try:
            refuse_special(path)
        except StoreError as error:
            raise refused(error) from None
        if path.exists() and not force:
            raise refused(f"{path} exists already: {remedy}.")
        if not (path.parent.is_dir() and os.access(path.parent, os.W_OK)):
            raise refused(f"{path.parent} is not a folder that can be written to.")


@contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Shows each warning of this package as one line."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", OutlineNoise)
        others = warnings.showwarning

        def show(message, category, *where, **more):
            if issubclass(category, OutlineNoise):
                say(f"warning: {message}")
            else:
                others(message, category, *where, **more)

        warnings.showwarning = show
        yield
