"""Runs one case of a sweep and reduces it to the values that the sweep keeps, as a pure function.

The time stepping is that of a run, from one saved time to the next. Everything happens in compiled code. Rows are
reduced as they are computed: to the last values of all diagnostics, their averages, and minima and maxima of some.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array

from ..base import status
from ..numerics.arrays import as_float
from ..observables import certificate, classes, diagnostics
from ..observables.rows import Row
from ..physics.scene import Scene
from ..runs.case import Case
from ..stepping.loop import initial_state, stops_of, to_save
from ..stepping.march import AbstractMarch
from ..stepping.state import Journey
from . import motions

# Diagnostics of which the minimum and the maximum over all saved times are kept.
EXTREMES = (
    "deformation",
    "deformation_along_field",
    "inclination_unwrapped",
    "tank_treading_speed",
    "bending_energy",
    "max_V_m",
    "tension_min",
    "tension_max",
    "spectral_tail",
    "self_gap",
    "min_gap",
    "effective_viscosity",
)
_AT_END = ("final", "average", "trend")  # last parts of the names of what only a case has that reached its end


class _Seen(eqx.Module):
    """The reduced values after some of the saved times; NaN before the first."""

    final: dict[str, Array]
    least: dict[str, Array]
    greatest: dict[str, Array]
    worst: dict[str, Array]  # maxima from which the certificate is computed
    classified: dict[str, Array] | None  # what classes follow from, at all saved times, (T, M) each
    turning: dict[str, Array] | None  # what the motion in shear follows from, at all saved times

    @classmethod
    def nothing(cls, row: Row, saves: int, kept: dict[str, Array], *, turning: bool) -> "_Seen":
        """Returns the values before the first of `saves` saved times.

        `row` is a row with all names, filled with NaN. `kept` is as in `with_row`. `turning` asks for
        the time series of the motion in shear.
        """
        names = row.diagnostics
        extremes = {name: names[name] for name in EXTREMES if name in names}
        worst = jax.tree.map(lambda leaf: jnp.full_like(leaf, jnp.nan), certificate.maxima(names, kept, jnp))

        def series(name):
            return jnp.full((saves, *names[name].shape), jnp.nan)

        classified = {name: series(name) for name in classes.DIAGNOSTICS if name in names} or None
        of_motion = {name: series(name) for name in motions.DIAGNOSTICS if name in names} if turning else None
        return cls(names, extremes, extremes, worst, classified, of_motion)

    def with_row(self, k: Array, row: Row, there: Array, kept: dict[str, Array]) -> "_Seen":
        """Returns the values with the row of saved time number k, if `there`. `kept` has the areas and perimeters."""
        found = row.diagnostics
        return _Seen(
            {name: jnp.where(there, found[name], old) for name, old in self.final.items()},
            {name: jnp.fmin(old, found[name]) for name, old in self.least.items()},
            {name: jnp.fmax(old, found[name]) for name, old in self.greatest.items()},
            jax.tree.map(jnp.fmax, self.worst, certificate.maxima(found, kept, jnp)),
            _with_row(self.classified, k, found),
            _with_row(self.turning, k, found),
        )


def _with_row(series: dict[str, Array] | None, k: Array, found: dict[str, Array]) -> dict[str, Array] | None:
    """Returns the time series with the values of saved time number k."""
    return None if series is None else {name: of.at[k].set(found[name]) for name, of in series.items()}


def outcome(case: Case, keep: tuple[str, ...], march: AbstractMarch, scene: Scene) -> dict[str, Array]:
    """Runs `scene`, whose numbers may be traced, and returns arrays by name. All settings are those of `case`.

    - `status` (a code), `t_reached`, `steps`, `rejected`;
    - with a field, `class` (M,), an index into `classes.NAMES`, and `deformation_trend` (M,), see `classes.trend`;
    - in a constant shear flow, `motions.series`;
    - `NAME_final` of every diagnostic, `NAME_average`, and `NAME_min` and `NAME_max` of some;
    - with `keep`, `history/NAME` (T, …), `history/x` and `history/V_m`.
    """
    scene_file, checks = case.scene_file, case.checks()
    scene, code = case.at_rest(scene)
    average = None if scene_file.average is None else as_float(scene_file.average)
    equation = case.equation(scene, integrands=diagnostics.integrands_of(scene, window=average is not None))
    wanted = None if scene_file.stop is None else scene_file.stop.class_
    stops = stops_of(scene, scene_file.t_end, average)
    state = initial_state(equation, march, average)
    state = eqx.tree_at(lambda s: s.status, state, jnp.where(code == status.RUNNING, state.status, code))
    times = scene_file.t_end * jnp.arange(scene_file.saves + 1) / scene_file.saves

    journey = march.begin(state, equation)

    def march_to(journey: Journey, t_save: Array):
        return to_save(journey, equation, march, t_save, jnp.append(stops, t_save), checks)

    nothing = jax.tree.map(
        lambda leaf: jnp.full(leaf.shape, jnp.nan, leaf.dtype), eqx.filter_eval_shape(march_to, journey, times[0])[1]
    )

    def to_next(carry, at):
        journey, seen = carry
        k, t_save = at
        # A run that has ended costs nothing more, unless this is batched.
        running = journey.state.status == status.RUNNING
        journey, row = lax.cond(running, march_to, lambda journey, _: (journey, nothing), journey, t_save)
        seen = seen.with_row(k, row, ~jnp.isnan(row.t), equation.kept())
        if wanted is not None:
            reached = (journey.state.status == status.RUNNING) & classes.has_reached(seen.classified, wanted)
            code = jnp.where(reached, status.CLASS_REACHED, journey.state.status)
            journey = eqx.tree_at(lambda j: j.state.status, journey, code)
        return (journey, seen), _kept(keep, row)

    seen = _Seen.nothing(nothing, len(times), equation.kept(), turning=motions.has_motion(scene_file))
    (journey, seen), history = lax.scan(to_next, (journey, seen), (jnp.arange(len(times)), times))

    state = journey.state
    code = jnp.where(state.status == status.RUNNING, status.COMPLETE, state.status)
    inaccurate = (code <= status.CLASS_REACHED) & certificate.is_inaccurate(seen.worst, jnp)
    out = {
        "status": jnp.where(inaccurate, status.INACCURATE, code),
        "t_reached": state.t,
        "steps": state.steps,
        "rejected": state.rejected,
    }
    out |= _classes(seen.classified, times)
    out |= motions.series(times, seen.turning, scene)
    out |= {f"{name}_final": value for name, value in seen.final.items()}
    means = {} if average is None else diagnostics.averages(state.window.means(), scene)
    kinds = {"average": means, "min": seen.least, "max": seen.greatest}
    out |= {f"{name}_{kind}": value for kind, found in kinds.items() for name, value in found.items()}
    return out | {f"history/{name}": value for name, value in history.items()}


def _classes(series: dict[str, Array] | None, times: Array) -> dict[str, Array]:
    """Returns the classes of the vesicles, and by how much D would still change, by name; {} without a field."""
    if series is None:
        return {}
    return {"class": classes.codes_of(series), "deformation_trend": classes.trend(series, times)}


def with_ends(found: dict[str, np.ndarray], useful: Sequence[bool]) -> dict[str, np.ndarray]:
    """Returns the arrays of several cases with NaN for values at the end of those that are not `useful`.

    Such a case did not reach its end; the numbers would be those of its breakdown.
    """
    ended, found = np.array(useful), dict(found)
    for name, values in found.items():
        if name.rpartition("_")[2] in _AT_END and "/" not in name:
            found[name] = np.where(ended.reshape(-1, *[1] * (values.ndim - 1)), values, np.nan)
    return found


def _kept(keep: tuple[str, ...], row: Row) -> dict[str, Array]:
    """Returns what is kept of one saved time, by name."""
    kept = {}
    if "history" in keep:
        kept |= row.diagnostics
    if "shapes" in keep:
        kept |= {"x": row.x, "tension": row.tension} | ({} if row.V_m is None else {"V_m": row.V_m})
    return kept
