"""What charge that relaxes, or a field with a period, does not allow in other tables of a scene file.

Nothing here imports JAX.
"""

from collections.abc import Sequence

from ..base.bounds import RATIO_OF_RELAXING
from .checking import Table, refusal


def check_field(field: Table, vesicles: Sequence[Table], numerics: Table, cell: Table | None) -> None:
    """Raises the error for the first value that does not fit [field]: of a ratio, a method, a step or a cell."""
    averaged = getattr(field.time, "averaged", False)
    if cell is not None and field.charge_relaxation is not None:
        raise refusal("no such key in a [cell]", "field.charge_relaxation", field.charge_relaxation)
    if cell is not None and averaged:
        raise refusal("false in a [cell]", "field.time.averaged", True)
    if field.charge_relaxation is not None:
        _check_ratios(field, vesicles)
    if numerics.method == "euler" and (averaged or field.charge_relaxation is not None):
        wanted = '"auto", "ark4" or "ark5" with charge_relaxation or averaged = true'
        raise refusal(wanted, "numerics.method", numerics.method)
    check_step(numerics, None if averaged else field.time, "field")


def check_step(numerics: Table, time: Table | None, name: str) -> None:
    """Raises the error for a fixed step that is too long for the period of the field or the flow."""
    frequency = getattr(time, "frequency", None)
    if numerics.time_step is not None and frequency is not None:
        longest = 1 / (8 * frequency)
        if numerics.time_step > longest:
            wanted = f"at most {longest:.6g}, an eighth of the period of the {name}"
            raise refusal(wanted, "numerics.time_step", numerics.time_step)


def _check_ratios(field: Table, vesicles: Sequence[Table]) -> None:
    places = [("field", field), *((f"vesicle[{i}]", vesicle) for i, vesicle in enumerate(vesicles))]
    for place, table in places:
        value = table.conductivity_ratio
        if value is not None and not RATIO_OF_RELAXING.hold(value):
            raise refusal(RATIO_OF_RELAXING.expected, f"{place}.conductivity_ratio", value)
