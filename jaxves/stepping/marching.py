r"""Marching in time: what is saved at given instants, and an explicit end.

`simulate` is one pure function (jit, vmap, jvp, grad). Long runs call `advance` on one stretch of saved times after
the other, with everything between in a `State`.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from ..base import status
from ..base.arguments import is_known, refusal, require, require_count
from ..base.bounds import FINITE, POSITIVE
from ..equation.equation import Equation, Filter, equation_for
from ..equation.state import Unknowns, verdict
from ..geometry.curve import Curve
from ..numerics.arrays import PerVesicle, Scalar, Status, as_float
from ..numerics.linear import AbstractSolver
from ..observables import certificate, diagnostics
from ..observables.certificate import Link
from ..operators.interactions import AbstractCoupling
from ..physics import membrane
from ..physics.scene import Scene
from ..potentials import self_refined
from . import replay
from .control import ROUGH, AbstractMarch, Adaptive, Fixed, Journey, State, Tape, Window, initial_state, turned

__all__ = [
    "AbstractMarch",
    "Adaptive",
    "Checks",
    "Fixed",
    "Result",
    "State",
    "Window",
    "advance",
    "initial_state",
    "observe",
    "simulate",
    "stops_of",
]


class Result(eqx.Module):
    """Saved instants (T,), states and diagnostics; rows after an early end hold NaN."""

    t: Float[Array, "T"]
    x: Float[Array, "T M N 2"]
    V_m: Float[Array, "T M N"] | None
    tension: Float[Array, "T M N"]
    diagnostics: dict[str, Array]
    averages: dict[str, Array] | None
    status: Int[Array, ""]
    state: State

    @property
    def word(self) -> str:
        """The status in a word (outside compiled code)."""
        return status.WORDS[int(self.status)]

    @property
    def certificate(self) -> dict[str, Link]:
        """How far each known property is from holding, by name, at worst over the saved rows (outside compiled code).

        The error of the whole run is not among them: that takes a second run, which `jaxves.run` makes.
        """
        there = ~np.isnan(np.asarray(self.t))
        return certificate.certificate({name: np.asarray(value)[there] for name, value in self.diagnostics.items()})

    @property
    def digits(self) -> float:
        """Correct digits by the weakest link of the certificate (outside compiled code)."""
        links = self.certificate
        return links[certificate.weakest(links)].digits


def observe(
    equation: Equation, t: Scalar, y: Unknowns, angle: PerVesicle, time_error: Scalar | None
) -> dict[str, Array]:
    """What is saved of one instant, flat, by the names of the result file."""
    motion = equation.motion(t, y)
    tension = jax.vmap(membrane.physical_tension)(motion.surfaces.curves, motion.sigma, equation.scene.bending)
    out = {"t": t, "x": y.x, "tension": tension}
    if y.V_m is not None:
        out["V_m"] = y.V_m
    found = diagnostics.diagnose(equation, t, y, motion)
    found["inclination_unwrapped"] = turned(angle, found["inclination"])
    if time_error is not None:
        found["time_error"] = time_error
    return out | {f"diagnostics/{name}": value for name, value in found.items()}


class Checks(eqx.Module):
    """Limits beyond which a result is no result. `steady`: the speed below which a run may end.

    `film`: of the estimated relative error of the drainage of a film thinner than the node spacing.
    """

    tail: float = eqx.field(static=True, default=ROUGH)
    film: float = eqx.field(static=True, default=0.1)
    drift: float = eqx.field(static=True, default=1e-2)
    steady: Scalar | None = None

    def judge(self, equation: Equation, t: Scalar, y: Unknowns, row: dict[str, Array]) -> Status:
        """The status that one saved instant calls for."""
        code = jnp.int32(status.RUNNING)
        if self.steady is not None:
            motion = equation.motion(t, y)
            still = _speed_of_shape(motion, y) < self.steady
            code = jnp.where(still & (t > 0), status.STEADY, code)
        unresolved = jnp.max(row["diagnostics/spectral_tail"]) > self.tail
        # A neck or fold finer than the kernels of a membrane on itself can follow.
        spacing = 2 * np.pi * equation.speed / y.x.shape[1]
        pinched = jnp.any(row["diagnostics/self_gap"] < self_refined.RESOLVED * spacing)
        code = jnp.where(unresolved | pinched, status.UNRESOLVED, code)
        area = jnp.max(jnp.abs(row["diagnostics/area"] / equation.area - 1))
        length = jnp.max(jnp.abs(row["diagnostics/length"] / (2 * np.pi * equation.speed) - 1))
        code = jnp.where(jnp.maximum(area, length) > self.drift, status.DRIFT, code)
        solved = verdict(row["diagnostics/residual"])
        code = jnp.where(solved == status.RUNNING, code, solved)
        crossed = jnp.any(jax.vmap(lambda x: diagnostics.crosses_itself(Curve.from_nodes(x)))(y.x))
        code = jnp.where(crossed, status.SELF_CONTACT, code)
        if y.x.shape[0] > 1:
            curves = jax.vmap(Curve.from_nodes)(y.x)
            thin = row["diagnostics/min_gap"] < jnp.max(jax.vmap(lambda curve: curve.weights)(curves))
            unresolved = thin & (row["diagnostics/film_error"] > self.film)
            code = jnp.where((code < status.UNRESOLVED) & unresolved, status.UNRESOLVED, code)
            collided = diagnostics.collides(curves)
            code = jnp.where(collided, status.COLLISION, code)
        finite = jnp.all(jnp.isfinite(row["x"])) & jnp.all(jnp.isfinite(row["tension"]))
        return jnp.where(finite, code, status.NOT_FINITE)


def _speed_of_shape(motion, y: Unknowns) -> Scalar:
    """How fast shape and potential change at fixed places on the outline; tank-treading alone gives zero."""
    curves = motion.surfaces.curves
    weights = curves.weights[..., None] / jnp.sum(curves.weights, axis=1)[:, None, None]
    relative = motion.velocity - jnp.sum(weights * motion.velocity, axis=1, keepdims=True)
    speed = jnp.max(jnp.abs(jnp.sum(relative * curves.normal, axis=-1)))
    if y.V_m is None:
        return speed
    carried = jnp.sum(relative * curves.tangent, axis=-1) * motion.surfaces.d_ds(y.V_m)
    return jnp.maximum(speed, jnp.max(jnp.abs(motion.V_rate - carried)))


def advance(
    equation: Equation,
    march: AbstractMarch,
    state: State,
    times: Float[Array, "K"],
    stops: Float[Array, "S"],
    checks: Checks,
) -> tuple[State, dict[str, Array]]:
    """Marches over the saved instants `times`; returns the state and what was saved, (K, ...).

    Rows after the end of a run are NaN. `stops` are instants at which steps must end.
    """
    run = _marched if march.recorded is None else _differentiable
    return run(equation, march, state, times, stops, checks)


def _marched(equation, march, state, times, stops, checks):
    journey, rows, _ = _travelled(march.begin(state, equation), equation, march, times, stops, checks)
    return journey.state, rows


def _travelled(journey: Journey, equation, march, times, stops, checks):
    """The journey after the last of `times`, the rows, and the number of steps recorded before each, (K,)."""
    stops = jnp.concatenate([stops, times])

    def to_save(journey, t_save):
        ended = journey.state.status != status.RUNNING
        journey = march.to(t_save, journey, equation, stops)
        state = journey.state
        # Reverse mode makes what is observed anew, rather than keep all that it was made of.
        row = eqx.filter_checkpoint(observe)(equation, state.t, state.y, state.angle, state.time_error)
        code = checks.judge(equation, state.t, state.y, row)
        # What ended the run stands; but vesicles no longer resolved may be found to have drifted or crossed.
        found = jnp.where(state.status == status.UNRESOLVED, jnp.maximum(code, state.status), state.status)
        code = jnp.where(state.status == status.RUNNING, code, found)
        broken = ended | (state.t < t_save)
        row = jax.tree.map(lambda leaf: jnp.where(broken, jnp.nan, leaf), row)
        journey = eqx.tree_at(lambda j: j.state.status, journey, jnp.int32(code))
        return journey, (row, None if journey.tape is None else journey.tape.count)

    journey, (rows, counts) = lax.scan(to_save, journey, times)
    return journey, rows, counts


@eqx.filter_custom_jvp
def _differentiable(equation, march, state, times, stops, checks):
    return _marched(equation, march, state, times, stops, checks)


@_differentiable.def_jvp
def _differentiable_jvp(primals, tangents):
    (*out, _, _), (*d_out, _, _) = eqx.filter_jvp(_recorded, primals, tangents)
    return tuple(out), tuple(d_out)


@eqx.filter_custom_jvp
def _recorded(equation, march, state, times, stops, checks):
    """As `advance`; also the tape, and how many steps of it lie before each row."""
    journey = march.begin(state, equation)
    journey = eqx.tree_at(
        lambda j: j.tape, journey, Tape.blank(state.t, state.y, march.recorded), is_leaf=lambda leaf: leaf is None
    )
    journey, rows, counts = _travelled(journey, equation, march, times, stops, checks)
    return journey.state, rows, journey.tape, counts


@_recorded.def_jvp
def _recorded_jvp(primals, tangents):
    equation, march, start, times, stops, _ = primals
    d_equation, _, d_start, d_times, d_stops, _ = tangents
    state, rows, tape, counts = _recorded(*primals)
    d_stops = jnp.concatenate([replay.filled(stops, d_stops), replay.filled(times, d_times)])
    d_start = replay.filled(start, d_start)
    d_tape = replay.along(march, equation, d_equation, tape, d_stops, d_start)

    def row(equation, t, y):
        # Neither which turn it is, nor the estimated error, has a derivative.
        return observe(equation, t, y, jnp.zeros_like(start.angle), start.time_error)

    d_rows = replay.of_each(row, equation, d_equation, tape, d_tape, counts)
    d_rows = jax.tree.map(lambda row, d: jnp.where(jnp.isnan(row), 0.0, d), rows, replay.filled(rows, d_rows))
    d_state = replay.of_state(state, start, d_start, tape, d_tape)
    return (state, rows, tape, counts), (d_state, d_rows, d_tape, None)


def stops_of(scene: Scene, t_end, average=None) -> Float[Array, "S"]:
    """Instants at which steps must end: kinks of the field's history, ends of the averaging window."""
    stops = [jnp.reshape(as_float(t_end), (1,))]
    if scene.field is not None and scene.field.history is not None:
        stops.append(scene.field.history.breakpoints())
    if average is not None:
        stops.append(as_float(average))
    return jnp.concatenate(stops)


