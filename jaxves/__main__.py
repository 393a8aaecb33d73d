"""The entry point of the command line. Wrong input is refused in one line, before slow imports."""

import os
import signal
import sys


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the `jaxves` command; ends with its exit status."""
    # Small LAPACK calls are slower on two threads than on one; must be set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Before a run begins there is nothing to keep, and interrupting the import of an extension may crash.
    for signum in (signal.SIGINT, signal.SIGTERM):
        signal.signal(signum, lambda signum, frame: os._exit(128 + signum))
    from .base.compiling import use_flags

    use_flags()
    from .cli.commands import answer
    from .cli.console import INTERRUPTED, TERMINATED, write_in_any_encoding

    write_in_any_encoding()
    status = answer(sys.argv[1:] if arguments is None else arguments)
    if status in (INTERRUPTED, TERMINATED):
        # Compiled code may still be running. It would crash during a normal exit of Python.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    main()
