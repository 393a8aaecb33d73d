r"""The critical field β₀, above which a vesicle does not stay prolate, and its derivatives.

A vesicle leaves class P (`observables/classes.py`) if its least deformation along the field is below -THRESHOLD:

    g(β, p) = min_t D(t; β, p) + THRESHOLD = 0      at β = β₀(p)

Near β₀ a vesicle stays close to a square for some time. The square is a saddle: the vesicle then becomes prolate again,
or oblate. g therefore changes by a finite amount in a small interval around β₀. Without membrane conductance it is
steep, because the field that holds the square decays while the membrane charges. With conductance the saddle may
persist, and g jumps. Brent's method needs only the change of sign.

A diagnostic Q at a given instant is a smooth function of all numbers. Near the saddle every small change soon points
along its one unstable direction. Changes that cancel in this direction keep the vesicle on the boundary:

    dβ₀/dp = -(∂_p Q)/(∂_β Q)      at β₀, for any Q and late t

With Q = D at the instant of least D this is exact if g is smooth.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from ..base import status
from ..inputs.scene_files import Readable
from ..inputs.scene_tables import SceneFile
from ..inputs.uses import CRITICAL_FIELD
from ..numerics.arrays import as_float
from ..observables import classes
from ..physics.scene import Scene
from ..runs.case import Case
from ..stepping.march import AbstractMarch
from ..stepping.marching import simulate
from .critical import Discretisation, NoCriticalValue, finer, of_one, with_traced_numbers

NUMBERS = ("vesicle.reduced_area", "field.conductivity_ratio", "field.membrane_conductance", "field.chi")
QUANTITIES = ("deformation_along_field", "bending_energy", "tension_max")


class Critical(NamedTuple):
    """β₀ and the result of the search."""

    beta: float
    uncertainty: float  # half the width of the last bracket
    least: float  # min_t D at β₀
    instant: float  # the time of this minimum
    runs: int


class Slopes(NamedTuple):
    """-(∂_p Q)/(∂_β Q) for each quantity Q at each saved time, (T,). At late times it is dβ₀/dp for every Q."""

    t: Float[np.ndarray, "T"]
    ratios: dict[str, dict[str, Float[np.ndarray, "T"]]]  # by p and Q
    growth: Float[np.ndarray, "T"]  # |∂_β D|


def _alone(scene_file: Readable) -> Case:
    case = of_one(scene_file, CRITICAL_FIELD)
    if case.scene_file.field is None:
        raise NoCriticalValue("scene_file: a critical field needs a field")
    time = case.scene_file.field.time
    if time is not None and time.kind in ("sine", "ac") and not getattr(time, "averaged", False):
        wanted = "a field without a period, or averaged = true: the least D within a period says nothing of the class"
        raise NoCriticalValue(f'field.time.kind = "{time.kind}", expected {wanted}')
    return case


@eqx.filter_jit
def _started(case: Case):
    return case.at_rest(case.scene({}))


@eqx.filter_jit
def _history(scene: Scene, t_end, saves: int, march: AbstractMarch, solved_by):
    solver, coupling = solved_by
    result = simulate(scene, t_end, saves=saves, march=march, solver=solver, coupling=coupling)
    return result.t, result.diagnostics["deformation_along_field"][:, 0], result.status


def least(t: Float[np.ndarray, "T"], deformation: Float[np.ndarray, "T"]) -> tuple[float, float]:
    """Returns time and value of the minimum of D, from a polynomial of degree 4 through the saves near it."""
    i = int(np.clip(np.argmin(deformation), 2, len(t) - 3))
    near = slice(i - 2, i + 3)
    fit = np.polynomial.Polynomial.fit(t[near], deformation[near], 4)
    places = fit.deriv().roots()
    places = np.real(places[np.abs(np.imag(places)) < 1e-12])
    places = np.append(places[(places > t[near][0]) & (places < t[near][-1])], t[i])
    best = places[np.argmin(fit(places))]
    return float(best), float(fit(best))


def critical_field(
    scene_file: Readable, bracket: tuple[float, float], *, tolerance: float = 1e-6, march: AbstractMarch | None = None
) -> Critical:
    """Returns β₀ of the one vesicle of a scene, found with Brent's method.

    Args:
        scene_file: the scene, read or as a path, a built-in name or tables. Its β is not used. Its `t_end` must be late
            enough for the vesicle to become oblate, and its `saves` must resolve D(t).
        bracket: two fields. The vesicle stays prolate at the lower one and does not at the higher one.
        tolerance: relative tolerance of the search. `discretisation_error` gives the error of nodes and time steps.
        march: the time stepping; that of the scene by default.

    Raises:
        NoCriticalValue: the vesicle is in the same class at both ends of the bracket, or a run broke down; or the field
            has a period that is not averaged over.
    """
    case = _alone(scene_file)
    scene_file = case.scene_file
    if np.shape(bracket) != (2,) or not 0 <= bracket[0] < bracket[1] < np.inf:
        raise NoCriticalValue(f"bracket = {bracket}, expected two fields (low, high) with 0 <= low < high")
    march = case.march() if march is None else march
    scene, code = _started(case)
    if int(code) != status.RUNNING:
        raise NoCriticalValue(f"vesicle.relaxed = true: relaxing ended as {status.WORDS[int(code)]}")
    solved_by = case.solved_by(scene)
    seen: dict[float, tuple[float, float]] = {}

    def g(beta: float) -> float:
        at = eqx.tree_at(lambda s: s.field.beta, scene, jnp.asarray(beta))
        t, deformation, code = _history(at, scene_file.t_end, scene_file.saves, march, solved_by)
        if int(code) != status.COMPLETE:
            raise NoCriticalValue(f"field.beta = {beta}: the run ended as {status.WORDS[int(code)]}")
        seen[beta] = least(np.asarray(t), np.asarray(deformation))
        return seen[beta][1] + classes.THRESHOLD

    low, high = bracket
    if not g(low) > 0 > g(high):
        raise NoCriticalValue(
            f"bracket = {bracket}, expected fields of which the first keeps the vesicle prolate and the second does "
            f"not; least deformations are {seen[low][1]:.4f} and {seen[high][1]:.4f}"
        )
    beta = brentq(g, low, high, xtol=tolerance * high, rtol=1e-14)
    g(beta)
    below = max(b for b, (_, D) in seen.items() if D + classes.THRESHOLD > 0)
    above = min(b for b, (_, D) in seen.items() if D + classes.THRESHOLD <= 0)
    instant, value = seen[beta]
    return Critical(beta, min(0.5 * (above - below), tolerance * high), value, instant, len(seen))


def discretisation_error(scene_file: SceneFile, beta: float, *, width: float = 0.02) -> Discretisation:
    """Estimates the discretisation error of β₀ = `beta` by searching again with finer numerics.

    The search is limited to the relative interval `width` around `beta`.

    Raises:
        NoCriticalValue: β₀ is not in this interval, or a run broke down.
    """
    moved = []
    for other in finer(_alone(scene_file).scene_file):
        if other is None:
            raise NoCriticalValue("numerics.time_step, expected a tolerance, to make it finer")
        found = critical_field(other, ((1 - width) * beta, (1 + width) * beta))
        moved.append(abs(found.beta - beta))
    return Discretisation(*moved)


@eqx.filter_jit
def _pushed(case: Case, values, tangents, t_end, saves: int, march: AbstractMarch):
    def quantities(values):
        result = case.simulate(values, t_end=t_end, saves=saves, march=march)
        return {name: result.diagnostics[name][1:, 0] for name in QUANTITIES}, result.t[1:]

    _, slopes, t = jax.jvp(quantities, (values,), (tangents,), has_aux=True)
    return t, slopes


def slopes(
    scene_file: SceneFile,
    beta: float,
    t_end: float,
    *,
    saves: int = 8,
    names: Sequence[str] = NUMBERS,
    march: AbstractMarch | None = None,
) -> Slopes:
    """Returns the derivatives of the critical field with respect to `names`, by forward mode in runs at β₀ = `beta`.

    The values at late times are the derivatives: from the time of least D on. If the scene asks for relaxed vesicles,
    the relaxation is differentiated as well.
    """
    case = _alone(scene_file)
    scene_file = case.scene_file
    march = case.march(t_end, saves) if march is None else march
    case, values = with_traced_numbers(scene_file)
    values |= {"field.beta": as_float(beta)}

    def along(name):
        tangents = {other: as_float(other == name) for other in values}
        return _pushed(case, values, tangents, as_float(t_end), saves, march)

    t, by_beta = along("field.beta")
    ratios = {}
    for name in names:
        _, by_name = along(name)
        ratios[name] = {key: -np.asarray(by_name[key]) / np.asarray(by_beta[key]) for key in QUANTITIES}
    return Slopes(np.asarray(t), ratios, np.abs(np.asarray(by_beta[QUANTITIES[0]])))
