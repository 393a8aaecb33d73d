"""The nodes with which a run begins, for `nodes = "auto"`, and the largest number that it may use.

Wrinkles are finest when a field or a flow is switched on. The most negative tension is known at t = 0 from one solution
of F. If it asks for more nodes than the starting curves (`adapt_nodes`), the run begins with as many. Fields and flows
that change in time are also evaluated, with the starting curves, at the instants at which they change, and at eight
instants of a period. A run may use up to twice the largest number of nodes that these tensions ask for, and at least
256. All rows of a result file have this number of nodes.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.resolution import USUAL_NODES, nodes_for_waves
from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..numerics import fourier
from ..observables.rows import Row
from ..physics import membrane
from ..physics.scene import Scene
from ..stepping.state import State
from .adapt_nodes import Resolution, rebuilt, resolution_of
from .case import Case
from .problem import Problem, problem_of, strengthened
from .programs import compiled

_ROOM = 2.0  # the largest number of nodes, relative to what the compression at the start asks for
_MOST = 4096  # nodes of all vesicles together, if a vesicle has more than `USUAL_NODES`
_PHASES = 8  # instants in a period
_AFTER = 1e-9  # relative distance of an instant just after another


def first_row(case: Case, scene: Scene) -> tuple[Scene, Resolution, State, Row]:
    """Returns the scene with the nodes for its start, the nodes that a run may use, its state and row at t = 0."""
    file, most = case.scene_file, max(_MOST // scene.x.shape[0], USUAL_NODES)
    while True:
        problem = strengthened(problem_of(case, scene))
        N = scene.x.shape[1]
        resolution = resolution_of(file, problem, most)
        state, row = resolution.row(problem.state, 0.0)
        if len(resolution.sizes) == 1:
            return scene, resolution, state, row
        soon, ever = _asked(problem, file.t_end / file.saves)
        wanted = resolution.wanted(row) if len(row.t) else 0.0
        sizes = [K for K in resolution.sizes if N < K]
        if max(soon, wanted) <= N or not sizes:
            return scene, resolution.up_to(min(_ROOM * max(ever, wanted), most)), state, row
        scene = _with_nodes(case, scene, next((K for K in sizes if max(soon, wanted) <= K), sizes[-1]))


def _with_nodes(case: Case, scene: Scene, N: int) -> Scene:
    """Returns the scene with N nodes: from the file, or interpolated if the file does not have its curves."""
    from_file = rebuilt(case.scene_file, scene.x, N)
    if from_file is not None:
        return from_file
    finer = jax.tree.map(lambda f: fourier.resample(f, N, axis=1), (scene.x, scene.V_m))
    return eqx.tree_at(lambda s: (s.x, s.V_m), scene, finer, is_leaf=lambda leaf: leaf is None)


def _asked(problem: Problem, first: float) -> tuple[float, float]:
    """Returns the nodes that changes of field and flow ask for until the `first` saved time, and in the whole run."""
    scene = problem.equation.scene
    periods = [np.arange(1, _PHASES) / _PHASES * float(period) for period in scene.periods()]
    breaks = [part.breakpoints() for part in (scene.field and scene.field.history, scene.flow) if part is not None]
    if not periods and not sum(map(len, breaks)):
        return 0.0, 0.0
    stops = np.asarray(problem.stops)
    times = np.concatenate([stops, stops * (1 + _AFTER), *periods])
    waves = np.asarray(compiled(_waves)(problem.equation, problem.state.y, times))
    return nodes_for_waves(float(np.max(waves, where=times < first, initial=0.0))), nodes_for_waves(float(waves.max()))


def _waves(equation: Equation, y: Unknowns, times: Float[Array, "T"]) -> Float[Array, "T"]:
    """Returns the largest number of waves of the fastest growing wrinkles at each of these times."""

    def at(t):
        motion = equation.motion(t, y)
        curves, bending = motion.surfaces.curves, equation.scene.bending
        tension = jax.vmap(membrane.physical_tension)(curves, motion.sigma, bending)
        return jnp.max(jax.vmap(membrane.fastest_wrinkle)(curves, tension, bending))

    return jax.lax.map(at, times)
