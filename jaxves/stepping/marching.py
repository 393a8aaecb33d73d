r"""`simulate`: runs a scene and returns a result with a status.

`simulate` is one pure function (jit, vmap, jvp, grad). Long runs call `advance` for a few saved times after the other,
with the state between the calls in a `State`.
"""

import dataclasses
import os

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base import status
from ..base.arguments import is_known, refusal, require, require_count, require_instants
from ..base.bounds import FINITE, POSITIVE
from ..equation.equation import Equation, equation_for
from ..equation.projection import Filter
from ..numerics.arrays import Status, as_float
from ..numerics.linear import AbstractSolver
from ..observables import certificate, diagnostics
from ..observables.checks import Checks
from ..observables.of_ones_own import Observables, observed, require_observables
from ..observables.rows import Row
from ..operators.interactions import AbstractCoupling
from ..physics.scene import Scene
from ..potentials.self_refined import Refinement
from ..results import saving
from ..results.views import Viewed
from .adaptive import Adaptive
from .loop import initial_state, stops_of
from .march import AbstractMarch
from .record import advance
from .state import State


class Result(Viewed, eqx.Module):
    """The result of a run. The first axis of arrays is the saved times (T,); rows after an early end are NaN.

    `scene` is the scene of the run. `scalars` are the scalars of the state besides V_m by name, (T, M, N) each. A
    notebook shows a card with a picture.
    """

    t: Float[Array, "T"]
    x: Float[Array, "T M N 2"]
    V_m: Float[Array, "T M N"] | None
    tension: Float[Array, "T M N"]
    diagnostics: dict[str, Array]
    averages: dict[str, Array] | None
    status: Int[Array, ""]
    state: State
    scene: Scene | None = None
    scalars: dict[str, Array] | None = None

    @property
    def word(self) -> str:
        """The status word (outside compiled code)."""
        return status.WORDS[int(self.status)]

    def rows(self) -> Row:
        """Returns everything that was saved, with the saved times as the first axis."""
        return Row(self.t, self.x, self.tension, self.diagnostics, self.V_m, scalars=self.scalars)

    def save(self, path: str | os.PathLike, *, force: bool = False) -> None:
        """Writes the result to a file like that of a run, which `jaxves.load` reads.

        A run can start from it (`jaxves.run(start=...)`), but cannot resume it. The scene is not in the file.

        Args:
            path: the file.
            force: replace the file if it exists.

        Raises:
            StoreError: the file exists (without `force`), or cannot be written.
        """
        field = None if self.scene is None else self.scene.field
        told = {} if field is None or not field.is_uniform() else {"direction": np.asarray(field.direction).tolist()}
        tables = {} if field is None else {"field": told | {"beta": float(field.beta)}}
        saving.save(self, path, scene=tables, averages=self.averages, force=force)

    def __repr__(self) -> str:
        single = is_known(self) and np.ndim(self.t) == 1
        return Viewed.__repr__(self) if single else eqx.Module.__repr__(self)


def simulate(
    scene: Scene,
    t_end=None,
    *,
    saves: int | None = None,
    times=None,
    march: AbstractMarch | None = None,
    average=None,
    checks: Checks | None = None,
    filter: Filter | None = None,
    solver: AbstractSolver | None = None,
    coupling: AbstractCoupling | None = None,
    refinement: Refinement | None = None,
    keep_symmetry: bool = True,
    observables: Observables | None = None,
) -> Result:
    """Runs a scene to `t_end` with equally spaced saved times, or to the last of the saved `times`.

    t = 0 is saved in both cases, as the first row of the result.

    The function is pure. It can be used under `jax.jit`, `jax.vmap`, `jax.jvp`, `jax.grad`, and combinations of them.
    It is jitted, and compiled once for scenes of the same structure. Use `jax.jit` for the caller as well to avoid
    dispatch overhead. After the end of a run that broke down, values are NaN and their derivatives zero; check the
    status. A call does not show how far it is, because it is one compiled program. `jaxves.run` has `progress`.

    Args:
        scene: the scene.
        t_end: the end of the run, in t_κ; not together with `times`.
        saves: number of saved times besides t = 0, 50 by default; not together with `times`.
        times: the saved times after t = 0, in t_κ, in increasing order, (K,). The run ends at the last of them.
        march: the method of choosing steps; `Adaptive()` by default.
        average: the window (start, end) of time averages.
        checks: limits for a valid result.
        filter: the modes that are removed; the default depends on the number of nodes.
        solver: solver for the charge of one membrane; the default depends on the number of nodes.
        coupling: interactions of several membranes; the default depends on their size.
        refinement: finer grids where a membrane comes close to itself; by default up to 8 times finer, with at most
            2048 nodes.
        keep_symmetry: whether a single vesicle that starts symmetric is kept symmetric.
        observables: functions of your own by name. Each gets a row (`Row`: t, x, V_m, tension, diagnostics of one saved
            time) and returns one number, or one for each vesicle. They are among the `diagnostics` of the result.

    Raises:
        ValueError: an argument has the wrong type, or a known value is out of its bounds. Traced values that are out of
            bounds end the run as `invalid`.
    """
    march = Adaptive() if march is None else march
    checks = Checks() if checks is None else checks
    _check_kinds(scene, march, checks)
    _check_times(t_end, saves, times)
    _check_average(average, t_end, times)
    average = None if average is None else as_float(average)
    saved = (as_float(t_end), 50 if saves is None else saves) if times is None else as_float(times)
    options = dict(filter=filter, solver=solver, coupling=coupling, refinement=refinement, keep_symmetry=keep_symmetry)
    arguments = scene, saved, march, average, checks, options
    _check_observables(observables, arguments)
    result = _simulated(*arguments)
    found = observed(observables, result.rows()) if observables else {}
    return dataclasses.replace(result, scene=scene, diagnostics=result.diagnostics | found)


