"""Everything that time stepping needs, from a scene file: nodes, relaxed shapes, equation, time stepping, checks.

The large functions here are compiled as one program each. Compiling their many small operations one by one would take
longer than a short run.
"""

import os
import time
import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..base import status
from ..base.resolution import AUTO_NODES, nodes_for_modes, sizes_up_to
from ..equation.cells import coupling_of, domain_of
from ..equation.equation import Equation, equation_for
from ..equation.projection import Filter
from ..equation.state import Unknowns
from ..inputs.parameters import with_nodes
from ..inputs.scene_files import SceneError, parse
from ..inputs.scene_tables import SceneFile
from ..inputs.vesicle_tables import undulation_modes
from ..numerics import fourier
from ..numerics.arrays import VesiclePoints
from ..observables import diagnostics
from ..observables.checks import Checks
from ..operators.interactions import AbstractCoupling
from ..operators.memory import bytes_of_step
from ..physics.scene import Scene
from ..results import run_store
from ..results.hdf5 import StoreError
from ..stepping.loop import initial_state, stops_of
from ..stepping.march import AbstractMarch
from ..stepping.state import Journey, State
from . import rest
from .build import build
from .case import Case
from .programs import compiled

_MANY_NODES = 512
_RESOLVED = 1e-6  # largest spectral tail of a resolved starting curve, for `nodes = "auto"`


class NotRelaxed(Exception):
    """A vesicle with `relaxed = true` does not come to rest. `word` is the status of its relaxation."""

    def __init__(self, vesicle: int, word: str):
        super().__init__(f"vesicle {vesicle} did not relax to equilibrium: {word}")
        self.word = word


class Problem(eqx.Module):
    """Everything that time stepping needs, and the journey at t = 0."""

    equation: Equation
    march: AbstractMarch
    checks: Checks
    stops: Float[Array, "S"]  # instants at which steps must end
    journey: Journey

    @property
    def state(self) -> State:
        """The state at t = 0."""
        return self.journey.state

    def at(self, state: State) -> Journey:
        """Returns a journey that begins at `state`, which has the nodes of this problem."""
        journey = eqx.tree_at(lambda j: j.state, self.journey, state)
        return journey if journey.cache is None else eqx.tree_at(lambda j: j.cache.known, journey, jnp.array(False))


def starting_scene(scene_file: SceneFile) -> Scene:
    """Returns the scene of the file. For `nodes = "auto"` it has the fewest nodes that resolve all starting curves.

    They also keep all modes of the thermal undulations.
    """
    if scene_file.numerics.nodes != "auto":
        return build(scene_file)
    modes = max(undulation_modes(vesicle) for vesicle in scene_file.vesicles())
    least = nodes_for_modes(modes)
    sizes = [N for N in sizes_up_to(2 * least if modes else 0) if least <= N]
    finest = build(with_nodes(scene_file, sizes[-1]))
    for N in sizes[:-1]:
        if compiled(is_resolved)(finest.x, N):
            return build(with_nodes(scene_file, N))
    return finest


def is_resolved(x: VesiclePoints, N: int):
    """Returns whether N nodes resolve these curves, which are given with more nodes; may be traced."""

    def tail(x):
        return fourier.spectral_tail(fourier.resample(x, N, axis=0), Filter.for_nodes(N).x)

    return jnp.max(jax.vmap(tail)(x)) < _RESOLVED


def relaxed(case: Case, scene: Scene) -> Scene:
    """Returns the scene with relaxed vesicles where the file asks for it; raises NotRelaxed."""
    which = [vesicle.relaxed for vesicle in case.scene_file.vesicles()]
    scene, codes = awaited(rest.relaxed(scene, which))
    for m, code in zip(np.flatnonzero(which), codes, strict=True):
        if int(code) != status.COMPLETE:
            raise NotRelaxed(int(m), status.WORDS[int(code)])
    return scene


def problem_of(case: Case, scene: Scene) -> Problem:
    """Returns the problem for `scene`, which was built from the file of `case`; compiled as one program."""
    file = case.scene_file
    average = None if file.average is None else jnp.array(file.average)
    march = case.march()
    t_end = jnp.asarray(file.t_end, dtype=float)
    solved_by = case.solved_by(scene)
    require_memory(scene, solved_by[1], memory_of_machine())
    equation, stops, journey = compiled(_started)(scene, march, t_end, average, solved_by)
    return Problem(equation, march, case.checks(), stops, journey)


