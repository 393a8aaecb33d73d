"""What a scene file is used for, and which of its keys that use can honour; the others are refused, not dropped.

Nothing here imports JAX.
"""

from typing import NamedTuple

from .checking import SceneError
from .scene_tables import SceneFile


class Use(NamedTuple):
    """What a scene file is used for, in words, and which of its keys that can honour."""

    name: str
    auto_nodes: bool = False
    certify: bool = False
    stop: bool = False


RUN = Use("a run", auto_nodes=True, certify=True, stop=True)
SWEEP = Use("a sweep", stop=True)
SENSITIVITY = Use("a sensitivity")
FIT = Use("a fit")
CRITICAL_FIELD = Use("a critical field")
GRADIENT_CHECK = Use("a gradient check")
USES = (RUN, SWEEP, SENSITIVITY, FIT, CRITICAL_FIELD, GRADIENT_CHECK)


def refuse_unused(scene_file: SceneFile, use: Use, origin: str = "scene") -> None:
    """Raises SceneError, one line that begins with `origin`, for a key that `use` cannot honour."""
    numerics = scene_file.numerics
    complaint = None
    if numerics.nodes == "auto" and not use.auto_nodes:
        complaint = f'numerics.nodes = "auto", expected an even whole number: {use.name} keeps the nodes it starts with'
    elif numerics.certify and not use.certify:
        complaint = f"numerics.certify = true, expected no such key: {use.name} makes no second run to estimate errors"
    elif scene_file.stop is not None and not use.stop:
        complaint = f"stop, expected no such table: {use.name} needs runs that reach their end"
    if complaint is not None:
        raise SceneError(f"{origin}: {complaint}")
