"""Checks the derivatives of a scene: forward mode, reverse mode and finite differences for every number.

Derivatives disagree if forward and reverse mode differ by more than 1e-8, or forward mode and finite differences by
more than 1e-6 plus the estimated error of the finite differences. These values are relative to the derivative. If the
derivative is zero, as by symmetry, they are relative to a thousandth of the ratio of the diagnostic to the number.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from ..base import status
from ..base.physical_numbers import declared
from ..base.progress import Progress, silent
from ..equation.tracking import turned
from ..inputs import parameters
from ..inputs.scene_files import Readable
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import GRADIENT_CHECK
from ..numerics.arrays import as_float
from ..runs.case import Case
from ..stepping.fixed import Fixed
from . import differences
from .sensitivity import AtEnd, pulled, pushed, unit

MODES_AGREE, DIFFERENCES_AGREE, WORTHLESS = 1e-8, 1e-6, 1e-4
_SMOOTH = ("deformation", "inclination", "center", "bending_energy", "tank_treading_speed", "stress")
_IN_FIELD, _OF_PAIRS = ("dipole", "dissipation"), ("min_gap",)
_STEP = 1e-2  # relative step of the finite differences
_SIZE = 0.3  # scale of small entries of vectors; `physical_numbers` has the scale of each number


class Row(NamedTuple):
    """One derivative. The values are those of the component that depends most on the number.

    The deviations and the verdict are those of the worst component.
    """

    number: str
    quantity: str
    forward: float
    reverse: float
    differences: float
    modes: float  # relative deviation of forward and reverse
    deviation: float  # of forward and differences
    doubt: float  # estimated error of the finite differences
    verdict: str  # "agree", "DISAGREE", or "no verdict" with a reason


class BrokenDown(Exception):
    """The run does not reach its end, so its derivatives are not checked. The message is its status word."""


def _completed(case: Case, t_end: float, march: Fixed) -> None:
    @eqx.filter_jit
    def end():
        return case.simulate({}, t_end=t_end, saves=1, march=march).status

    code = int(end())
    if code != status.COMPLETE:
        raise BrokenDown(status.WORDS[code])


def quantities_of(scene_file: SceneFile) -> tuple[str, ...]:
    """Returns the names of the diagnostics that are checked; maxima over nodes are left out, as they are not smooth."""
    several = len(scene_file.vesicles()) > 1
    return _SMOOTH + (_IN_FIELD if scene_file.field else ()) + (_OF_PAIRS if several else ())


def _why_not(name: str, value: float) -> str | None:
    if name.endswith("reduced_area") and value == 1.0:
        return "infinite at a circle, like 1/√(1-Δ)"
    return None if math.isfinite(value) else "at infinity"


def check_gradients(scene_file: Readable, t_end: float, steps: int, *, progress: Progress = silent) -> Iterator[Row]:
    """Yields the rows for all numbers of a scene, for its diagnostics after `steps` fixed steps to `t_end`.

    The scheme is the `method` of the scene. Its tolerance or time step is replaced by `steps`. `progress` is called
    with the number of numbers that are done, the number of all, and a text.

    Raises:
        SceneError: the scene has a key that derivatives do not support, such as `nodes = "auto"`.
        BrokenDown: the run with the numbers of the scene does not reach its end.
    """
    case = Case.of(scene_file, GRADIENT_CHECK)
    scene_file = case.scene_file
    march = Fixed(steps, case.march().stepper)
    _completed(case, t_end, march)
    outcome = AtEnd(scene_file, quantities_of(scene_file), t_end, march=march)
    values = {name: as_float(value) for name, value in parameters.numbers(scene_file).items()}
    progress(0, len(values), "forward mode")
    outputs, _ = pushed(outcome, values, unit(values, 0))
    flat, unflatten = ravel_pytree(outputs)
    progress(0, len(values), "reverse mode")
    reverse = [pulled(outcome, values, unit(outputs, i))[1] for i in range(flat.size)]
    for i, name in enumerate(sorted(values)):
        value = float(values[name])
        progress(i, len(values), name)
        why = _why_not(name, value)
        if why is not None:
            yield Row(name, "all", *[math.nan] * 6, why)
            continue
        _, forward = pushed(outcome, values, unit(values, i))

        def run(x, name=name):
            found, _ = pushed(outcome, values | {name: as_float(x)}, unit(values, 0))
            # An axis along y has the angle π/2 or -π/2; the nearer one is used.
            found = found | {"inclination": turned(outputs["inclination"], found["inclination"])}
            return np.asarray(ravel_pytree(found)[0])

        number = declared(name)
        size = max(abs(value), _SIZE if number is None else number.size)
        if number is not None and value == number.lowest:
            found = differences.one_sided(run, value, _STEP * size)
        else:
            found = differences.central(run, value, _STEP * size)
        backward = unflatten(jnp.stack([row[name] for row in reverse]))
        yield from _rows(name, size, outputs, forward, backward, *map(unflatten, map(jnp.asarray, found)))


def _rows(name, size, outputs, forward, backward, found, error) -> Iterator[Row]:
    for quantity in outputs:
        parts = [np.ravel(part[quantity]) for part in (outputs, forward, backward, found, error)]
        value, forward_, backward_, found_, error_ = parts
        scale = max(np.max(np.abs(forward_)), 1e-3 * max(np.max(np.abs(value)), 1.0) / size)
        modes = np.max(np.abs(forward_ - backward_)) / scale
        deviation = np.max(np.abs(forward_ - found_)) / scale
        doubt = np.max(error_) / scale
        if not modes <= MODES_AGREE:
            verdict = "DISAGREE"
        elif not np.all(np.isfinite(found_)):
            verdict = "no verdict: runs beside this one break down"
        elif not deviation <= DIFFERENCES_AGREE + doubt:
            verdict = "DISAGREE"
        else:
            verdict = "no verdict: differences are not smooth" if doubt > WORTHLESS else "agree"
        most = int(np.argmax(np.abs(forward_)))
        yield Row(
            name, quantity, *(float(part[most]) for part in (forward_, backward_, found_)), modes, deviation, doubt,
            verdict,
        )  # fmt: skip
