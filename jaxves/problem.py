"""From a scene file to something that can be marched: nodes, relaxed shapes, equation, steps, checks.

The few large things here are compiled as one program each: run one by one, their hundred small operations
would take longer to compile than a short run takes.
"""

import math
import time
import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from . import curve, diagnostics, fourier, marching, status, steppers, store
from .arrays import NodePoints, Status, VesiclePoints
from .build import build
from .equation import Equation, Filter, equation_for
from .interactions import AbstractCoupling, Pairwise
from .linear import AbstractSolver, Dense
from .marching import AbstractMarch, Adaptive, Checks, Fixed, State
from .motion import Unknowns
from .scene import Scene
from .scenefile import parse
from .scenetables import SceneFile
from .summation import MatrixFree, coupling_for

_STEPPERS = {"ark4": steppers.ARK4, "ark5": steppers.ARK5, "euler": steppers.SemiImplicitEuler}
AUTO_NODES = (64, 96, 128, 192, 256)
_RESOLVED = 1e-6  # spectral tail of a starting curve, for `nodes = "auto"`
_REST = 1e-5  # how far a vesicle at rest moves in one t_κ, at most, in its own units; tolerance 1e-7 leaves 1e-6


class NotRelaxed(Exception):
    """A vesicle that is to be relaxed first does not come to rest; `word` says how that run ended."""

    def __init__(self, vesicle: int, word: str):
        super().__init__(f"vesicle {vesicle} did not relax to equilibrium: {word}")
        self.word = word


class Problem(eqx.Module):
    """What marching needs, and the state at t = 0."""

    equation: Equation
    march: AbstractMarch
    checks: Checks
    stops: Float[Array, "S"]  # instants at which steps must end
    state: State


def march_of(scene_file: SceneFile) -> AbstractMarch:
    """The way of stepping that `[numerics]` asks for."""
    numerics = scene_file.numerics
    if numerics.method == "auto":
        chosen = steppers.for_tolerance(numerics.tolerance, len(scene_file.vesicles()))
    else:
        chosen = _STEPPERS[numerics.method]()
    if numerics.time_step is None:
        return Adaptive(numerics.tolerance, chosen)
    steps = math.ceil(scene_file.t_end / scene_file.saves / numerics.time_step * (1 - 1e-12))
    return Fixed(steps, chosen)


def solved_by(scene_file: SceneFile, scene: Scene) -> tuple[AbstractSolver | None, AbstractCoupling | None]:
    """The solver of one membrane's charge and the coupling of several that `[numerics]` asks for."""
    numerics = scene_file.numerics
    M, N, _ = scene.x.shape
    match numerics.solver:
        case "dense":
            return Dense(), Pairwise(direct=True)
        case "matrix-free":
            return None, MatrixFree(numerics.neighbours)
    return None, coupling_for(M, N, numerics.neighbours)


def starting_scene(scene_file: SceneFile) -> Scene:
    """The scene as the file describes it; `nodes = "auto"` becomes the fewest that resolve all starting curves."""
    if scene_file.numerics.nodes != "auto":
        return build(scene_file)
    finest = build(with_nodes(scene_file, AUTO_NODES[-1]))
    for N in AUTO_NODES[:-1]:
        if is_resolved(finest.x, N):
            return build(with_nodes(scene_file, N))
    return finest


def with_nodes(scene_file: SceneFile, N: int) -> SceneFile:
    """The same scene with this number of nodes."""
    return scene_file.model_copy(update={"numerics": scene_file.numerics.model_copy(update={"nodes": N})})


@eqx.filter_jit
def is_resolved(x: VesiclePoints, N: int):
    """Whether N nodes resolve these curves, given with more; may be traced."""

    def tail(x):
        return fourier.spectral_tail(fourier.resample(x, N, axis=0), Filter.for_nodes(N).x)

    return jnp.max(jax.vmap(tail)(x)) < _RESOLVED


