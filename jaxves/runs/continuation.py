"""Decides whether a result file can be continued: with the same scene, or with a later `t_end` and matching `saves`.

A continued run saves the same times as a run of the new scene from its start. The two therefore agree bit for bit.
Nothing here imports JAX.
"""

import tomllib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from ..base import status
from ..inputs.scene_files import SceneError, parse
from ..inputs.scene_tables import SceneFile
from ..results import run_store
from ..results.hdf5 import StoreError

_TO_BE_CONTINUED = tuple(status.WORDS[code] for code in (status.RUNNING, status.INTERRUPTED, status.TOO_MANY_STEPS))
_MAY_DIFFER = ("t_end", "saves", "numerics.certify")  # certify concerns only what happens after the end
_NAMED = 4  # largest number of keys in a message


def saved_times(scene_file: SceneFile) -> np.ndarray:
    """Returns the times that a run saves, k t_end / saves, (T,). Each is the nearest float; the last is t_end.

    They are computed from the decimal numbers of the file with exact fractions. Equal spacings therefore give equal
    floats for every `t_end`.
    """
    spacing = _spacing(scene_file)
    return np.array([float(k * spacing) for k in range(scene_file.saves + 1)])


def is_done(path: Path, scene_file: SceneFile) -> bool:
    """Returns whether the run in the file is complete for this scene.

    A run that was ended by its stop condition is complete for every later `t_end`.

    Raises:
        StoreError: the file is not a result file, its scene differs in other keys than allowed, or its run broke down
            and would break down again.
    """
    record = run_store.read_result(path)
    try:
        stored = parse(tomllib.loads(record.scene), origin=f"the scene in {path}")
    except SceneError as error:
        raise StoreError(f"cannot resume {path}: {error}") from None
    _check_scene(path, stored, scene_file)
    if record.status == status.WORDS[status.COMPLETE]:
        return scene_file.saves == stored.saves
    if record.status in (*status.SUCCESS, *_TO_BE_CONTINUED):
        return record.status in status.SUCCESS
    advice = record.attributes["advice"]
    raise StoreError(f"{path} ended with the status {record.status!r}, as its continuation would. {advice}")


def _check_scene(path: Path, old: SceneFile, new: SceneFile) -> None:
    keys = sorted(differing(old, new))
    if keys:
        named = ", ".join(keys[:_NAMED]) + (f" and {len(keys) - _NAMED} more" if len(keys) > _NAMED else "")
        verb = "differs" if len(keys) == 1 else "differ"
        raise StoreError(
            f"{path} holds another scene, in which {named} {verb}: a run is resumed with its own scene, expected the "
            "same values of all keys but t_end and saves, which may grow. Or start anew, with force=True (--force) or "
            "another file."
        )
    spacing = _spacing(old)
    if _spacing(new) == spacing and new.saves >= old.saves:
        return
    if new.t_end < old.t_end:
        raise StoreError(f"t_end = {new.t_end}, expected at least {old.t_end}: {path} holds a run to that time.")
    times = _exact(new.t_end) / spacing
    asked = f"t_end = {new.t_end} with saves = {new.saves} would not save the times that {path} has"
    if times.denominator == 1:
        raise StoreError(f"{asked}: expected saves = {times}.")
    whole = -(-times.numerator // times.denominator)
    raise StoreError(f"{asked}: expected t_end = {float(whole * spacing)} with saves = {whole}, or another multiple.")


def differing(old: SceneFile, new: SceneFile) -> set[str]:
    """Returns the key paths that have different values in the two scenes, without those that may differ."""
    a, b = (dict(_leaves(scene.model_dump(by_alias=True, exclude_none=True))) for scene in (old, new))
    return {key for key in a.keys() | b.keys() if key not in _MAY_DIFFER and a.get(key) != b.get(key)}


def _leaves(tables: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(tables, dict):
        for name, value in tables.items():
            yield from _leaves(value, f"{key}.{name}" if key else name)
    elif isinstance(tables, list | tuple) and any(isinstance(value, dict) for value in tables):
        for i, value in enumerate(tables):
            yield from _leaves(value, f"{key}[{i}]")
    else:
        yield key, tables


def _spacing(scene_file: SceneFile) -> Fraction:
    return _exact(scene_file.t_end) / scene_file.saves


def _exact(number: float) -> Fraction:
    """Returns the decimal number that is printed for this float, as an exact fraction."""
    return Fraction(repr(float(number)))
