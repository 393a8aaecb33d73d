"""The nodes with which a run begins, for `nodes = "auto"`, and the largest number that it may use.

Wrinkles are finest when a field or a flow is switched on. The most negative tension is known at t = 0 from one solution
of F. If it asks for more nodes than the starting curves (`adapt_nodes`), the run begins with as many. Fields and flows
that change in time are also evaluated, with the starting curves, at the instants at which they change, and at eight
instants of a period. A run may use up to twice the largest number of nodes that these tensions ask for, and at least
256, as far as the memory of the machine allows. All rows of a result file have this number of nodes.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base.resolution import USUAL_NODES, nodes_for_waves
from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..inputs.scene_tables import SceneFile
from ..numerics import fourier
from ..observables.rows import Row
from ..physics import membrane
from ..physics.scene import Scene
from ..stepping.state import State
from .adapt_nodes import Resolution, rebuilt, resolution_of
from .case import Case
from .problem import Problem, memory_of_machine, nodes_in_memory, problem_of, strengthened
from .programs import compiled
from .strength import STRONG, stress

_ROOM = 2.0  # the largest number of nodes, relative to what the compression at the start asks for
_MOST = 4096  # nodes of all vesicles together, if a vesicle has more than `USUAL_NODES`
_PHASES = 8  # instants in a period
_AFTER = 1e-9  # relative distance of an instant just after another


def first_row(case: Case, scene: Scene) -> tuple[Scene, Resolution, State, Row]:
    """Returns the scene with the nodes for its start, the nodes that a run may use, its state and row at t = 0."""
    file, most = case.scene_file, max(_MOST // scene.x.shape[0], USUAL_NODES)
    most = min(most, nodes_in_memory(scene, case.solved_by(scene)[1], memory_of_machine()))
    while True:
        problem = strengthened(problem_of(case, scene))
        N = scene.x.shape[1]
        resolution = resolution_of(file, problem, most)
        sizes = [K for K in resolution.sizes if N < K]
        wanted, ever = (0.0, 0.0) if len(resolution.sizes) == 1 else _asked(file, problem)
        if wanted <= N or not sizes:
            state, row = resolution.row(problem.state, 0.0)
            wanted = max(wanted, resolution.wanted(row)) if len(row.t) else wanted
            if wanted <= N or not sizes:
                break
        scene = _with_nodes(case, scene, next((K for K in sizes if wanted <= K), sizes[-1]))
    if len(resolution.sizes) > 1:
        resolution = resolution.up_to(min(_ROOM * max(ever, wanted), most))
    return scene, resolution, state, row


def _with_nodes(case: Case, scene: Scene, N: int) -> Scene:
    """Returns the scene with N nodes: from the file, or interpolated if the file does not have its curves."""
    from_file = rebuilt(case.scene_file, scene.x, N)
    if from_file is not None:
        return from_file
    finer = jax.tree.map(lambda f: fourier.resample(f, N, axis=1), (scene.x, scene.V_m))
    return eqx.tree_at(lambda s: (s.x, s.V_m), scene, finer, is_leaf=lambda leaf: leaf is None)


def _asked(file: SceneFile, problem: Problem) -> tuple[float, float]:
    """Returns the nodes that field and flow ask for until the first saved time, and in the whole run.

    Both are zero if field and flow are neither strong nor change in time. Then the first row tells.
    """
    scene = problem.equation.scene
    periods = [np.arange(1, _PHASES) / _PHASES * float(period) for period in scene.periods()]
    breaks = [part.breakpoints() for part in (scene.field, scene.flow) if part is not None]
    if not (stress(file) > STRONG or periods or sum(map(len, breaks))):
        return 0.0, 0.0
    stops = np.asarray(problem.stops)
    times = np.concatenate([np.zeros(1), stops, stops * (1 + _AFTER), *periods])
    waves = np.asarray(compiled(_waves)(problem.equation, problem.state.y, times))
    soon = np.max(waves, where=times < file.t_end / file.saves, initial=0.0)
    return nodes_for_waves(float(soon)), nodes_for_waves(float(waves.max()))


def _waves(equation: Equation, y: Unknowns, times: Float[Array, "T"]) -> Float[Array, "T"]:
    """Returns the largest number of waves of the fastest growing wrinkles at each of these times."""

    def at(t):
        motion = equation.motion(t, y)
        curves, bending = motion.surfaces.curves, equation.scene.bending
        tension = jax.vmap(membrane.physical_tension)(curves, motion.sigma, bending)
        return jnp.max(jax.vmap(membrane.fastest_wrinkle)(curves, tension, bending))

    return jax.lax.map(at, times)
