"""A run as users start it: from a scene file to a result file, in stretches, with progress and a restart.

Compiled code marches over one stretch of saved times; between stretches Python writes the file, shows
progress, and can be interrupted. A run continued from its file repeats the same stretches with the same
compiled code, so its bits are those of an uninterrupted run (same machine, same jaxlib).
"""

import math
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from . import diagnostics, phases, simulate, status, steppers, store
from .arrays import VesiclePoints
from .build import build
from .equation import Equation, Unknowns, equation_for
from .scene import Scene
from .scenefile import parse, to_toml
from .scenetables import SceneFile
from .simulate import AbstractMarch, Adaptive, Checks, Fixed, State

_STEPPERS = {"ark4": steppers.ARK4, "ark5": steppers.ARK5, "euler": steppers.SemiImplicitEuler}
_STRETCH = 20  # saved times per stretch, at most

Progress = Callable[[float, str], None]  # time reached, what to say of it


def march_of(scene_file: SceneFile) -> AbstractMarch:
    """The way of stepping that `[numerics]` asks for."""
    numerics = scene_file.numerics
    stepper = _STEPPERS[numerics.method]()
    if numerics.time_step is None:
        return Adaptive(numerics.tolerance, stepper)
    steps = math.ceil(scene_file.t_end / scene_file.saves / numerics.time_step * (1 - 1e-12))
    return Fixed(steps, stepper)


def relax(x: VesiclePoints, bending) -> VesiclePoints:
    """Equilibrium of each vesicle by itself, without field or flow, in its place and direction.

    Raises RuntimeError when a vesicle has not come to rest by t = 200 t_κ.
    """

    @eqx.filter_jit
    def alone(x, bending):
        return simulate.simulate(
            Scene(x[None], bending[None]), 200.0, saves=40, march=Adaptive(1e-7), checks=Checks(steady=1e-8)
        )

    relaxed = []
    for m in range(x.shape[0]):
        result = alone(x[m], bending[m])
        if int(result.status) != status.STEADY:
            raise RuntimeError(f"vesicle {m} did not relax to equilibrium: {result.word}.")
        relaxed.append(result.state.y.x[0])
    return jnp.stack(relaxed)


@eqx.filter_jit
def _begin(equation: Equation, march: AbstractMarch, average):
    state = simulate.initial_state(equation, march, average)
    return state, simulate.observe(equation, state.t, state.y, state.angle)


@eqx.filter_jit
def _stretch(equation, march, state, times, stops, checks):
    return simulate.advance(equation, march, state, times, stops, checks)


def _restart_leaves(state: State) -> dict[str, np.ndarray]:
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves}


def _restored(template: State, leaves: dict[str, np.ndarray]) -> State:
    paths, structure = jax.tree_util.tree_flatten_with_path(template)
    names = [jax.tree_util.keystr(path, simple=True, separator="/") for path, _ in paths]
    return jax.tree_util.tree_unflatten(structure, [jnp.asarray(leaves[name]) for name in names])


def _description(name: str) -> store.Description:
    if name in store.HISTORY:
        return store.HISTORY[name]
    return store.Description(*diagnostics.QUANTITIES[name.removeprefix("diagnostics/")])


def _reached(scene_file: SceneFile, deformation: list[np.ndarray]) -> bool:
    wanted = scene_file.stop.class_ if scene_file.stop is not None else None
    if wanted is None:
        return False
    found = phases.classify(jnp.concatenate([jnp.asarray(block) for block in deformation]))
    return all(phases.NAMES[int(code)] == wanted for code in found)


def reconstructed(record: store.Record, t: float) -> tuple[Equation, float, Unknowns]:
    """The equation of a result, and its state at the saved time nearest to t."""
    scene_file = parse(tomllib.loads(record.scene))
    scene = eqx.tree_at(lambda s: s.x, build(scene_file), jnp.asarray(record.x[0]))
    row = int(np.argmin(np.abs(record.t - t)))
    V_m = None if record.V_m is None else jnp.asarray(record.V_m[row])
    return equation_for(scene), float(record.t[row]), Unknowns(jnp.asarray(record.x[row]), V_m)


