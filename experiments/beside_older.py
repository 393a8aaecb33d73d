"""Is this version as cheap as an older one?

    git worktree add ../older v0.1.0
    python -m experiments.beside_older ../older      # any other checkout of this repository; twenty minutes
    python -m experiments.beside_older ../older --only "relaxing charge"   # the other scenes keep their stored results

Both versions compile the same runs, as users start them: adaptive steps with the default tolerance. Each has its own
process, and uses functions that both have. Then they take turns, one run of each after the other, so that a busy
machine slows both alike. This is repeated with new processes, because two processes with the same program can differ
by 5 %. A run has one saved time besides the start, and its time is divided by its number of steps.
"memory" is the most that is in use at one time, as XLA reports it. "buffers" is the area that it reserves for all
intermediate values, which also has gaps.

"relaxing charge" is the first scene again. This version computes it with charge relaxation, δ = 7e-3. The older one
does so if it knows this model, and without charge dynamics otherwise.

What to expect: no more equations, floating-point operations or bytes than the older version, no more memory, and a
median ratio of run times of at most 1.05. For relaxing charge beside a version without it: at most 1.5.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

PROCESSES, TURNS = 5, 6  # pairs of processes for each scene, and runs of each process
LENGTHS = {"pop": 1.0, "circulation": 0.1, "sheared field": 1.0, "64 vesicles": 1e-4, "relaxing charge": 1.0}  # t_end
COUNTS = ("equations", "flops", "bytes", "memory", "buffers")
QUICK = {"processes": 1, "turns": 3, "lengths": {"pop": 1e-3}}

# What runs in each process: scenes by functions that all versions have; one line in, one line out.
WORKER = """
import inspect, json, sys, time
import numpy as np
import jaxves
import jax
import jax.numpy as jnp

def scene(name):
    along = jnp.pi / 2
    if name in ("pop", "relaxing charge"):
        known = "charge_relaxation" in inspect.signature(jaxves.dc_field).parameters
        more = {"charge_relaxation": 7e-3} if known and name == "relaxing charge" else {}
        field = jaxves.dc_field(3.2, conductivity_ratio=0.1, **more)
        return jaxves.make_scene(jaxves.ellipse(64, 0.9, angle=along), field=field)
    if name == "sheared field":
        field = jaxves.dc_field(6.4, conductivity_ratio=0.1, membrane_conductance=4.0)
        return jaxves.make_scene(jaxves.ellipse(64, 0.9, angle=0.35), field=field, flow=jaxves.Shear(10.0))
    if name == "circulation":
        field = jaxves.dc_field(3.2, conductivity_ratio=0.5, vesicles=2)
        centers = 1.3 * np.array([[-np.cos(0.35), -np.sin(0.35)], [np.cos(0.35), np.sin(0.35)]])
        return jaxves.make_scene([jaxves.ellipse(64, 0.9, angle=along)] * 2, centers=centers, field=field)
    field = jaxves.dc_field(3.2, conductivity_ratio=0.1, vesicles=64)
    centers = 2.9 * np.array([[i % 8, i // 8] for i in range(64)])
    return jaxves.make_scene([jaxves.ellipse(32, 0.9, angle=along)] * 64, centers=centers, field=field)

def equations(jaxpr):
    inner = [part for equation in jaxpr.eqns for part in jax.tree.leaves(
        list(equation.params.values()), is_leaf=lambda p: hasattr(p, "jaxpr") or hasattr(p, "eqns"))]
    inner = [getattr(part, "jaxpr", part) for part in inner]
    return len(jaxpr.eqns) + sum(equations(part) for part in inner if hasattr(part, "eqns"))

def run(given):
    result = jaxves.simulate(given, float(sys.argv[2]), saves=1)
    return result.x, result.state.steps + result.state.rejected

given = scene(sys.argv[1])
traced = jax.make_jaxpr(run)(given)
start = time.perf_counter()
compiled = jax.jit(run).lower(given).compile()
seconds = time.perf_counter() - start
cost, memory = compiled.cost_analysis(), compiled.memory_analysis()
cost = cost[0] if isinstance(cost, list) else cost
steps = int(compiled(given)[1])
print(json.dumps({"equations": equations(traced.jaxpr), "flops": cost["flops"], "bytes": cost["bytes accessed"],
                  "memory": memory.peak_memory_in_bytes, "buffers": memory.temp_size_in_bytes,
                  "compile": seconds, "steps": steps}), flush=True)
for line in sys.stdin:
    start = time.perf_counter()
    jax.block_until_ready(compiled(given))
    print((time.perf_counter() - start) / steps, flush=True)
"""


def process(folder: Path, name: str, t_end: float) -> subprocess.Popen:
    """A process with the version in `folder`, which compiles a scene and then waits to be told to run it."""
    flags = {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.Popen(
        [sys.executable, "-c", WORKER, name, str(t_end)],
        env=os.environ | flags, cwd=folder, text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip


def compared(older: Path, name: str, processes: int, turns: int, t_end: float) -> dict:
    """{of each version: equations, flops, bytes, memory, buffers, compile, steps}, and the ratio of times per step.

    The interval is for the median of the ratios of all processes, which are drawn again as a whole.
    """
    folders = {"older": older.resolve(), "this": Path(__file__).resolve().parents[1]}
    found, ratios, seconds = {}, [], {version: [] for version in folders}
    for _ in range(processes):
        running = {version: process(folder, name, t_end) for version, folder in folders.items()}
        found = {version: json.loads(worker.stdout.readline()) for version, worker in running.items()}
        for _ in range(turns):
            for version, worker in running.items():
                print("run", file=worker.stdin, flush=True)
                seconds[version].append(float(worker.stdout.readline()))
        for worker in running.values():
            worker.communicate()
        ratios.append(np.array(seconds["this"][-turns:]) / np.array(seconds["older"][-turns:]))
    ratios = np.array(ratios)
    draws = np.random.default_rng(0).integers(processes, size=(4000, processes))
    low, high = np.quantile(np.median(ratios[draws].reshape(len(draws), -1), axis=1), [0.025, 0.975])
    for version in folders:
        found[version]["step"] = float(np.median(seconds[version]))
    each = np.median(ratios, axis=1).tolist()
    return found | {"ratio": float(np.median(ratios)), "interval": [float(low), float(high)], "of processes": each}


def run(older=Path(__file__).parents[1], lengths=None, processes=PROCESSES, turns=TURNS) -> dict:
    """{scene: what `compared` found} for runs of these lengths; without `older` this version beside itself."""
    return {name: compared(Path(older), name, processes, turns, t_end) for name, t_end in (lengths or LENGTHS).items()}


def main():
    from ._common import HERE, store

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("older", type=Path, help="folder with another checkout")
    parser.add_argument("--only", choices=LENGTHS, help="one scene")
    chosen = parser.parse_args()
    found = run(chosen.older, {chosen.only: LENGTHS[chosen.only]} if chosen.only else None)
    for name, row in found.items():
        old, new = row["older"], row["this"]
        counts = ", ".join(f"{key} {new[key] / old[key]:.3f}" for key in COUNTS)
        print(
            f"{name:14} ratio {row['ratio']:.3f} [{row['interval'][0]:.3f}, {row['interval'][1]:.3f}], {counts}, "
            f"step {1e3 * new['step']:.2f} ms, compiled in {new['compile']:.1f} s ({old['compile']:.1f} s)"
        )
    if chosen.only:
        found = json.loads((HERE / "data" / "beside_older.json").read_text())["data"] | found
    store("beside_older", found)


if __name__ == "__main__":
    main()
