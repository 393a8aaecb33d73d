"""A file (JSON) of the starts of a fit that are done, from which an interrupted fit continues."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax
import numpy as np
import optax

from ..inputs.scene_files import to_toml
from ..inputs.scene_tables import SceneFile
from ..stepping.march import AbstractMarch
from .boxes import Box
from .descent import fingerprint_of
from .observations import Observations
from .search import Start


def fingerprint(
    scene_file: SceneFile,
    inside: Mapping[str, Box],
    observations: Observations,
    march: AbstractMarch,
    tolerance: float,
    method: optax.GradientTransformation | None,
    tried: Sequence[Mapping[str, float]],
) -> str:
    """Returns a hash of everything that determines the end of a search from a given start.

    `tried` are the numbers of the scene at some points. They stand for a function of the caller.
    """
    text = [to_toml(scene_file), repr(sorted(inside.items())), repr(march), repr(tolerance), repr(observations.t_end)]
    text += [repr(sorted(point.items())) for point in tried]
    for name, values in sorted((observations.conditions or {}).items()):
        text += [name, repr(np.asarray(values).tolist())]
    for name in sorted(observations.seen):
        text += [name, repr(np.asarray(observations.seen[name]).tolist()), repr(float(observations.deviation[name]))]
    if observations.gauge is not None:
        text += [repr(np.asarray(array).tolist()) for array in jax.tree.leaves(observations.gauge)]
    if method is not None:
        text.append(fingerprint_of(method))
    return hashlib.sha256("\n".join(text).encode()).hexdigest()


def resumed(checkpoint: str | Path | None, mark: str) -> list[Start]:
    """Returns the starts in the file; an empty list without a file.

    Raises:
        ValueError: the file belongs to another fit or is no such file.
    """
    if checkpoint is None or not Path(checkpoint).exists():
        return []
    try:
        kept = json.loads(Path(checkpoint).read_text())
        found, starts = kept["fit"], [Start(**start) for start in kept["starts"]]
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"checkpoint = {checkpoint}, expected the starts of an earlier fit (JSON).") from None
    if found != mark:
        raise ValueError(f"checkpoint = {checkpoint}, expected that of the same scene, bounds and observations.")
    return starts


def keep(checkpoint: str | Path | None, mark: str, done: list[Start]) -> None:
    """Writes the starts into the file, which is replaced as a whole."""
    if checkpoint is None:
        return
    path = Path(checkpoint)
    part = path.with_name(path.name + ".part")
    part.write_text(json.dumps({"fit": mark, "starts": [start._asdict() for start in done]}, indent=1) + "\n")
    os.replace(part, path)
