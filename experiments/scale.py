"""What do many vesicles cost: time, iterations and memory of a step, from 64 to 1024 of them?

    python -m experiments.scale            # a table and a figure, 20 minutes; --sizes 64 256 for some of the rows
    python -m experiments.scale --few      # two tables for few vesicles in the plane, 6 minutes

A suspension has ellipses (Δ = 0.9) at random places and angles in a periodic cell, at an area fraction of 0.3 and with
gaps of at least 0.05. Gaps below 5.5 node spacings use close evaluation. A step is a complete step of ARK4 in a field:
the linear part, six F with their coupled solves for charge and tension, implicit solves and the projection. Sums are as
accurate as in a run with the tolerance 1e-4.

Every size runs in its own process, which reports its peak memory. Times
are compared with the step of one vesicle in the same process, in elapsed time and in processor time.

A few vesicles on a lattice in the plane, whose circumscribed circles are 0.2 apart, show the cost of a pair and of the
methods for few vesicles.

Every row also has the times of the parts of F: the geometry with its matrices and lists, and one sum over all nodes of
forces and of charges.

What to expect: iterations that hardly depend on M, memory that grows like M, and time that grows a little faster. A far
pair costs less than 4.5 single vesicles, and a near one less than 10. Under `vmap` far pairs cost as much as near ones.
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
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell
from jaxves.geometry.placement import random_suspension
from jaxves.numerics import fourier
from jaxves.operators.memory import bytes_of_step
from jaxves.operators.pairs import Pairwise
from jaxves.operators.sums import MatrixFree, accuracy_of_sums, coupling_in_cell, residual_of_systems
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.schemes import ARK4

from ._common import interleaved, medians, save, store, styled

SIZES = (64, 256, 1024)
GAP = 0.2
STEP = 1e-4
TOLERANCE = 1e-4
AREA_FRACTION = 0.3
QUICK = {"sizes": (3,), "N": 32}
QUICK_FEW = {"few": (2,), "N": 16, "repeats": 11}
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


def dense(M: int, N: int, seed=0) -> Scene:
    """Returns M ellipses at random places in a periodic square cell."""
    ellipse = np.asarray(shapes.ellipse(N, 0.9))
    lattice = np.sqrt(0.9 * np.pi * M / AREA_FRACTION) * np.eye(2)
    x = random_suspension(ellipse, lattice, count=M, seed=seed)
    return make_scene(list(jnp.asarray(x)), field=dc_field(3.2, vesicles=M, **_FIELD), cell=Cell.of(lattice))


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


def nearest_gaps(scene: Scene) -> np.ndarray:
    """Returns the distance of the nodes of each vesicle (M,) to the nearest other vesicle or image in a cell."""
    M, N, _ = scene.x.shape
    side = float(scene.cell.lattice[0, 0])
    owner = np.repeat(np.arange(M), N)
    points = np.mod(np.asarray(scene.x).reshape(-1, 2), side)
    tree = cKDTree(points, boxsize=side)
    found = np.full(M * N, np.inf)
    for node, point in enumerate(points):
        # a node has at most N nodes of its own vesicle around it
        distance, neighbour = tree.query(point, k=min(N + 1, M * N))
        found[node] = np.min(distance[owner[neighbour] != owner[node]], initial=np.inf)
    return found.reshape(M, N).min(axis=1)


def parts(scene: Scene, y: Unknowns, coupling) -> dict[str, float]:
    """Returns the seconds of processor time for F and its parts, the least of three calls each."""
    equation, t = equation_for(scene, coupling=coupling), jnp.zeros(())
    of_nodes = eqx.filter_jit(lambda y: equation.motion(t, y).surfaces)  # the compiler leaves out everything else
    across = of_nodes(y).interactions
    calls = {
        "geometry": (of_nodes, y),
        "sum of forces": (eqx.filter_jit(lambda of: of[0].stokes(of[1])), (across, jnp.ones_like(y.x))),
        "sum of charges": (eqx.filter_jit(lambda of: of[0].slp_gradient(of[1])), (across, y.V_m)),
        "F": (eqx.filter_jit(lambda y: equation.rate(t, y)), y),
    }
    found = {}
    for name, (function, argument) in calls.items():
        jax.block_until_ready(function(argument))  # compiles
        found[name] = min(_timed(lambda: function(argument))[2] for _ in range(3))  # noqa: B023 called at once
    return found


def row(M: int, N: int) -> dict:
    """Makes one step of a dense suspension in this process."""
    single, y_single = (lambda scene: (scene, charged(scene)))(suspension(1, N))
    scene = dense(M, N)
    y = charged(scene)
    coupling = coupling_in_cell(accuracy=accuracy_of_sums(TOLERANCE), solved=residual_of_systems(TOLERANCE))
    compiled = _step.lower(scene, y, coupling).compile()
    memory = compiled.compiled.memory_analysis()
    call = lambda: compiled(scene, y, coupling)  # noqa: E731
    base = lambda: _step(single, y_single, None)  # noqa: E731
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    jax.block_until_ready(base())
    units = [_timed(base)[1:] for _ in range(20)]
    (new, iterations, residual, near), wall, cpu = _timed(call)
    if M <= 256:
        *_, wall, cpu = min((_timed(call) for _ in range(2)), key=lambda timed: timed[2])
    units += [_timed(base)[1:] for _ in range(20)]
    unit_wall, unit_cpu = np.median(units, axis=0)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {
        "M": M,
        "wall": wall,
        "cpu": cpu,
        "wall / single": wall / unit_wall,
        "cpu / single": cpu / unit_cpu,
        "iterations": int(iterations),
        "residual": float(residual),
        "near pairs": int(near),
        "finite": bool(jnp.all(jnp.isfinite(new.x))),
        "peak": peak,
        "peak before": before,
        "estimated": bytes_of_step(M, N, coupling, scene.cell, electric=True),
        "planned": memory.temp_size_in_bytes + memory.output_size_in_bytes + memory.argument_size_in_bytes,
        "median gap": float(np.median(nearest_gaps(scene))),
        "parts": parts(scene, y, coupling),
    }


def row_in_a_process(M: int, N: int) -> dict:
    """Runs `row` in its own process."""
    command = [sys.executable, "-m", "experiments.scale", "--row", str(M), "--nodes", str(N)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ)
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


def run(sizes=SIZES, N=64) -> list[dict]:
    """Returns rows by size."""
    return [row_in_a_process(M, N) for M in sizes]


def run_few(few=(2, 3, 4, 8, 16, 32), N=64, repeats=21) -> dict:
    """Returns the cost of a pair, and the methods for a few vesicles."""
    return {"pairs": pairs(N, repeats), "couplings": couplings(few, N, repeats)}


@styled
def draw(rows) -> Figure:
    """Draws time, iterations and memory against the number of vesicles."""
    figure = Figure(figsize=(run_plots.PAGE, 2.9), layout="constrained")
    panels = figure.subplots(1, 3)
    M = [row["M"] for row in rows]
    panels[0].loglog(M, [row["cpu"] for row in rows], "o-", ms=3, label="a step")
    for name, mark in (("F", "s-"), ("geometry", "^-"), ("sum of forces", "v-")):
        panels[0].loglog(M, [row["parts"][name] for row in rows], mark, ms=3, lw=0.8, label=name)
    panels[0].loglog(M, [rows[0]["cpu"] * m / M[0] for m in M], ":", color="0.6", label="like M")
    panels[0].set(ylabel="processor time (s)")
    panels[0].legend(fontsize=6, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    panels[1].semilogx(M, [row["iterations"] for row in rows], "o-", ms=3)
    panels[1].set(ylabel="GMRES iterations of F", ylim=(0, 1 + max(row["iterations"] for row in rows)))
    panels[2].loglog(M, [row["planned"] / 2**20 for row in rows], "o-", ms=3, label="the compiled step")
    panels[2].loglog(M, [row["estimated"] / 2**20 for row in rows], "^:", ms=3, label="estimate before the start")
    panels[2].loglog(M, [row["peak"] / 2**20 for row in rows], "s--", ms=3, color="0.6", label="the whole process")
    panels[2].set(ylabel="memory (MiB)")
    panels[2].legend(fontsize=6, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    for axes in panels:
        axes.set_xlabel("vesicles")
        axes.set_xticks(M, [str(m) for m in M])
        axes.minorticks_off()
    return figure


def report(rows) -> None:
    """Prints the rows."""
    print("   M  wall s    cpu s  cpu/single  iterations  residual  near  peak MiB  planned MiB  estimated MiB")
    for r in rows:
        print(
            f"{r['M']:5d} {r['wall']:8.3f} {r['cpu']:8.3f} {r['cpu / single']:10.1f} {r['iterations']:10d}"
            f" {r['residual']:11.1e} {r['near pairs']:6d} {r['peak'] / 2**20:8.0f} {r['planned'] / 2**20:10.0f}"
            f" {r['estimated'] / 2**20:12.0f}"
        )
    for r in rows:
        seconds = ", ".join(f"{name} {value:.3f} s" for name, value in r["parts"].items())
        print(f"{r['M']:5d} median gap {r['median gap']:.2f}: {seconds}")


def report_few(found) -> None:
    """Prints the tables for few vesicles."""
    single = found["pairs"]["single"]
    for M, seconds in found["couplings"].items():
        print(f"one F of {M}: " + ", ".join(f"{name} {1e3 * value:.2f} ms" for name, value in seconds.items()))
    print("step / step of one vesicle: " + ", ".join(f"{k} {v / single:.2f}" for k, v in found["pairs"].items()))


def main():
    parser = argparse.ArgumentParser(prog="python -m experiments.scale", description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES)
    parser.add_argument("--nodes", type=int, default=64)
    parser.add_argument("--row", type=int, help="print one row as JSON, computed in this process")
    parser.add_argument("--few", action="store_true", help="few vesicles in the plane")
    wanted = parser.parse_args()
    if wanted.row is not None:
        print(json.dumps(row(wanted.row, wanted.nodes)))
        return
    if wanted.few:
        found = run_few(N=wanted.nodes)
        report_few(found)
        store("scale", found, "few")
        return
    found = run(tuple(wanted.sizes), N=wanted.nodes)
    report(found)
    store("scale", found)
    save(draw(found), "scale")


if __name__ == "__main__":
    main()
