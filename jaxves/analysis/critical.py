"""What searches for a critical number of a scene share: which scenes they take, and how they are made finer.

`critical_field` follows runs to the boundary of a class. `fold` follows steady states to where they end.
"""

from typing import NamedTuple

from jaxtyping import Array

from ..inputs.parameters import numbers, with_numbers
from ..inputs.scene_files import Readable
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import Use
from ..numerics.arrays import as_float
from ..runs.case import Case


class NoCriticalValue(Exception):
    """The critical number is not where it was sought, or a run broke down. The message is one line."""


class Discretisation(NamedTuple):
    """The changes of a critical number with 1.5 times the nodes, and with a tenth of the tolerance.

    `step` is zero for a critical number that no run is needed for.
    """

    nodes: float
    step: float = 0.0


def of_one(scene_file: Readable, use: Use) -> Case:
    """Returns the case of a scene with one vesicle in free space.

    Raises:
        NoCriticalValue: there are several vesicles, or there is a periodic cell.
        SceneError: as for `Case.of`.
    """
    case = Case.of(scene_file, use)
    if len(case.scene_file.vesicles()) != 1 or case.scene_file.cell is not None:
        raise NoCriticalValue(f"scene_file: {use.name} needs one vesicle in free space")
    return case


def finer(scene_file: SceneFile) -> Discretisation:
    """Returns two scene files, with 1.5 times the nodes and with a tenth of the tolerance (None with a fixed step)."""
    numerics = scene_file.numerics

    def changed(**numbers):
        return scene_file.model_copy(update={"numerics": numerics.model_copy(update=numbers)})

    step = None if numerics.tolerance is None else changed(tolerance=0.1 * numerics.tolerance)
    return Discretisation(changed(nodes=2 * round(0.75 * numerics.nodes)), step)


def with_traced_numbers(scene_file: SceneFile) -> tuple[Case, dict[str, Array]]:
    """Returns a case without numbers of its own, and the numbers by name.

    One compiled program then serves all scenes that differ in numbers only.
    """
    values = {name: as_float(value) for name, value in numbers(scene_file).items()}
    return Case(with_numbers(scene_file, dict.fromkeys(values, 0.5))), values
