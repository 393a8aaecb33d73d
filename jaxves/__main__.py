"""The command line. It answers bad input before anything slow is imported, and in one line."""

import os
import signal
import sys


def main(arguments: list[str] | None = None) -> None:
    """Entry point of the `jaxves` command; ends with its exit status."""
    # Small LAPACK calls are slower on two threads than on one; must be set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Until a run has begun there is nothing to keep, and half imported extensions may crash when they are left.
    for signum in (signal.SIGINT, signal.SIGTERM):
        signal.signal(signum, lambda signum, frame: os._exit(128 + signum))
    from .cli.commands import answer
    from .cli.console import INTERRUPTED, TERMINATED, write_in_any_encoding

    write_in_any_encoding()
    status = answer(sys.argv[1:] if arguments is None else arguments)
    if status in (INTERRUPTED, TERMINATED):
        # Compiled code may still be running, which an orderly end of Python would crash.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    sys.exit(status)


if __name__ == "__main__":
    main()
