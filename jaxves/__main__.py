"""The command line. It answers bad input before anything slow is imported."""

import os


def main() -> None:
    """Entry point of the `jaxves` command."""
    # Small LAPACK calls are slower on two threads than on one; must be set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from .cli import app

    app()


if __name__ == "__main__":
    main()
