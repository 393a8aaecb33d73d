"""How long does a user wait for the first result?

    git worktree add ../older v0.1.0
    python -m experiments.first_result ../older      # any other checkout of this repository; five minutes

Each task runs in a new process, once with an empty folder for compiled programs (cold) and once with what the first
left there (warm). Both versions take turns. CPU time, user and system, is counted, because it does not depend on what
else the machine does.

The targets are 0.3 of the CPU time of version 0.1.0 for a cold run of POP, and 0.4 for a warm one and for the gradient.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from ._common import store

HERE = Path(__file__).resolve().parents[1]
GRADIENT = """
import jax, jax.numpy as jnp, jaxves
getattr(jaxves, "fast_start", lambda: None)()

def deformation(beta):
    field = jaxves.dc_field(beta, conductivity_ratio=0.1)
    scene = jaxves.make_scene(jaxves.ellipse(64, 0.9, angle=jnp.pi / 2), field=field)
    return jaxves.simulate(scene, t_end=0.5, saves=1).diagnostics["deformation"][-1, 0]

print(jax.grad(deformation)(3.2))
"""
CHAIN = "chain.toml"
LONG = "run chain, nodes auto"  # minutes for each process, so it is run once
TASKS = {
    "run pop": [*["-m", "jaxves", "run", "pop", "-o", "OUT/run.h5"]],
    "gradient": ["-c", GRADIENT],
}
CHAINED = {LONG: [*f"-m jaxves run OUT/{CHAIN} -o OUT/run.h5".split()]}
QUICK = {"turns": 1, "tasks": {"import": ["-c", "import jaxves; jaxves.simulate"]}}


def measured(folder: Path, arguments: list[str], cache: Path) -> dict[str, float]:
    """Returns CPU and wall time in seconds of one process with the version in `folder`."""
    with tempfile.TemporaryDirectory() as out:
        chain = (HERE / "jaxves/inputs/scenes/chain.toml").read_text()
        Path(out, CHAIN).write_text(chain + '\n[numerics]\nnodes = "auto"\n')
        command = [sys.executable, *(part.replace("OUT", out) for part in arguments)]
        environment = os.environ | {"PYTHONPATH": str(folder), "XLA_FLAGS": ""}
        environment |= dict.fromkeys(("HOME", "TMPDIR", "XDG_CACHE_HOME"), str(cache))
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, env=environment, cwd=folder)
        wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return {"cpu": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, "wall": wall}


def run(older: Path = HERE, turns: int = 3, tasks: dict = TASKS) -> dict:
    """Returns medians of CPU and wall time by task, version, and cold or warm."""
    folders, found = {"older": Path(older).resolve(), "this": HERE}, {}
    for task, arguments in tasks.items():
        times: dict = {version: {"cold": [], "warm": []} for version in folders}
        for _ in range(1 if task == LONG else turns):
            for version, folder in folders.items():
                with tempfile.TemporaryDirectory() as cache:
                    for kind in times[version]:
                        times[version][kind].append(measured(folder, arguments, Path(cache)))
        found[task] = {
            version: {
                kind: {clock: float(np.median([one[clock] for one in several])) for clock in ("cpu", "wall")}
                for kind, several in kinds.items()
            }
            for version, kinds in times.items()
        }
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("older", type=Path, help="folder with another checkout")
    parser.add_argument("--turns", type=int, default=3, help="processes of each kind")
    parser.add_argument(
        "--chain", action="store_true", help='also a chain with nodes = "auto", which takes half an hour'
    )
    given = parser.parse_args()
    found = run(given.older, given.turns, TASKS | (CHAINED if given.chain else {}))
    for task, row in found.items():
        for kind in ("cold", "warm"):
            old, new = row["older"][kind], row["this"][kind]
            print(
                f"{task:22} {kind}: {new['cpu']:5.1f} s of CPU ({old['cpu']:.1f} s, "
                f"ratio {new['cpu'] / old['cpu']:.2f}), {new['wall']:.1f} s ({old['wall']:.1f} s)"
            )
    store("first_result", found)


if __name__ == "__main__":
    main()
