"""Reads text files with numbers in columns, as image programs and spreadsheets write them.

- Columns are separated by commas, semicolons, tabs or spaces. Decimal commas are read if they are unambiguous.
- One line of column names is allowed. Comments start with #, % or //. Any line ends are allowed.
- The text is in UTF-8, UTF-16 or Latin-1.

For everything else, the error message names the line and says what to change. Nothing here imports JAX.
"""

import re
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

_COMMENT = re.compile(r"#|%|//")
_DECIMAL_COMMAS = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")


class Rows(NamedTuple):
    """The numbers of a file (R, C), the column names if there are any, and the line and the block of each row.

    Blank lines separate blocks, which are numbered from 0.
    """

    values: Float[np.ndarray, "R C"]
    names: list[str] | None
    lines: tuple[int, ...]
    blocks: tuple[int, ...]


def read_rows(text: str) -> Rows:
    """Reads the rows of the text of a file.

    Raises:
        ValueError: a line has no numbers, or not as many as the lines before, or there are none.
    """
    names: list[str] | None = None
    rows: list[list[float]] = []
    lines: list[int] = []
    blocks: list[int] = []
    block, blank = 0, False
    for number, line in enumerate(text.splitlines(), start=1):
        content = _COMMENT.split(line)[0].rstrip(" \t,;")
        if not content:
            blank = blank or not line.strip()
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
            block += blank and bool(rows)
            rows.append(values)
            lines.append(number)
            blocks.append(block)
        blank = False
    if not rows:
        raise ValueError("lines with the two numbers x and y, but found none")
    return Rows(np.array(rows), names, tuple(lines), tuple(blocks))


def decoded(data: bytes) -> str:
    """Returns the text of a file."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


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


def _short(text: str) -> str:
    text = " ".join(text.split())
    return f'"{text if len(text) <= 40 else text[:37] + "..."}"'
