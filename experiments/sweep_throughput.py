"""How many cases per second does a sweep compute, and how do devices, batches and the command line change this?

    python -m experiments.sweep_throughput           # CPU: two host devices against one, batches, one by one, commands
    python -m experiments.sweep_throughput --gpu     # on a GPU: cases per second by the size of a batch, gradients

64 cases of POP over β and G, N = 64, to t = 1 with 20 saves. "One by one" is `jaxves.simulate` under `jit`, called for
one case after the other. The command line is `jaxves run`, once for each case. All but the commands take turns.

What to expect: batches are as fast as one by one. A second device nearly doubles the rate. A command spends most of
its time on starting.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np

from ._sweeps import swept  # noqa: F401  (before JAX: one device for each core)

import jax  # isort: skip
import jax.numpy as jnp

from jaxves.inputs import scene_files, sweep_files
from jaxves.runs import problem
from jaxves.runs.build import scene_of
from jaxves.runs.case import Case
from jaxves.stepping import marching
from jaxves.sweeps.batches import Batches

from ._common import store

NAMES = ("field.beta", "field.membrane_conductance")
QUICK = dict(cases=4, nodes=32, t_end=0.02, repeats=1, commands=0, batches=(2,), devices=(1,))


def setting(nodes, t_end, cases):
    """Returns the sweep and its values."""
    scene = scene_files.read_scene("pop").model_copy(update={"t_end": t_end, "saves": 20})
    scene = problem.with_nodes(scene, nodes)
    values = np.random.default_rng(0).uniform([1.0, 0.0], [6.0, 1.0], size=(cases, 2))
    listed = [dict(zip(NAMES, row.tolist(), strict=True)) for row in values]
    return sweep_files.parse({"scene": scene, "cases": listed}), values


def simulated(scene_file, row) -> marching.Result:
    """Runs one case, as a function of its values."""
    scene = scene_of(scene_file, dict(zip(NAMES, row, strict=True)))
    return marching.simulate(scene, scene_file.t_end, saves=scene_file.saves, march=Case(scene_file).march())


def one_by_one(sweep_file, values):
    """Returns a call that simulates one case after the other."""

    @jax.jit
    def alone(row):
        result = simulated(sweep_file.scene, row)
        return result.status, result.diagnostics, result.state

    return lambda: [jax.tree.map(np.asarray, alone(jnp.asarray(row))) for row in values]


def gradients(sweep_file, values, over=jax.vmap):
    """Returns a call for the gradients of the final deformation in the values, (cases, 2), in reverse mode."""
    slope = jax.grad(lambda row: simulated(sweep_file.scene, row).diagnostics["deformation"][-1, 0])
    compiled = jax.jit(over(slope))
    return lambda: np.asarray(compiled(jnp.asarray(values)))


def in_batches(sweep_file, values, devices, method, batch):
    """Returns a call that computes the cases with the program of a sweep."""
    work = Batches(sweep_file, NAMES, jax.local_devices()[:devices], method, batch)
    return lambda: list(work.outcomes(sweep_file.max_steps[0], values))


def by_commands(sweep_file, values) -> float:
    """Returns the seconds of one `jaxves run` per case, with a compilation cache; the first is not counted."""
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        for i, row in enumerate([values[0], *values]):
            beta, conductance = row
            field = sweep_file.scene.field.model_copy(update={"beta": beta, "membrane_conductance": conductance})
            path = Path(folder) / f"{i}.toml"
            path.write_text(scene_files.to_toml(sweep_file.scene.model_copy(update={"field": field})))
            start = time.perf_counter()
            command = [sys.executable, "-m", "jaxves", "run", str(path), "--out", str(path.with_suffix(".h5"))]
            subprocess.run(command, check=True, capture_output=True, env=os.environ | {"XLA_FLAGS": ""})
            seconds.append(time.perf_counter() - start)
    return float(np.median(seconds[1:]))


def run(cases=64, nodes=64, t_end=1.0, repeats=3, commands=3, batches=(1, 4, 16), devices=(1, 2), method="map"):
    """Returns the seconds per case for each method, and ratios between them."""
    sweep_file, values = setting(nodes, t_end, cases)
    calls = {"one by one": one_by_one(sweep_file, values)}
    for count in devices:
        for batch in batches:
            calls[f"{count} × {batch}"] = in_batches(sweep_file, values, count, method, batch)
    for call in calls.values():
        call()  # compiles
    seconds = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            seconds[name].append((time.perf_counter() - start) / cases)
    # The least of a few, as of any time on a machine that others use.
    found = {name: min(times) for name, times in seconds.items()}
    if commands:
        found["command line"] = by_commands(sweep_file, values[:commands])
    best = {count: min(found[f"{count} × {batch}"] for batch in batches) for count in devices}
    ratios = {
        "default batch against one by one": found["one by one"] / found[f"{devices[0]} × {batches[len(batches) // 2]}"],
        "all devices against one": best[devices[0]] / best[devices[-1]],
    }
    if commands:
        ratios["all devices against the command line"] = found["command line"] / best[devices[-1]]
    return {"seconds per case": found, "ratios": ratios, "device": str(jax.devices()[0])}


def outcomes_of(call) -> dict[str, np.ndarray]:
    """Returns the arrays of results of all cases."""
    parts = [part for _, part in call()]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def warm(call):
    """Returns the result of a call, and its seconds after compilation."""
    found = call()
    start = time.perf_counter()
    call()
    return found, time.perf_counter() - start


def on_host(path, cases, nodes, t_end, differentiated) -> None:
    """Cases a second on all devices of this process, gradients one at a time, and what came of them, into a file."""
    sweep_file, values = setting(nodes, t_end, cases)
    work = in_batches(sweep_file, values, jax.local_device_count(), "map", 4)
    found, seconds = warm(lambda: outcomes_of(work))
    few = values[:differentiated]
    slopes, slope_seconds = warm(gradients(sweep_file, few, over=lambda slope: partial(jax.lax.map, slope)))
    rates = {"rate": cases / seconds, "gradient rate": len(few) / slope_seconds}
    np.savez(path, cores=jax.local_device_count(), gradients=slopes, **rates, **found)


def by_host(*sizes) -> dict[str, np.ndarray]:
    """Runs `on_host` in a process that sees no GPU."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "host.npz"
        command = [sys.executable, "-m", "experiments.sweep_throughput", "--host", path, *sizes]
        environment = os.environ | {"JAX_PLATFORMS": "cpu"}
        subprocess.run([str(part) for part in command], check=True, env=environment)
        return dict(np.load(path))


