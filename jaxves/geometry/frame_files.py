"""Reads outlines at several times from one file, as contour tools write them.

- Text (`text_rows`): a frame column beside x and y, as in the tables of ImageJ, or blank lines between the outlines.
  The column is named frame, slice, image or t in a first line. Without names it is the first or last of three columns.
- .npy: an array (T, K, 2) of T outlines with K points each, or rows (R, 3) with the frame in the first column.
- .npz: one array (K, 2) for each outline, in the order of their names, or one array as in a .npy file.
- .json: a list of outlines, each a list of points.

For everything else, the error message says what to change. Nothing here imports JAX.
"""

import json
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .text_rows import Rows, decoded, read_rows

SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".xy", ".npy", ".npz", ".json")
_FRAME_COLUMNS = ("frame", "slice", "image", "t")


class OutlineInFrame(NamedTuple):
    """The number of a frame, its points (K, 2) as in the file, and their line numbers in a text file."""

    number: int
    points: Float[np.ndarray, "K 2"]
    lines: tuple[int, ...] | None = None


def read_outlines(path: Path) -> list[OutlineInFrame]:
    """Reads the outlines of a file, one for each frame, in the order of the frames.

    Raises:
        ValueError: the file has no outlines in a known form. The message says what was expected.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ValueError(f"the name of a {', '.join(SUFFIXES[:-1])} or {SUFFIXES[-1]} file")
    kind = {".npy": "a .npy file of numbers", ".npz": "a .npz file of numbers", ".json": "a JSON file"}
    try:
        match suffix:
            case ".npy":
                found = np.load(path, allow_pickle=False)
            case ".npz":
                with np.load(path, allow_pickle=False) as arrays:
                    found = [arrays[name] for name in sorted(arrays.files, key=_natural)]
            case ".json":
                found = json.loads(path.read_text(encoding="utf-8"))
            case _:
                found = decoded(path.read_bytes())
    except OSError as error:
        raise ValueError(f"a readable file ({error.strerror or 'not such a file'})") from None
    except (ValueError, EOFError) as error:
        raise ValueError(f"{kind.get(suffix, 'a text file of numbers')} ({' '.join(str(error).split())})") from None
    if isinstance(found, str):
        return _of_rows(read_rows(found))
    if isinstance(found, list) and suffix == ".npz" and len(found) == 1:
        found = found[0]
    return _of_array(found) if isinstance(found, np.ndarray) else _of_list(found)


def _natural(name: str) -> list:
    """Returns a key that sorts arr_2 before arr_10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _of_array(array: np.ndarray) -> list[OutlineInFrame]:
    if array.dtype.kind in "iuf":
        array = array.astype(float)
        if array.ndim == 3 and array.shape[2] == 2:
            return [OutlineInFrame(i, points) for i, points in enumerate(array)]
        if array.ndim == 2 and array.shape[1] == 2:
            return [OutlineInFrame(0, array)]
        if array.ndim == 2 and array.shape[1] == 3 and _is_whole(array[:, 0]):
            return _by_frame(array[:, 0], array[:, 1:], None)
    raise ValueError(
        f"numbers of shape (T, K, 2), or (R, 3) with the frame in the first column, but found {array.dtype} of shape "
        f"{array.shape}"
    )


def _of_list(outlines: object) -> list[OutlineInFrame]:
    wanted = "a list of outlines, each a list of points [x, y]"
    if not isinstance(outlines, list) or not outlines:
        raise ValueError(f"{wanted}, but found {type(outlines).__name__ if outlines else 'nothing'}")
    found = []
    for i, outline in enumerate(outlines):
        try:
            points = np.array(outline)
        except ValueError:
            points = np.array(None)
        if points.ndim == 3 and points.shape[2] == 2 and len(points) == 1:
            points = points[0]  # a list of the contours of an image, with one contour
        if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in "iuf":
            several = isinstance(outline, list) and len(outline) > 1 and np.ndim(outline[0][:1]) == 2
            other = f"{len(outline)} contours: keep the longest" if several else "something else"
            raise ValueError(f"{wanted}, but outline {i} is {other}")
        found.append(OutlineInFrame(i, points.astype(float)))
    return found


def _of_rows(table: Rows) -> list[OutlineInFrame]:
    values, names, lines, blocks = table
    count = values.shape[1]
    named = names is not None and len(names) == count and names.count("x") == 1 and names.count("y") == 1
    if named:
        points = values[:, [names.index("x"), names.index("y")]]
        frames = [name for name in _FRAME_COLUMNS if names.count(name) == 1]
        if frames:
            return _by_frame(values[:, names.index(frames[0])], points, lines)
    elif count == 2:
        points = values
    elif count == 3 and (column := _frame_column(values)) is not None:
        return _by_frame(values[:, column], np.delete(values, column, axis=1), lines)
    else:
        raise ValueError(
            f"the columns frame, x and y, but found {count} columns on line {lines[0]}: name them in a first line"
        )
    return _by_frame(np.array(blocks), points, lines)


def _frame_column(values: Float[np.ndarray, "R 3"]) -> int | None:
    """Returns the first or last column if it has whole numbers that stay the same over several rows."""
    for column in (0, 2):
        steps = np.diff(values[:, column])
        if _is_whole(values[:, column]) and np.all(steps >= 0) and np.count_nonzero(steps) < len(steps) / 4:
            return column
    return None


def _is_whole(numbers: np.ndarray) -> bool:
    return bool(np.all(np.isfinite(numbers)) and np.all(numbers == np.round(numbers)))


def _by_frame(frames: np.ndarray, points: np.ndarray, lines: tuple[int, ...] | None) -> list[OutlineInFrame]:
    if not _is_whole(frames):
        row = int(np.argmax(frames != np.round(frames)))
        where = f"line {lines[row]}" if lines else f"row {row}"
        raise ValueError(f"whole numbers in the frame column, not {frames[row]:g} on {where}")
    found = []
    for number in np.unique(frames):
        rows = np.flatnonzero(frames == number)
        found.append(
            OutlineInFrame(int(number), points[rows], None if lines is None else tuple(lines[row] for row in rows))
        )
    return found
