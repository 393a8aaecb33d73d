"""Reads outlines that image programs, spreadsheets and contour tools write: one point per line, with x and y.

- Columns are separated by commas, semicolons, tabs or spaces. Decimal commas are read if they are unambiguous.
- One line of column names and an index column before x and y are allowed.
- Comments start with #, % or //. The last point may repeat the first. Any line ends are allowed.
- The text is in UTF-8, UTF-16 or Latin-1.

For everything else, the error message names the line and says what to change. Nothing here imports JAX.
"""

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".npy")
_COMMENT = re.compile(r"#|%|//")
_DECIMAL_COMMAS = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")


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
        text = _decoded(path.read_bytes())
    except OSError as error:
        raise ValueError(f"a readable file ({error.strerror or 'not such a file'})") from None
    except (ValueError, EOFError) as error:
        raise ValueError(f"{kind} ({' '.join(str(error).split())})") from None
    return _parsed(text)


def _array(points: np.ndarray) -> Float[np.ndarray, "K 2"]:
    if points.ndim != 2 or points.shape[1] != 2 or points.dtype.kind not in "iuf":
        raise ValueError(f"found {points.dtype} of shape {points.shape}")
    return points.astype(float)


def _decoded(data: bytes) -> str:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _parsed(text: str) -> OutlineFile:
    names: list[str] | None = None
    rows: list[list[float]] = []
    lines: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        content = _COMMENT.split(line)[0].rstrip(" \t,;")
        if not content:
            continue
        fields = _fields(content, number)
        values = _numbers(fields)
        if values is None and not rows and names is None and re.search(r"[A-Za-z]", content):
            names = [field.strip(" \"'").lower() for field in fields]
        elif values is None:
            raise ValueError(f"two numbers on line {number}, not {_short(line)}: remove the line, or put # before it")
        else:
            if rows and len(values) != len(rows[0]):
                raise ValueError(f"{len(rows[0])} numbers on line {number}, as on the lines before, not {len(values)}")
            rows.append(values)
            lines.append(number)
    if not rows:
        raise ValueError("lines with the two numbers x and y, but found none")
    return OutlineFile(_coordinates(np.array(rows), names, lines), tuple(lines))


def _fields(content: str, number: int) -> list[str]:
    """Returns the columns of a line, with decimal points in place of decimal commas."""
    for separator in (";", "\t"):
        if separator in content:
            return [field.strip().replace(",", ".") for field in content.strip(separator).split(separator)]
    words = content.split()
    if len(words) > 1 and all(_DECIMAL_COMMAS.fullmatch(word) for word in words):
        return [word.replace(",", ".") for word in words]
    if "," not in content:
        return words
    fields = [field.strip() for field in content.split(",")]
    if len(fields) in (4, 6) and all(re.fullmatch(r"[-+]?\d+", field) for field in fields):
        raise ValueError(
            f"another separator than a comma on line {number}, where {_short(content)} may be decimal commas: "
            "write decimal points, or separate the columns by semicolons"
        )
    return fields


def _numbers(fields: list[str]) -> list[float] | None:
    try:
        return [float(field.strip("\"' ")) for field in fields]
    except ValueError:
        return None


def _coordinates(rows: np.ndarray, names: list[str] | None, lines: list[int]) -> Float[np.ndarray, "K 2"]:
    """Returns the columns x and y: those with these names, the only two, or the two after an index."""
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
        raise ValueError(f"one outline, but a second begins on line {start}: keep one outline in a file")
    return chosen


def _short(text: str) -> str:
    text = " ".join(text.split())
    return f'"{text if len(text) <= 40 else text[:37] + "..."}"'