def run(
    scene_file: SceneFile,
    path: str | Path,
    *,
    force: bool = False,
    resume: bool = False,
    progress: Progress = lambda t, text: None,
) -> str:
    """Runs a scene file into a result file; returns the status word. Ctrl-C ends it as "interrupted".

    Raises:
        store.StoreError: the file exists (without `force`), cannot be written, or cannot be resumed.
        RuntimeError: a vesicle that is to be relaxed does not come to rest.
    """
    began = time.perf_counter()
    scene = build(scene_file)
    wanted = jnp.array([vesicle.relaxed for vesicle in scene_file.vesicles])
    if wanted.any():
        progress(0.0, "relaxing")
        relaxed = jnp.where(wanted[:, None, None], relax(scene.x, scene.bending), scene.x)
        scene = eqx.tree_at(lambda s: s.x, scene, relaxed)
    average = None if scene_file.average is None else jnp.array(scene_file.average)
    equation = equation_for(scene, integrands=None if average is None else diagnostics.averaged)
    march = march_of(scene_file)
    steady = None if scene_file.stop is None or scene_file.stop.steady is None else jnp.asarray(scene_file.stop.steady)
    checks = Checks(steady=steady)
    saves = scene_file.saves
    times = scene_file.t_end * np.arange(1, saves + 1) / saves
    stops = simulate.stops_of(scene, scene_file.t_end, average)
    # Stretches of one length compile once: the largest divisor will do.
    stretch = max(k for k in range(1, _STRETCH + 1) if saves % k == 0)

    progress(0.0, "compiling")
    state, first = _begin(equation, march, average)
    first["nodes"] = jnp.full(scene.x.shape[0], scene.x.shape[1])
    text = to_toml(scene_file)
    if resume:
        writer, leaves = store.resume(path)
        if store.load(path).scene != text:
            writer.close()
            raise store.StoreError(f"{path} holds another scene: it can be resumed only with its own.")
        state = _restored(state, leaves)
        state = eqx.tree_at(lambda s: s.status, state, jnp.int32(status.RUNNING))
    else:
        datasets = {name: _description(name) for name in first}
        M, N = scene.x.shape[:2]
        attributes = {"device": str(jax.devices()[0]), "method": type(march.stepper).__name__}
        writer = store.Writer(
            path, scene_text=text, attributes=attributes, saves=saves + 1, vesicles=M, nodes=N, datasets=datasets,
            force=force,
        )  # fmt: skip
    with writer:
        if not resume:
            writer.append({name: np.asarray(value)[None] for name, value in first.items()}, _restart_leaves(state))
        seen = [np.asarray(first["diagnostics/deformation_along_field"])[None]] if scene.field is not None else []
        code = status.RUNNING
        try:
            while code == status.RUNNING and writer.saved <= saves:
                block = times[writer.saved - 1 : writer.saved - 1 + stretch]
                state, rows = _stretch(equation, march, state, jnp.asarray(block), stops, checks)
                rows = {name: np.asarray(value) for name, value in rows.items()}
                valid = int(np.sum(~np.isnan(rows["t"])))
                rows["nodes"] = np.full((stretch, scene.x.shape[0]), scene.x.shape[1])
                if valid:
                    writer.append({name: value[:valid] for name, value in rows.items()}, _restart_leaves(state))
                code = int(state.status)
                progress(float(state.t), f"{int(state.steps)} steps")
                if scene.field is not None:
                    seen.append(rows["diagnostics/deformation_along_field"][:valid])
                    if code == status.RUNNING and _reached(scene_file, seen):
                        code = status.CLASS_REACHED
            code = status.COMPLETE if code == status.RUNNING else code
        except KeyboardInterrupt:
            code = status.INTERRUPTED
        word = status.WORDS[code]
        means = None
        if average is not None and float(state.window.reached[1]) > float(state.window.reached[0]):
            found = diagnostics.averages(state.window.means(), scene)
            means = {name: np.asarray(value) for name, value in found.items()}
        writer.finish(word, status.ADVICE[word], time.perf_counter() - began, means)
    return word
