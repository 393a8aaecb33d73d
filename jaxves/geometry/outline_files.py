"""Reads outlines that image programs, spreadsheets and contour tools write: one point per line, with x and y.

- `text_rows` says how lines may be written.
- An index column before x and y is allowed. The last point may repeat the first.

For everything else, the error message names the line and says what to change. Nothing here imports JAX.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .text_rows import Rows, decoded, read_rows

SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".npy")


class OutlineFile(NamedTuple):
    """The points of an outline, (K, 2), and the line number of each; None for a .npy file."""

    points: Float[np.ndarray, "K 2"]
    lines: tuple[int, ...] | None


def read_outline(path: Path) -> OutlineFile:
    """Reads the points of a file.

    Raises:
        ValueError: the file is not an outline; the message names the line and says what to change.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"the name of a {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]} file")
    kind = "a .npy file of K x 2 numbers" if path.suffix.lower() == ".npy" else "a text file of numbers"
    try:
        if path.suffix.lower() == ".npy":
            return OutlineFile(_array(np.load(path, allow_pickle=False)), None)
        text = decoded(path.read_bytes())
    except OSError as error:
        raise ValueError(f"a readable file ({error.strerror or 'not such a file'})") from None
    except (ValueError, EOFError) as error:
        raise ValueError(f"{kind} ({' '.join(str(error).split())})") from None
    table = read_rows(text)
    return OutlineFile(_coordinates(table), table.lines)


def _array(points: np.ndarray) -> Float[np.ndarray, "K 2"]:
    if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in "iuf":
        raise ValueError(f"found {points.dtype} of shape {points.shape}")
    return points.astype(float)


def _coordinates(table: Rows) -> Float[np.ndarray, "K 2"]:
    """Returns the columns x and y: those with these names, the only two, or the two after an index."""
    rows, names, lines, _ = table
    count = rows.shape[1]
    if names is not None and len(names) == count and names.count("x") == 1 and names.count("y") == 1:
        chosen = rows[:, [names.index("x"), names.index("y")]]
    elif count == 2:
        chosen = rows
    elif count == 3 and np.all(rows[:, 0] == np.round(rows[:, 0])) and np.all(np.diff(rows[:, 0]) > 0):
        return rows[:, 1:]
    else:
        raise ValueError(
            f"the two columns x and y, not {count} on line {lines[0]}: remove the others, or name them in a first line"
        )
    index = names is not None and count > 2 and np.all(rows[:, 0] == np.round(rows[:, 0]))
    if index and np.any(again := np.diff(rows[:, 0]) <= 0):
        start = lines[int(np.argmax(again)) + 1]
        raise ValueError(
            f"one outline, but a second begins on line {start}: keep one outline in a file "
            "(jaxves.read_frames reads several)"
        )
    return chosen
