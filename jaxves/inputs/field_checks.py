"""What charge that relaxes, or a field with a period, does not allow in other tables of a scene file.

Nothing here imports JAX.
"""

from typing import Any

from ..base.bounds import RATIO_OF_RELAXING
from ..base.time_steps import MOST_STEPS, STEPS_PER_PERIOD
from .checking import Table, refusal


def check_field(file: Any) -> None:
    """Raises the error for the first value of a scene that does not fit its [field]: a ratio, a method or a cell."""
    field, numerics, cell = file.field, file.numerics, file.cell
    averaged = getattr(field.time, "averaged", False)
    if cell is not None and field.charge_relaxation is not None:
        raise refusal("no such key in a [cell]", "field.charge_relaxation", field.charge_relaxation)
    if cell is not None and averaged:
        raise refusal("false in a [cell]", "field.time.averaged", True)
    if field.charge_relaxation is not None:
        _check_ratios(file)
    if numerics.method == "euler" and (averaged or field.charge_relaxation is not None):
        wanted = '"auto", "ark4" or "ark5" with charge_relaxation or averaged = true'
        raise refusal(wanted, "numerics.method", numerics.method)
    check_step(file, None if averaged else field.time, "field")


def check_step(file: Any, time: Table | None, name: str) -> None:
    """Raises the error for a fixed step that is too long for the period of the field or the flow, or for too many.

    A run that may end early, by its stop condition, may have any number of periods.
    """
    frequency, step = getattr(time, "frequency", None), file.numerics.time_step
    if frequency is None:
        return
    longest = 1 / (STEPS_PER_PERIOD * frequency)
    if step is not None and step > longest:
        wanted = f"at most {longest:.6g}, an eighth of the period of the {name}"
        raise refusal(wanted, "numerics.time_step", step)
    if step is None and file.stop is None and file.t_end > MOST_STEPS * longest:
        wanted = f"at most {MOST_STEPS / (STEPS_PER_PERIOD * file.t_end):.6g} for this t_end, because a period takes"
        wanted += f" {STEPS_PER_PERIOD} steps or more and a run at most {MOST_STEPS}"
        wanted += "; or averaged = true" * (time.kind == "ac" and file.cell is None)
        raise refusal(wanted, f"{name}.time.frequency", frequency)


def _check_ratios(file: Any) -> None:
    places = [("field", file.field), *((f"vesicle[{i}]", vesicle) for i, vesicle in enumerate(file.vesicle))]
    for place, table in places:
        value = table.conductivity_ratio
        if value is not None and not RATIO_OF_RELAXING.hold(value):
            raise refusal(RATIO_OF_RELAXING.expected, f"{place}.conductivity_ratio", value)
