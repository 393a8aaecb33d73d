"""Compares time series of another code with a benchmark. Needs Python and NumPy, but not jaxves.

    python benchmarks/check.py pop mine.csv

The file has a line of column names and a line of numbers for each saved time, separated by commas. Lines that begin
with # are skipped. `t` is needed, and as many other columns of the benchmark as there are; others are ignored. Times
may be a part of those of the benchmark. Inclinations are compared modulo π.

For each column it prints the largest difference, relative to the largest value of the column, and the number of digits
in which both agree, beside the digits to which the benchmark is known. The exit status is 0 if all columns agree to
`--digits` (3 by default), or to the known digits if these are fewer. It is 1 if not, and 2 for a file that cannot be
compared.
"""

import argparse
import csv
import sys
from pathlib import Path

import numpy as np

_HERE = Path(__file__).parent
_SAME = 1e-9  # difference of two equal times


def read(path: Path) -> tuple[dict[str, np.ndarray], list[str]]:
    """Returns the columns of a file by name, and its lines of comment.

    Raises:
        ValueError: the file has no table of numbers.
    """
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    rows = [row for row in csv.reader(line for line in lines if not line.startswith("#")) if row]
    if len(rows) < 2 or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError(f"{path}, expected a line of names and lines of as many numbers")
    try:
        table = np.array(rows[1:], dtype=float)
    except ValueError as error:
        raise ValueError(f"{path}: {error}, expected numbers") from None
    return dict(zip([name.strip() for name in rows[0]], table.T, strict=True)), comments


def known_digits(comments: list[str]) -> dict[str, int]:
    """Returns the digits to which the columns of a benchmark are known, from the last comment of its file."""
    items = comments[-1].partition(": ")[2].split(", ")
    return {name: int(digits) for name, digits in (item.split() for item in items)}


def compared(mine: dict[str, np.ndarray], benchmark: dict[str, np.ndarray]) -> dict[str, float]:
    """Returns the largest relative difference of each column that both have.

    Raises:
        ValueError: there is no common column, a time is not one of the benchmark, or a number is not finite.
    """
    names = [name for name in benchmark if name in mine and name != "t"]
    if "t" not in mine or not names:
        raise ValueError(f"columns {', '.join(mine)}, expected t and some of {', '.join(benchmark)}")
    nearest = np.argmin(np.abs(mine["t"][:, None] - benchmark["t"]), axis=1)
    off = np.abs(mine["t"] - benchmark["t"][nearest])
    if not np.all(off <= _SAME * benchmark["t"][-1]):
        worst = int(np.argmax(off))
        raise ValueError(f"t = {mine['t'][worst]:g}, expected times of the benchmark: {benchmark['t'][0]:g}, ...")
    found = {}
    for name in names:
        if not np.all(np.isfinite(mine[name])):
            raise ValueError(f"{name} has values that are not finite, expected numbers")
        difference = mine[name] - benchmark[name][nearest]
        if name.startswith("inclination"):
            difference = (difference + np.pi / 2) % np.pi - np.pi / 2
        found[name] = float(np.max(np.abs(difference)) / np.max(np.abs(benchmark[name])))
    return found


def main(arguments: list[str] | None = None) -> int:
    """Prints the table, and returns the exit status."""
    scenes = sorted(path.stem for path in _HERE.glob("*.csv"))
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", choices=scenes)
    parser.add_argument("file", type=Path)
    parser.add_argument("--digits", type=int, default=3)
    options = parser.parse_args(arguments)
    try:
        benchmark, comments = read(_HERE / f"{options.scene}.csv")
        mine, _ = read(options.file)
        found = compared(mine, benchmark)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        print(f"check: {error}", file=sys.stderr)
        return 2
    known, agree = known_digits(comments), True
    print(f"{len(mine['t'])} of {len(benchmark['t'])} times")
    print(f"{'column':28} {'difference':>10} {'digits':>6} {'known':>6}")
    for name, difference in found.items():
        digits = max(0, int(np.floor(-np.log10(max(difference, 1e-16)))))
        agrees = digits >= min(options.digits, known[name])
        agree = agree and agrees
        print(f"{name:28} {difference:10.1e} {digits:6d} {known[name]:6d}" + ("" if agrees else "  differs"))
    missing = [name for name in benchmark if name not in mine]
    if missing:
        print(f"not compared: {', '.join(missing)}")
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
