"""Reads and writes scene files: from TOML text to checked tables and back.

Nothing here imports JAX, so that the command line reports wrong input quickly. `runs/build.py` makes a scene of the
tables.
"""

import difflib
import importlib.resources
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from .checking import SceneError, checked
from .scene_tables import SceneFile

__all__ = ["Readable", "SceneError", "SceneFile", "built_in_scenes", "parse", "read_scene", "to_toml"]

# What can be read as a scene: a file, the name of a built-in scene, tables like those of a file, or one that was read.
Readable = str | Path | Mapping[str, Any] | SceneFile


def parse(tables: Mapping[str, Any], *, origin: str = "scene", folder: Path | str = ".") -> SceneFile:
    """Checks the tables of a scene and returns them as a scene file. Files named in it are relative to `folder`.

    Raises:
        SceneError: the tables are not valid. The message is one line that begins with `origin`.
    """
    return checked(SceneFile, tables, origin, folder=Path(folder))


def read_tables(path: Path, origin: str, wanted: str) -> dict[str, Any]:
    """Reads the tables of a TOML file.

    Raises:
        SceneError: there is no such file, or it is not TOML. The message begins with `origin`, and `wanted` says what
        was
            expected if there is no file.
    """
    try:
        return tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise SceneError(f"{origin}: {error.strerror}, expected {wanted}") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{origin}: byte {error.start} is not UTF-8, expected a TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{origin}: {' '.join(str(error).split())}, expected a TOML file") from None


def read_scene(source: Readable) -> SceneFile:
    """Reads a scene from a file, a built-in name, or tables like those of a file.

    A scene file that was read already is returned unchanged.

    Raises:
        SceneError: there is no such scene, or it is not valid. The message is one line.
    """
    if isinstance(source, SceneFile):
        return source
    if not isinstance(source, str | Path | Mapping):
        raise SceneError(
            f"scene_file: {type(source).__name__}, expected a file, the name of a built-in scene, or tables"
        )
    if isinstance(source, Mapping):
        return parse(source)
    builtin = isinstance(source, str) and source in built_in_scenes()
    path = _builtin_folder() / f"{source}.toml" if builtin else Path(source)
    tables = read_tables(path, str(source), f"a TOML file or {_builtin_hint(source)}")
    return parse(tables, origin=str(source), folder="." if builtin else path.parent)


def to_toml(scene_file: SceneFile) -> str:
    """Returns the scene as TOML, with all defaults and without absent tables. Reading it gives the same scene."""
    text = tomli_w.dumps(scene_file.model_dump(by_alias=True, exclude_none=True))
    # Arrays of numbers are written on one line each. No text in a scene contains a bracket.
    return re.sub(r"\[\n([^][]*?),\n\s*\]", lambda array: f"[{' '.join(array[1].split())}]", text)


def built_in_scenes() -> dict[str, str]:
    """Returns the built-in scenes: a description of each, by name."""
    files = sorted(_builtin_folder().iterdir(), key=lambda file: file.name)
    return {
        file.name.removesuffix(".toml"): file.read_text(encoding="utf-8").partition("\n")[0].lstrip("# ")
        for file in files
        if file.name.endswith(".toml")
    }


def _builtin_folder():
    return importlib.resources.files(__package__) / "scenes"


def _builtin_hint(name: str | Path) -> str:
    near = difflib.get_close_matches(Path(name).name, built_in_scenes(), n=1)
    hint = f" (did you mean {near[0]}?)" if near else ""
    return f"a built-in scene: {', '.join(built_in_scenes())}{hint}"
