"""The uses of a scene file, and the keys that each use supports. Unsupported keys are refused and not ignored.

Nothing here imports JAX.
"""

from typing import NamedTuple

from ..base.resolution import DEFAULT_NODES
from .checking import SceneError
from .parameters import with_nodes
from .scene_tables import SceneFile


class Use(NamedTuple):
    """A use of a scene file: its name, and the keys that it supports."""

    name: str
    auto_nodes: bool = False
    certify: bool = False
    stop: bool = False


RUN = Use("a run", auto_nodes=True, certify=True, stop=True)
SWEEP = Use("a sweep", stop=True)
SENSITIVITY = Use("a sensitivity")
FIT = Use("a fit")
CRITICAL_FIELD = Use("a critical field")
FOLD = Use("a critical value")
GRADIENT_CHECK = Use("a gradient check")
CONTROL = Use("a control")
USES = (RUN, SWEEP, SENSITIVITY, FIT, CRITICAL_FIELD, FOLD, GRADIENT_CHECK, CONTROL)


def for_use(scene_file: SceneFile, use: Use) -> SceneFile:
    """Returns the scene file with the nodes that `use` has if the file says nothing: "auto" in a run, otherwise 64."""
    if scene_file.numerics.nodes is not None:
        return scene_file
    return with_nodes(scene_file, "auto" if use.auto_nodes else DEFAULT_NODES)


def refuse_unused(scene_file: SceneFile, use: Use, origin: str = "scene") -> None:
    """Raises SceneError for a key that `use` does not support; the message begins with `origin`."""
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
