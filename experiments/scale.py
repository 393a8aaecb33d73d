"""What do many vesicles cost: time, iterations and memory of a step, from 1 to 256 of them?

    python -m experiments.scale            # tables and a figure, 15 minutes; --sizes 2 64 256 for some of the rows

A suspension is a lattice of randomly rotated ellipses (Δ = 0.9), whose circumscribed circles are 0.2 apart. No gap is
smaller, and gaps below 5.5 node spacings use close evaluation. A step is a complete step of ARK4 in a field: the
linear part, six F with their coupled solves for charge and tension, implicit solves and the projection. Every size
runs in its own process on one device, which reports its peak memory. The largest also runs on two devices, which share
the targets of the sums. Times are compared with the step of one vesicle in the same process, in elapsed time and in
processor time.

What to expect: iterations that become constant with M, memory that grows like M, and time that grows like M² when the
sums over all pairs dominate. A far pair costs less than 4.5 single vesicles, and a near one less than 10. Under `vmap`
far pairs cost as much as near ones.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh
from matplotlib.figure import Figure

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.numerics import fourier
from jaxves.operators.pairs import Pairwise
from jaxves.operators.sums import MatrixFree
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.schemes import ARK4

from ._common import interleaved, medians, save, store, styled

SIZES = (1, 2, 4, 8, 16, 32, 64, 128, 256)
GAP = 0.2
STEP = 1e-4
QUICK = {"sizes": (3,), "few": (2,), "N": 16, "repeats": 11}
_FIELD = {"conductivity_ratio": 0.1, "membrane_conductance": 0.2}


def charged(scene: Scene) -> Unknowns:
    """Returns the unknowns of a scene with membranes charged as in a vertical field."""
    M, N, _ = scene.x.shape
    return Unknowns.of(scene.x, jnp.broadcast_to(0.3 * jnp.sin(fourier.grid(N)), (M, N)))


def suspension(M: int, N: int, *, gap=GAP, seed=0) -> Scene:
    """Returns M randomly rotated ellipses on a square lattice, with circumscribed circles `gap` apart."""
    ellipse = shapes.ellipse(N, 0.9)
    spacing = 2 * float(jnp.max(jnp.abs(ellipse))) + gap
    side = int(np.ceil(np.sqrt(M)))
    places = np.stack(np.divmod(np.arange(M), side), axis=-1) * spacing
    turns = jnp.asarray(np.random.default_rng(seed).uniform(0, np.pi, M))
    x = jax.vmap(shapes.rotated, in_axes=(None, 0))(ellipse, turns)
    return make_scene(list(x), centers=places, field=dc_field(3.2, vesicles=M, **_FIELD))


def pair(N: int, gap: float) -> Scene:
    """Returns two ellipses side by side in a vertical field."""
    ellipse = shapes.ellipse(N, 0.9, angle=jnp.pi / 2)
    reach = 2 * float(jnp.max(ellipse[:, 0])) + gap
    return make_scene([ellipse] * 2, centers=[[0.0, 0.0], [reach, 0.0]], field=dc_field(3.2, vesicles=2, **_FIELD))


def step(scene: Scene, y: Unknowns, coupling=None):
    """Makes one step; returns the state, and iterations, residual and near pairs of the solves at its start."""
    equation = equation_for(scene, coupling=coupling)
    t = jnp.zeros(())
    frozen = equation.freeze(t, y)
    new = equation.project(ARK4().step(equation, frozen, t, y, jnp.asarray(STEP)).y, frozen.constraint)
    motion = frozen.motion
    near = getattr(motion.surfaces.interactions, "near", None)
    pairs = jnp.int32(-1) if near is None else jnp.sum(near.valid)
    return new, motion.iterations, motion.residual, pairs


_step = eqx.filter_jit(step)


def _timed(call):
    wall, cpu = time.perf_counter(), time.process_time()
    out = jax.block_until_ready(call())
    return out, time.perf_counter() - wall, time.process_time() - cpu


def row(M: int, N: int) -> dict:
    """Makes one step of a suspension without pair matrices, in this process on all of its devices."""
    single, y_single = (lambda scene: (scene, charged(scene)))(suspension(1, N))
    scene = suspension(M, N)
    y = charged(scene)
    devices = jax.devices()
    mesh = Mesh(np.array(devices), ("targets",)) if len(devices) > 1 else None
    coupling = None if M == 1 else MatrixFree(mesh=mesh)
    compiled = _step.lower(scene, y, coupling).compile()
    memory = compiled.compiled.memory_analysis()
    call = lambda: compiled(scene, y, coupling)  # noqa: E731
    base = lambda: _step(single, y_single, None)  # noqa: E731
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    jax.block_until_ready(base())
    units = [_timed(base)[1:] for _ in range(20)]
    (new, iterations, residual, near), wall, cpu = _timed(call)
    if M <= 32:
        *_, wall, cpu = min((_timed(call) for _ in range(5)), key=lambda timed: timed[2])
    units += [_timed(base)[1:] for _ in range(20)]
    unit_wall, unit_cpu = np.median(units, axis=0)
    return {
        "M": M,
        "devices": len(devices),
        "wall": wall,
        "cpu": cpu,
        "wall / single": wall / unit_wall,
        "cpu / single": cpu / unit_cpu,
        "iterations": int(iterations),
        "residual": float(residual),
        "near pairs": int(near),
        "finite": bool(jnp.all(jnp.isfinite(new.x))),
        "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
        "peak before": before,
        "planned": memory.temp_size_in_bytes + memory.output_size_in_bytes + memory.argument_size_in_bytes,
    }


def row_in_a_process(M: int, N: int, devices=1) -> dict:
    """Runs `row` in its own process with so many devices; each device is a thread."""
    command = [sys.executable, "-m", "experiments.scale", "--row", str(M), "--nodes", str(N)]
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    environment = os.environ | {"XLA_FLAGS": flags}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return json.loads(done.stdout)


def couplings(sizes, N: int, repeats: int) -> dict[int, dict[str, float]]:
    """Returns the seconds of one F of a suspension, by size and method."""
    ways = {"direct": Pairwise(direct=True), "pair matrices": Pairwise(direct=False), "sums": MatrixFree()}

    @eqx.filter_jit
    def rate(scene, y, coupling):
        return equation_for(scene, coupling=coupling).rate(jnp.zeros(()), y)

    def timed(M):
        scene = suspension(M, N)
        y = charged(scene)
        return medians(interleaved({k: (lambda way=way: rate(scene, y, way)) for k, way in ways.items()}, repeats))

    return {M: timed(M) for M in sizes}


def pairs(N: int, repeats: int, lanes=4) -> dict[str, float]:
    """Returns the seconds of a step for one vesicle, for pairs, and for `lanes` far pairs under `vmap`, per pair."""
    settings = {"single": suspension(1, N), "far pair": pair(N, 2.0), "near pair": pair(N, GAP)}
    calls = {name: (lambda s=s: _step(s, charged(s), None)) for name, s in settings.items()}
    far, near = settings["far pair"], settings["near pair"]

    @jax.jit
    def side_by_side(x):
        def one(x):
            y = charged(far)
            return step(far, Unknowns.of(x, y.V_m))[0].x

        return jax.vmap(one)(x)

    many = {"far pairs under vmap": jnp.stack([far.x] * lanes), "near pairs under vmap": jnp.stack([near.x] * lanes)}
    calls |= {name: (lambda x=x: side_by_side(x)) for name, x in many.items()}
    found = medians(interleaved(calls, repeats))
    return {name: value / (lanes if "vmap" in name else 1) for name, value in found.items()}


def run(sizes=SIZES, few=(2, 3, 4, 8, 16, 32), N=64, repeats=21) -> dict:
    """Returns rows by size, the cost of a pair, and the methods for a few vesicles."""
    return {
        "rows": [row_in_a_process(M, N) for M in sizes],
        "on two devices": row_in_a_process(max(sizes), N, devices=2),
        "pairs": pairs(N, repeats),
        "couplings": couplings(few, N, repeats),
    }


@styled
def draw(found) -> Figure:
    """Draws time, iterations and memory against the number of vesicles."""
    figure = Figure(figsize=(run_plots.PAGE, 2.3))
    panels = figure.subplots(1, 3)
    rows = found["rows"]
    M = [row["M"] for row in rows]
    panels[0].loglog(M, [row["cpu / single"] for row in rows], "o-", ms=3, label="processor time")
    panels[0].loglog(M, [row["wall / single"] for row in rows], "s--", ms=3, color="0.6", label="wall time")
    panels[0].set(title="time of one step / that of one vesicle")
    panels[0].legend(fontsize=6)
    coupled = [row for row in rows if row["iterations"] > 0]
    panels[1].semilogx([row["M"] for row in coupled], [row["iterations"] for row in coupled], "o-", ms=3)
    panels[1].set(title="GMRES iterations of one right-hand side", ylim=(0, 1 + max(row["iterations"] for row in rows)))
    panels[2].loglog(M, [row["planned"] / 2**20 for row in rows], "o-", ms=3, label="the compiled step")
    panels[2].loglog(M, [row["peak"] / 2**20 for row in rows], "s--", ms=3, color="0.6", label="the whole process")
    panels[2].set(title="memory (MiB)")
    panels[2].legend(fontsize=6)
    for axes in panels:
        axes.set_xlabel("vesicles")
    return figure


def report(found) -> None:
    """Prints the tables."""
    print("  M  devices  wall s    cpu s  cpu/single  iterations  residual  near  peak MiB  planned MiB")
    for r in [*found["rows"], found["on two devices"]]:
        print(
            f"{r['M']:4d} {r['devices']:4d} {r['wall']:9.4f} {r['cpu']:9.4f} {r['cpu / single']:9.2f}"
            f" {r['iterations']:9d} {r['residual']:12.1e} {r['near pairs']:6d} {r['peak'] / 2**20:8.0f}"
            f" {r['planned'] / 2**20:10.1f}"
        )
    single = found["pairs"]["single"]
    for M, seconds in found["couplings"].items():
        print(f"one F of {M}: " + ", ".join(f"{name} {1e3 * value:.2f} ms" for name, value in seconds.items()))
    print("step / step of one vesicle: " + ", ".join(f"{k} {v / single:.2f}" for k, v in found["pairs"].items()))


def main():
    parser = argparse.ArgumentParser(prog="python -m experiments.scale", description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--nodes", type=int, default=64)
    parser.add_argument("--row", type=int, help="print one row as JSON, computed in this process")
    wanted = parser.parse_args()
    if wanted.row is not None:
        print(json.dumps(row(wanted.row, wanted.nodes)))
        return
    found = run(tuple(wanted.sizes), N=wanted.nodes)
    report(found)
    store("scale", found)
    save(draw(found), "scale")


if __name__ == "__main__":
    main()