@eqx.filter_jit
def at_rest(x: NodePoints) -> tuple[NodePoints, Status]:
    """A vesicle at equilibrium, without field or flow, in its place and direction; COMPLETE, or what keeps it from it.

    Pure: may be traced.
    """
    # The shape at rest depends on neither size nor κ_B: relax it in its own units, and as fast as any other.
    outline = curve.Curve.from_nodes(x)
    center, size = curve.centroid(outline), curve.length(outline) / (2 * np.pi)
    # Deviations fall by e^-12 in one t_κ when nearly round, by e^-1.3 at Δ = 0.25.
    start = Scene((x[None] - center) / size, jnp.ones(1))
    result = marching.simulate(start, 20.0, saves=20, march=Adaptive(1e-7))
    # Its computed velocity is no measure of rest: few nodes leave one that projecting takes back.
    moving = jnp.max(jnp.abs(result.x[-1] - result.x[-2])) > _REST
    code = jnp.where((result.status == status.COMPLETE) & moving, status.TOO_MANY_STEPS, result.status)
    return center + size * result.state.y.x[0], code


def relaxed(scene: Scene, which: list[bool]) -> Scene:
    """The scene with these vesicles at rest, each by itself; raises NotRelaxed."""
    x = scene.x
    for m in np.flatnonzero(which):
        rest, code = awaited(at_rest(x[m]))
        if int(code) != status.COMPLETE:
            raise NotRelaxed(int(m), status.WORDS[int(code)])
        x = x.at[m].set(rest)
    return eqx.tree_at(lambda s: s.x, scene, x)


def problem_of(scene_file: SceneFile, scene: Scene) -> Problem:
    """What `scene`, built from `scene_file`, needs to be marched; compiled as one program."""
    average = None if scene_file.average is None else jnp.array(scene_file.average)
    march = march_of(scene_file)
    steady = None if scene_file.stop is None or scene_file.stop.steady is None else jnp.asarray(scene_file.stop.steady)
    t_end = jnp.asarray(scene_file.t_end, dtype=float)
    equation, stops, state = _started(scene, march, t_end, average, solved_by(scene_file, scene))
    return Problem(equation, march, Checks(steady=steady), stops, state)


@eqx.filter_jit
def _started(scene: Scene, march: AbstractMarch, t_end, average, solved_by):
    solver, coupling = solved_by
    integrands = None if average is None else diagnostics.averaged
    equation = equation_for(scene, solver=solver, coupling=coupling, integrands=integrands)
    return equation, marching.stops_of(scene, t_end, average), marching.initial_state(equation, march, average)


def strengthened(tree):
    """Arrays of the same values whose types no longer bend to others', as they come back from a step or a file.

    JAX compiles anew for weakly typed arguments, such as a zero that stems from a Python number.
    """
    return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf)) if eqx.is_array(leaf) else leaf, tree)


def awaited(tree):
    """The same arrays, computed; waits where Ctrl-C is heard, which it is not inside compiled code."""
    while not all(leaf.is_ready() for leaf in jax.tree.leaves(tree) if eqx.is_array(leaf)):
        time.sleep(1e-3)
    return tree


def reconstructed(record: store.Record, t: float) -> tuple[Equation, float, Unknowns]:
    """The equation of a result, and its state at the saved time nearest to t."""
    scene_file = parse(tomllib.loads(record.scene))
    scene = build(scene_file)
    scene = eqx.tree_at(lambda s: s.x, scene, jnp.asarray(record.x[0]))
    row = int(np.argmin(np.abs(record.t - t)))
    V_m = None if record.V_m is None else jnp.asarray(record.V_m[row])
    solver, coupling = solved_by(scene_file, scene)
    return (
        _equation(scene, solver=solver, coupling=coupling),
        float(record.t[row]),
        Unknowns(jnp.asarray(record.x[row]), V_m),
    )


_equation = eqx.filter_jit(equation_for)