def _check_kinds(scene, march, checks) -> None:
    kinds = {"scene": (scene, Scene), "march": (march, AbstractMarch), "checks": (checks, Checks)}
    for name, (value, kind) in kinds.items():
        if not isinstance(value, kind):
            raise refusal(name, value, f"a {kind.__name__.removeprefix('Abstract')}")


def _check_observables(observables: Observables | None, arguments: tuple) -> None:
    """Refuses functions that cannot be used, before anything is compiled."""
    require_observables(observables)
    if observables:
        eqx.filter_eval_shape(lambda *given: observed(observables, _simulated(*given).rows()), *arguments)


def _check_times(t_end, saves, times) -> None:
    if times is not None:
        for name, value in {"t_end": t_end, "saves": saves}.items():
            if value is not None:
                raise refusal(name, value, "no such argument together with times")
        require_instants("times", times)
        return
    if t_end is None:
        raise refusal("t_end", t_end, "the end of the run, or times instead")
    require("t_end", t_end, POSITIVE)
    if np.shape(t_end) != ():
        raise refusal("t_end", t_end, "one number")
    if saves is not None:
        require_count("saves", saves)


def _check_average(average, t_end, times) -> None:
    if average is None:
        return
    wanted = "two times (start, end) with 0 <= start < end <= " + ("t_end" if times is None else "the last of times")
    if np.shape(average) != (2,):
        raise refusal("average", average, wanted)
    require("average", average, FINITE)
    if not is_known(average):
        return
    begin, end = np.asarray(average)
    last = t_end if times is None else times
    if not 0 <= begin < end or (is_known(last) and end > np.max(np.asarray(last))):
        raise refusal("average", average, wanted)


@eqx.filter_jit
def _simulated(scene, saved, march, average, checks, options) -> Result:
    """Runs a scene. `saved` are the saved times (K,), or a pair of the end and the number of equally spaced ones."""
    integrands = diagnostics.integrands_of(scene, window=average is not None)
    equation = equation_for(scene, integrands=integrands, **options)
    state = initial_state(equation, march, average)
    if isinstance(saved, tuple):
        t_end, count = saved
        times, valid = t_end * jnp.arange(1, count + 1) / count, t_end > 0
    else:
        times, t_end, valid = saved, saved[-1], jnp.all(jnp.diff(saved, prepend=0.0) > 0)
    state = eqx.tree_at(lambda s: s.status, state, jnp.where(valid, state.status, status.INVALID))
    times = jnp.concatenate([state.t[None], times])
    state, rows = advance(equation, march, state, times, stops_of(scene, t_end, average), checks)
    code = jnp.where(state.status == status.RUNNING, status.COMPLETE, state.status)
    means = None if average is None else diagnostics.averages(state.window.means(), scene)
    code = jnp.where(code <= status.CLASS_REACHED, _judged(equation, rows.t, rows.diagnostics, code), code)
    found = rows.t, rows.x, rows.V_m, rows.tension, rows.diagnostics, means, jnp.int32(code), state
    return Result(*found, scalars=rows.scalars)


def _judged(equation: Equation, t: Float[Array, "T"], found: dict[str, Array], code: Status) -> Status:
    """Returns INACCURATE if a link of the certificate of the saved rows has less than one digit, otherwise `code`."""
    there = ~jnp.isnan(t)
    # Rows after an early end repeat the first, so that they say nothing.
    rows = jax.tree.map(lambda a: jnp.where(there.reshape(-1, *[1] * (a.ndim - 1)), a, a[:1]), found)
    greatest = certificate.maxima(rows, equation.kept(), jnp)
    return jnp.where(certificate.is_inaccurate(greatest, jnp), status.INACCURATE, code)