def _memory(scene: Scene, coupling: AbstractCoupling | None, N: int) -> int:
    parts = dict(electric=scene.field is not None, contrast=scene.viscosity_ratio is not None)
    return bytes_of_step(scene.x.shape[0], N, coupling_of(scene, coupling), domain_of(scene), **parts)


def nodes_in_memory(scene: Scene, coupling: AbstractCoupling | None, available: float) -> int:
    """Returns the largest number of `AUTO_NODES` with which a step of the scene needs at most `available` bytes.

    It is 0 if there is none.
    """
    return max((N for N in AUTO_NODES if _memory(scene, coupling, N) <= available), default=0)


def require_memory(scene: Scene, coupling: AbstractCoupling | None, available: float) -> None:
    """Raises SceneError if a step of the scene needs more memory than `available`, in bytes."""
    M, N, _ = scene.x.shape
    needed = _memory(scene, coupling, N)
    if needed > available:
        raise SceneError(
            f"numerics.nodes = {N} for {M} vesicles needs about {needed / 2**30:.3g} GiB of memory,"
            f" expected at most {available / 2**30:.3g} GiB, which this machine has: fewer nodes or vesicles"
        )


def memory_of_machine() -> float:
    """Returns the memory of this machine in bytes, or infinity where it is unknown or not that of a CPU."""
    known = hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names
    if not known or jax.default_backend() != "cpu":
        return float("inf")
    return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _started(scene: Scene, march: AbstractMarch, t_end, average, solved_by):
    solver, coupling = solved_by
    integrands = diagnostics.integrands_of(scene, window=average is not None)
    equation = equation_for(scene, solver=solver, coupling=coupling, integrands=integrands)
    state = initial_state(equation, march, average)
    return equation, stops_of(scene, t_end, average), begun(equation, march, state)


def begun(equation: Equation, march: AbstractMarch, state: State) -> Journey:
    """Returns a journey that begins at `state`. With many nodes it has no linear part, to save memory."""
    return march.begin(state, equation) if keeps_linear_part(state) else Journey(state)


def keeps_linear_part(state: State) -> bool:
    """Returns whether F and A at a saved time are kept for the step that follows, or are computed again.

    They take about fifteen matrices per vesicle, which is 0.5 GB for 2048 nodes.
    """
    return state.y.x.shape[1] < _MANY_NODES


def strengthened(tree):
    """Returns the same arrays without weak types, as they are after a step or in a file.

    JAX compiles a function again for weakly typed arguments, such as a zero that was a Python number.
    """
    return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)) if eqx.is_array(leaf) else leaf, tree)


def awaited(tree):
    """Waits until the arrays are computed, and returns them. Ctrl-C works here, but not inside compiled code."""
    while not all(leaf.is_ready() for leaf in jax.tree.leaves(tree) if eqx.is_array(leaf)):
        time.sleep(1e-3)
    return tree


def state_at(record, row: int) -> Unknowns:
    """Returns the state at a saved row of a result file or of a Python `Result`."""
    scalars = {name: jnp.asarray(values[row]) for name, values in (record.scalars or {}).items()}
    if record.V_m is not None and "W" not in scalars:  # V_m follows from Q and W, and is then no scalar of the state
        scalars["V_m"] = jnp.asarray(record.V_m[row])
    return Unknowns(jnp.asarray(record.x[row]), scalars)


def reconstructed(record: run_store.Record, t: float) -> tuple[Equation, float, Unknowns]:
    """Returns the equation of a result, the saved time nearest to t, and the state at this time.

    Raises:
        StoreError: the file was written by `Result.save`, and has no scene file.
    """
    if record.attributes.get("made_in") == "Python":
        raise StoreError("a file that `Result.save` wrote has no scene: use the result itself for what needs one.")
    scene_file = parse(tomllib.loads(record.scene))
    scene = build(scene_file)
    scene = eqx.tree_at(lambda s: s.x, scene, jnp.asarray(record.x[0]))
    row = int(np.argmin(np.abs(record.t - t)))
    solver, coupling = Case(scene_file).solved_by(scene)
    equation = compiled(equation_for)(scene, solver=solver, coupling=coupling)
    return equation, float(record.t[row]), state_at(record, row)