def simulate(
    scene: Scene,
    t_end,
    *,
    saves: int = 50,
    march: AbstractMarch | None = None,
    average=None,
    checks: Checks | None = None,
    filter: Filter | None = None,
    solver: AbstractSolver | None = None,
    coupling: AbstractCoupling | None = None,
) -> Result:
    """Runs a scene to `t_end`, saving at `saves` equally spaced instants besides t = 0.

    Pure: use it under `jax.jit`, `jax.vmap`, `jax.jvp`, `jax.grad`, and combinations of them. It is compiled once for
    scenes of the same structure; `jax.jit` around the caller saves more. Where a run broke down, values are NaN and
    their derivatives zero, so look at the status.

    Args:
        scene: what is simulated.
        t_end: when it ends, in t_κ.
        saves: number of saved instants besides t = 0.
        march: how steps are chosen; `Adaptive()` where it is not given.
        average: a window (start, end) of time averages.
        checks: limits beyond which a result is no result.
        filter: modes that are removed; by the number of nodes where it is not given.
        solver: of one membrane's charge; by size where it is not given.
        coupling: of several membranes; by size where it is not given.

    Raises:
        ValueError: an argument of the wrong kind, or a known value out of its bounds. Traced values that are out of
            theirs end the run as `invalid`.
    """
    march = Adaptive() if march is None else march
    checks = Checks() if checks is None else checks
    _check_arguments(scene, t_end, saves, march, average, checks)
    average = None if average is None else as_float(average)
    return _simulated(scene, as_float(t_end), saves, march, average, checks, filter, solver, coupling)


