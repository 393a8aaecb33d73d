"""Should a run adapt its number of nodes if the scene file does not say how many?

    python -m experiments.default_nodes             # twenty-five minutes on two busy cores
    python -m experiments.default_nodes --pairs     # the built-in pairs, six minutes

The scenes are some of those that are built in, and those of `stability_map` that did not end within 1e-3 with 64 nodes,
as well as some that did. Each is run with 64 nodes and with `nodes = "auto"`, with compilation and with
nothing compiled before. The error is that which the run states.

What to expect: "auto" completes scenes that 64 nodes do not resolve, and costs the same where 64 nodes are enough.
"""

import argparse
import json
import signal
import tempfile
import time
import tomllib
from pathlib import Path

import jax
import numpy as np

from jaxves.base import status
from jaxves.inputs.scene_files import SceneFile, parse, read_scene
from jaxves.results import run_store
from jaxves.runs.programs import forget
from jaxves.runs.runner import run as run_file

from ._common import HERE, store

_LONGEST = 100  # seconds of CPU time
NAMES = ("pop", "prolate", "relax", "shear", "sheared_field")
PAIRS = ("chain", "circulation", "oscillation")
QUICK = dict(names=("relax",), mapped=0)


def _measured(scene_file: SceneFile, nodes: int | str, path: Path) -> dict:
    """Runs a scene with nothing compiled; returns its status, stated error, nodes, and seconds of CPU time."""
    numerics = scene_file.numerics.model_copy(update={"nodes": nodes})
    jax.clear_caches()
    forget()
    began = time.process_time()
    signal.signal(signal.SIGPROF, signal.default_int_handler)  # the limit of time ends the run like Ctrl-C
    signal.setitimer(signal.ITIMER_PROF, _LONGEST)
    try:
        word = run_file(scene_file.model_copy(update={"numerics": numerics}), path, force=True)
        record = run_store.read_result(path)
    except KeyboardInterrupt:
        return {"word": "slow", "seconds": time.process_time() - began}
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    error = record.attributes.get("error", np.nan)
    found = {"word": word, "seconds": round(time.process_time() - began, 1), "error": float(error)}
    return found | {"nodes": int(np.max(record.nodes))}


def scenes(names, mapped) -> dict[str, SceneFile]:
    """Returns scenes by name: built-in ones, and up to this many of each verdict of the stability map."""
    found = {name: read_scene(name) for name in names}
    cases = json.loads((HERE / "data" / "stability_map.json").read_text())["data"]["cases"] if mapped else []
    for verdict in ("as stated", "stopped", "right"):
        chosen = [case for case in cases if case["verdict"] == verdict]
        for case in chosen[:: max(len(chosen) // max(mapped, 1), 1)][:mapped]:
            scene_file = parse(tomllib.loads(case["scene"]))
            if scene_file.numerics.nodes == 64 and scene_file.cell is None:
                found[f"{case['name']} ({verdict})"] = scene_file
    return found


def run(names=NAMES, mapped=7) -> list[dict]:
    """Returns one row for each scene."""
    rows = []
    for name, scene_file in scenes(names, mapped).items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.h5"
            rows.append(
                {"name": name, "64": _measured(scene_file, 64, path), "auto": _measured(scene_file, "auto", path)}
            )
        print(rows[-1], flush=True)
    return rows


def table(rows):
    """Yields how many scenes end well, and what "auto" costs where 64 nodes are enough."""
    for kind in ("64", "auto"):
        good = [row for row in rows if row[kind]["word"] in status.SUCCESS]
        right = [row for row in good if row[kind]["error"] <= 1e-3]
        yield f"{kind}: {len(good)} of {len(rows)} complete, {len(right)} of them with a stated error up to 1e-3"
    both = [row for row in rows if all(row[kind]["word"] in status.SUCCESS for kind in ("64", "auto"))]
    ratios = [row["auto"]["seconds"] / row["64"]["seconds"] for row in both]
    yield f"time with auto over time with 64: median {np.median(ratios):.2f}, {min(ratios):.2f} to {max(ratios):.2f}"


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--pairs", action="store_true", help="run the built-in pairs instead")
    pairs = options.parse_args().pairs
    rows = run(PAIRS, 0) if pairs else run()
    store("default_nodes", rows, "pairs" if pairs else "")
    print(*table(rows), sep="\n")


if __name__ == "__main__":
    main()
