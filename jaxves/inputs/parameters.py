"""The physical numbers of a scene file by name, and replacing them by others.

Names are key paths of the file: "field.beta", "vesicle.reduced_area" (of all vesicles) or "vesicle[1].reduced_area",
"pair.offset_angle", "flow.gradient[0][1]", "cell.lattice[1][0]". Units are the file's: angles in degrees. This is what
sweeps, fits and sensitivities vary; the points of a curve are no numbers in this sense, they are reached through
`Scene.x`.
Nothing here imports JAX: traced numbers pass through unchanged (`runs.build.scene_of`).
"""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from ..base.physical_numbers import CHARGE_RELAXATION, DISTURBANCE, PER_VESICLE, VISCOSITY_RATIO
from .checking import SceneError, Table, checked, dotted
from .scene_tables import SceneFile

_TABLES = ("vesicle", "pair", "fluid", "field", "flow", "cell")
# Numbers that may be given without the file having them: those of [field] or [fluid] for a vesicle, and those that may
# be absent.
_OWN = (*(number.key for number in PER_VESICLE), VISCOSITY_RATIO.key, DISTURBANCE.key, CHARGE_RELAXATION.key)
_PART = re.compile(r"\.?([A-Za-z_]\w*)|\[(\d+)\]")


def numbers(scene_file: SceneFile) -> dict[str, float]:
    """Returns every physical number of the scene, by name. Names of a single vesicle have no index."""
    found = {}
    for table in _TABLES:
        for path, value in _numbers(getattr(scene_file, table), (table,)):
            if table == "vesicle" and len(scene_file.vesicle) == 1:
                path = ("vesicle", *path[2:])
            found[dotted(path)] = value
    return found


def _numbers(value: Any, path: tuple) -> Iterator[tuple[tuple, float]]:
    match value:
        case Table():
            for key in type(value).model_fields:
                if key != "points":
                    yield from _numbers(getattr(value, key), (*path, key))
        case tuple():
            for i, item in enumerate(value):
                yield from _numbers(item, (*path, i))
        case float():
            yield path, value


def with_numbers(scene_file: SceneFile, values: Mapping[str, Any]) -> SceneFile:
    """Returns the scene file with these numbers in place of its own. They are not checked, and may be traced.

    Raises:
        SceneError: the scene has no number of such a name.
    """
    for name, value in values.items():
        parts = tuple(int(i) if i else key for key, i in _PART.findall(name))
        match parts:
            case "vesicle", str(), *_:
                paths = [("vesicle", m, *parts[1:]) for m in range(len(scene_file.vesicle))]
            case _:
                paths = [parts]
        try:
            if dotted(parts) != name or parts[:1] not in [(table,) for table in _TABLES]:
                raise LookupError
            for path in paths:
                scene_file = _replaced(scene_file, path, value)
        except LookupError:
            known = ", ".join(numbers(scene_file))
            raise SceneError(f"{name} = {value}, expected one of the numbers of the scene: {known}") from None
    return scene_file


def with_nodes(scene_file: SceneFile, N: int | str) -> SceneFile:
    """Returns the same scene file with this number of nodes, or with "auto"."""
    return scene_file.model_copy(update={"numerics": scene_file.numerics.model_copy(update={"nodes": N})})


def check_numbers(scene_file: SceneFile, values: Mapping[str, float]) -> None:
    """Raises SceneError unless these numbers are allowed in place of those of the scene."""
    tables = with_numbers(scene_file, values).model_dump(by_alias=True, exclude_none=True)
    checked(SceneFile, tables, "scene")


def _replaced(item: Any, path: tuple, value: Any) -> Any:
    """Returns `item` with the number at the end of `path` replaced; raises LookupError if there is none."""
    if not path:
        if isinstance(item, Table | tuple | str | bool):
            raise LookupError
        return value
    key, rest = path[0], path[1:]
    match item:
        case tuple() if isinstance(key, int):
            return (*item[:key], _replaced(item[key], rest, value), *item[key + 1 :])
        case Table() if key in type(item).model_fields and key != "points":
            old = getattr(item, key)
            if old is None and key not in _OWN:
                raise LookupError
            return item.model_copy(update={key: _replaced(old, rest, value)})
    raise LookupError