def on_gpu(cases=2048, nodes=64, t_end=1.0, batches=(16, 256, 1024, 2048), differentiated=256):
    """Cases a second on one device by the size of the batch, until memory ends, beside the cores of its host.

    And gradients a second, `differentiated` at a time, beside the host's, one at a time.
    """
    host = by_host(cases, nodes, t_end, min(32, differentiated))
    print(f"{host['cores']} cores of the host: {host['rate']:.3g} cases/s", flush=True)
    sweep_file, values = setting(nodes, t_end, cases)
    rates, apart = {}, {}
    for batch in batches:
        few = values[: max(batch, min(cases, 4 * batch))]
        try:
            work = in_batches(sweep_file, few, 1, "vmap", batch)
        except sweep_files.SceneError as error:
            rates[batch] = str(error)
            break
        found, seconds = warm(lambda work=work: outcomes_of(work))
        rates[batch] = len(few) / seconds
        same = found["status"] == host["status"][: len(few)]
        off = np.abs(found["deformation_final"] - host["deformation_final"][: len(few)])[same]
        apart[batch] = {
            "other status": int(np.sum(~same)),
            "deformation_final": float(np.max(off, initial=0)),
            "beyond 1e-4": int(np.sum(off > 1e-4)),
        }
        print(f"{batch} at a time: {rates[batch]:.3g} cases/s, {apart[batch]}", flush=True)
    slopes, seconds = warm(gradients(sweep_file, values[:differentiated]))
    expected = host["gradients"]
    off = np.abs(slopes[: len(expected)] - expected) / np.max(np.abs(expected), axis=1, keepdims=True)
    slope_rates = {"GPU": len(slopes) / seconds, "host, one at a time": float(host["gradient rate"])}
    print(f"gradients: {slope_rates}, apart by {np.median(off):.1e} (median), {np.max(off):.1e}", flush=True)
    return {
        "cases per second": rates,
        "cases per second on the host": float(host["rate"]),
        "cores of the host": int(host["cores"]),
        "apart from the host": apart,
        "gradients per second": slope_rates,
        "gradients apart": {"median": float(np.median(off)), "most": float(np.max(off))},
        "device": jax.devices()[0].device_kind,
    }


def main():
    parser = argparse.ArgumentParser(description="Throughput of sweeps.")
    parser.add_argument("--gpu", action="store_true", help="cases per second against the size of a batch, by vmap")
    sizes = ("FILE", "CASES", "NODES", "T_END", "DIFFERENTIATED")
    parser.add_argument("--host", nargs=5, metavar=sizes, help="what --gpu compares with")
    wanted = parser.parse_args()
    if wanted.host:
        path, cases, nodes, t_end, differentiated = wanted.host
        on_host(path, int(cases), int(nodes), float(t_end), int(differentiated))
        return
    if wanted.gpu:
        store("sweep_throughput", on_gpu(), "gpu")
        return
    found = run()
    for name, seconds in found["seconds per case"].items():
        print(f"{name:14} {seconds:.4f} s a case, {1 / seconds:.2f} cases/s")
    for name, ratio in found["ratios"].items():
        print(f"{name}: {ratio:.2f}")
    store("sweep_throughput", found)


if __name__ == "__main__":
    main()