def _check_arguments(scene, t_end, saves, march, average, checks) -> None:
    kinds = {"scene": (scene, Scene), "march": (march, AbstractMarch), "checks": (checks, Checks)}
    for name, (value, kind) in kinds.items():
        if not isinstance(value, kind):
            raise refusal(name, value, f"a {kind.__name__.removeprefix('Abstract')}")
    require("t_end", t_end, POSITIVE)
    if np.shape(t_end) != ():
        raise refusal("t_end", t_end, "one number")
    require_count("saves", saves)
    if average is None:
        return
    wanted = "two times (start, end) with 0 <= start < end <= t_end"
    if np.shape(average) != (2,):
        raise refusal("average", average, wanted)
    require("average", average, FINITE)
    if not is_known(average):
        return
    begin, end = np.asarray(average)
    if not 0 <= begin < end or (is_known(t_end) and end > np.asarray(t_end)):
        raise refusal("average", average, wanted)


@eqx.filter_jit
def _simulated(scene, t_end, saves, march, average, checks, filter, solver, coupling) -> Result:
    integrands = None if average is None else diagnostics.averaged
    equation = equation_for(scene, filter=filter, solver=solver, coupling=coupling, integrands=integrands)
    state = initial_state(equation, march, average)
    first = observe(equation, state.t, state.y, state.angle, state.time_error)
    code = jnp.maximum(checks.judge(equation, state.t, state.y, first), state.status)
    state = eqx.tree_at(lambda s: s.status, state, jnp.where(t_end > 0, code, status.INVALID))
    times = t_end * jnp.arange(1, saves + 1) / saves
    state, rows = advance(equation, march, state, times, stops_of(scene, t_end, average), checks)
    rows = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, rows)
    code = jnp.where(state.status == status.RUNNING, status.COMPLETE, state.status)
    found = {name.removeprefix("diagnostics/"): rows[name] for name in rows if name.startswith("diagnostics/")}
    means = None if average is None else diagnostics.averages(state.window.means(), scene)
    code = jnp.where(code <= status.CLASS_REACHED, _judged(equation, rows["t"], found, code), code)
    return Result(rows["t"], rows["x"], rows.get("V_m"), rows["tension"], found, means, jnp.int32(code), state)


def _judged(equation: Equation, t: Float[Array, "T"], found: dict[str, Array], code: Status) -> Status:
    """INACCURATE where the rows that were saved say so, else `code`."""
    there = ~jnp.isnan(t)
    # Rows after an early end repeat the first, so that they say nothing.
    rows = jax.tree.map(lambda a: jnp.where(there.reshape(-1, *[1] * (a.ndim - 1)), a, a[:1]), found)
    greatest = certificate.maxima(rows, equation.kept(), jnp)
    return jnp.where(certificate.is_inaccurate(greatest, jnp), status.INACCURATE, code)
