"""What does a step with many nodes cost, beside an older version?

    git worktree add ../older b6ed819
    python -m experiments.strong_step ../older       # any other checkout of this repository; about ten minutes

One vesicle in a strong field (β/χ = 1e4), with fixed steps. Times are processor times in one thread, divided by that of
one SciPy LU factorisation of 3N unknowns in the same process; the least of three runs of four steps. The two saved
times of a run and its start are included, which are a quarter of the time. Memory is what the compiled program asks
for.

What to expect: the cost falls with N, because kernels and products grow more slowly than factorisations.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

from jaxves.base.compiling import FOR_LONG_RUNS, flags

SIZES = (128, 256, 512, 1024, 2048)
LARGEST_OLDER = 512  # nodes; programs of older versions for more contain large constants
QUICK = {"sizes": (16,)}

# What runs in the process of a version: functions that all versions have, and one line out.
WORKER = """
import json, sys, time
import numpy as np, scipy.linalg
import jaxves
import jax, jax.numpy as jnp

N, steps = int(sys.argv[1]), 4
field = jaxves.dc_field(1.0, chi=1e-4, conductivity_ratio=0.1)
scene = jaxves.make_scene(jaxves.ellipse(N, 0.9, angle=1.2), field=field)
run = lambda scene: jaxves.simulate(scene, 1e-7 * steps, saves=1, march=jaxves.Fixed(steps)).x
start = time.process_time()
compiled = jax.jit(run).lower(scene).compile()
compiling = time.process_time() - start

def least(call):
    call()
    seconds = []
    for _ in range(3):
        start = time.process_time()
        call()
        seconds.append(time.process_time() - start)
    return min(seconds)

matrix = np.random.default_rng(0).normal(size=(3 * N, 3 * N))
lu = least(lambda: scipy.linalg.lu_factor(matrix, check_finite=False))
step = least(lambda: jax.block_until_ready(compiled(scene))) / steps
print(json.dumps({"LU": lu, "step / LU": step / lu, "step": step, "compiling": compiling,
                  "GB": compiled.memory_analysis().temp_size_in_bytes / 2**30}))
"""


def one(folder: Path, N: int) -> dict[str, float]:
    """Returns the seconds of an LU factorisation, of a step and of compiling, and the memory, of one version."""
    options = {
        "PYTHONPATH": str(folder.resolve()),
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        "XLA_FLAGS": f"--xla_cpu_multi_thread_eigen=false {flags(FOR_LONG_RUNS)}",
    }
    command = [sys.executable, "-c", WORKER, str(N)]
    found = subprocess.run(command, env=os.environ | options, cwd=folder, text=True, capture_output=True, check=True)
    return json.loads(found.stdout)


def run(older: Path | None = None, sizes=SIZES) -> dict[int, dict[str, dict[str, float]]]:
    """Returns {N: {version: what `one` found}}; without `older` of this version alone."""
    this = {"this": Path(__file__).resolve().parents[1]}
    both = this if older is None else this | {"older": older}
    return {
        N: {version: one(folder, N) for version, folder in (both if N <= LARGEST_OLDER else this).items()}
        for N in sizes
    }


def report(found) -> None:
    """Prints one line for each number of nodes and version."""
    for N, versions in found.items():
        for version, row in versions.items():
            print(
                f"N = {N:4}, {version:5}: step {row['step / LU']:5.2f} LU ({1e3 * row['step']:.0f} ms), "
                f"{row['GB']:.2f} GB, compiled in {row['compiling']:.0f} s",
                flush=True,
            )


def main():
    from ._common import store

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("older", type=Path, help="folder with another checkout")
    found = run(parser.parse_args().older)
    report(found)
    store("strong_step", found)


if __name__ == "__main__":
    main()
