"""Is any run of any model silently wrong?

    python -m experiments.stability_map             # the chosen scenes and 96 random ones, two hours on two busy cores
    python -m experiments.stability_map --resume    # without the scenes whose results are stored

Scenes of all models are run as by `jaxves run`: steady, alternating and pulsed fields, averaged fields, flows, two
viscosities, relaxing charge, pairs and periodic cells. Some are chosen at the ends of the parameters. Others are drawn
at random, with numbers over their whole ranges (`_all_models.py`). A second run has more nodes and 0.04 times the
tolerance. The error is the largest distance of any node, in a, or difference of V_m, relative to its largest value
where that exceeds 1, over all saved times.

| verdict | meaning |
|---|---|
| right | the run is complete and its error is at most 1e-3 |
| as stated | the error is larger, and at most ten times what the run states, or the run itself ends as inaccurate |
| stopped | the run ends with a status that says why |
| slow | the run takes more than 100 s of CPU time, most of it for compilation |
| unchecked | the run is complete, and the second run is not |
| wrong | everything else, as a larger error, a value that is not finite, or an exception |

A stopped run is made again with twice the nodes. They are the cure if this run is complete.

What to expect: nothing is wrong. At least 80 % of all scenes are right, and 90 % of those within the limits that the
documentation states.
"""

import argparse
import collections
import json
import signal
import tempfile
import time
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxves.base import compiling, status
from jaxves.base.resolution import AUTO_NODES
from jaxves.geometry import outlines
from jaxves.inputs.scene_files import SceneFile, parse, to_toml
from jaxves.plots import run_plots
from jaxves.results import run_store
from jaxves.runs.adapt_nodes import finer_rows
from jaxves.runs.programs import forget
from jaxves.runs.runner import run as run_file
from jaxves.runs.strength import stress

from . import _all_models
from ._chosen import CHOSEN
from ._common import HERE, save, store, styled

SEED = 5
_RIGHT, _STATED = 1e-3, 10.0
_LONGEST = 100  # seconds of CPU time, with compilation
_FINER = 0.04  # tolerance of the second run
_TOGETHER = 8
QUICK = dict(names=("circle in a flow",), count=0)


def _outcome(scene_file: SceneFile, path: Path) -> tuple[str, run_store.Record | None, float]:
    """Runs a scene; returns the status word or the exception, the result and the seconds of CPU time."""
    began = time.process_time()
    signal.setitimer(signal.ITIMER_PROF, _LONGEST)  # ends the run like Ctrl-C
    try:
        word = run_file(scene_file, path, force=True)
        found = word, run_store.read_result(path)
    except KeyboardInterrupt:
        found = "interrupted", None
    except Exception as error:  # a scene that the parser accepts must not end in an exception
        found = f"{type(error).__name__}: {error}", None
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return *found, time.process_time() - began


def _with(scene_file: SceneFile, **numerics) -> SceneFile:
    """Returns the scene with other numerical parameters."""
    return scene_file.model_copy(update={"numerics": scene_file.numerics.model_copy(update=numerics)})


def _next_size(N: float) -> int:
    return next((K for K in AUTO_NODES if N <= K), AUTO_NODES[-1])


def difference(record: run_store.Record, finer: run_store.Record, rows: int) -> float:
    """Returns the largest difference of two results over the first rows that both have."""
    rows, apart = min(rows, len(finer.t)), [0.0]
    for name in ("x", "V_m"):
        one, other = getattr(record, name), getattr(finer, name)
        if one is not None and rows:
            K = max(one.shape[2], other.shape[2])
            one, other = (finer_rows(values[:rows], K) for values in (one, other))
            scale = 1.0 if name == "x" else max(1.0, float(np.max(np.abs(other))))
            apart.append(float(np.max(np.abs(one - other))) / scale)
    return max(apart)


def _is_finite(record: run_store.Record) -> bool:
    arrays = [record.x, record.tension] + ([] if record.V_m is None else [record.V_m])
    return all(bool(np.all(np.isfinite(array))) for array in arrays)


def tried(case: tuple[str, SceneFile]) -> dict:
    """Returns what became of one scene, with its name. The error that it states is asked for only if it matters."""
    name, scene_file = case
    compiling.fast_start()
    signal.signal(signal.SIGPROF, signal.default_int_handler)
    found = {"name": name, "scene": to_toml(scene_file), "limits": exceeded(scene_file)}
    with tempfile.TemporaryDirectory() as folder:
        word, record, seconds = _outcome(_with(scene_file, certify=False), Path(folder) / "first.h5")
        found |= {"word": word, "seconds": round(seconds, 1)}
        if record is None:
            return found | {"verdict": "slow" if word == "interrupted" else "wrong"}
        found |= {"nodes": int(np.max(record.nodes, initial=0)), "steps": int(record.steps[-1]) if len(record.t) else 0}
        if word == "interrupted":
            return found | {"verdict": "slow"}
        success = word in (*status.SUCCESS, "inaccurate")
        N = found["nodes"] or (64 if scene_file.numerics.nodes == "auto" else scene_file.numerics.nodes)
        tolerance = scene_file.numerics.tolerance
        more = dict(nodes=_next_size(1.3 * N), tolerance=_FINER * tolerance) if success else dict(nodes=2 * N)
        finer_word, finer, seconds = _outcome(_with(scene_file, certify=False, **more), Path(folder) / "second.h5")
        found |= {"finer": finer_word, "finer seconds": round(seconds, 1)}
        # The last saved time of a run that was stopped is the one at which it was found wanting.
        rows = len(record.t) if success else len(record.t) - 1
        found["error"] = difference(record, finer, rows) if finer is not None and rows > 0 else None
        if word in status.SUCCESS and found["error"] is not None and found["error"] > _RIGHT:
            _, certified, _ = _outcome(scene_file, Path(folder) / "certified.h5")
            found["stated"] = None if certified is None else certified.attributes.get("error")
    forget()
    return found | {"verdict": verdict(found, finer=finer, finite=_is_finite(record))}


def verdict(found: dict, finer, finite: bool) -> str:
    """Returns the verdict on one scene; `finer` is the result of the second run, or None."""
    error, word = found["error"], found["word"]
    if not finite:
        return "stopped" if word == "not finite" else "wrong"
    if word not in (*status.SUCCESS, "inaccurate"):
        return "stopped"
    if finer is None or found["finer"] not in (*status.SUCCESS, "inaccurate"):
        return "unchecked"
    if word == "inaccurate":
        return "as stated"
    if error <= _RIGHT:
        return "right"
    return "as stated" if found.get("stated") is not None and error <= _STATED * found["stated"] else "wrong"


def exceeded(scene_file: SceneFile) -> list[str]:
    """Returns the limits of the documentation that a scene exceeds (docs/theory/limits.md)."""
    found, fixed = [], scene_file.numerics.nodes != "auto"
    vesicles = scene_file.vesicles()
    field, strength = scene_file.field, stress(scene_file)
    if fixed and strength > 1000:
        without_field = scene_file.model_copy(update={"field": None})
        conducting = field is not None and all(
            (field.conductivity_ratio if v.conductivity_ratio is None else v.conductivity_ratio) >= 1 for v in vesicles
        )
        if not conducting or stress(without_field) > 1000:
            found.append("wrinkles")
    several = len(vesicles) > 1 or scene_file.cell is not None
    if several and any(getattr(v, "reduced_area", 1.0) > 0.999 for v in vesicles):
        found.append("circle among others")
    if len(vesicles) == 2 and scene_file.cell is None:
        one, other = (outlines.placed(v.polygon(), v.length, v.angle, v.center) for v in vesicles)
        nodes = 64 if scene_file.numerics.nodes == "auto" else scene_file.numerics.nodes
        if one.distance(other) < one.length / nodes:
            found.append("film thinner than the node spacing")
    return found


def cases(names=None, count=0, seed=SEED) -> list[tuple[str, SceneFile]]:
    """Returns chosen scenes by name, all by default, and `count` random ones."""
    chosen = [(name, parse(CHOSEN[name])) for name in (CHOSEN if names is None else names)]
    return chosen + [(f"{i} {_all_models.model_of(i).label()}", _all_models.drawn(seed, i)[0]) for i in range(count)]


def run(names=None, count=96, seed=SEED, known=(), keep=lambda found: None) -> list[dict]:
    """Returns what became of each scene. Those among `known` are not run again; `keep` stores results."""
    stored = {case["scene"]: case for case in known}
    wanted = cases(names, count, seed)
    missing = [case for case in wanted if to_toml(case[1]) not in stored]
    with get_context("spawn").Pool(1, maxtasksperchild=_TOGETHER) as processes:
        for case in processes.imap(tried, missing):
            stored[case["scene"]] = case
            keep(list(stored.values()))
            print(line(case), flush=True)
    return [stored[to_toml(scene)] for _, scene in wanted]


def line(case: dict) -> str:
    """Returns one line of the printed table."""
    numbers = [f"{key} {case[key]:.1e}" for key in ("error", "stated") if case.get(key) is not None]
    parts = [f"{case['name']:34} {case['verdict']:9} {case['word']:14}", *numbers, f"finer {case.get('finer', '')}"]
    parts += [f"{case.get('nodes', 0)} nodes {case.get('steps', 0)} steps {case['seconds']:.0f} s", *case["limits"]]
    return " ".join(parts)


def summary(found: list[dict]) -> dict:
    """Returns the counts of verdicts: of all scenes, and of those within the stated limits."""
    within = [case for case in found if not case["limits"]]
    stopped = [case for case in found if case["verdict"] == "stopped"]
    return {
        "scenes": len(found),
        "verdicts": dict(collections.Counter(case["verdict"] for case in found)),
        "within the limits": len(within),
        "verdicts within the limits": dict(collections.Counter(case["verdict"] for case in within)),
        "stopped, by word": dict(collections.Counter(case["word"] for case in stopped)),
        "cured by twice the nodes": sum(case["finer"] in status.SUCCESS for case in stopped),
    }


_COLORS = {"right": "#b7e1c0", "as stated": "#d8ecc0", "stopped": "#fbdc9c", "slow": "#e0d4f0", "unchecked": "#dddddd"}
_WRONG = "#f2a3a3"


@styled
def draw(found: list[dict], columns=6) -> Figure:
    """Draws a tile for each scene with its name, and its error or its status."""
    groups = {"chosen": [], "random": []}
    for case in found:
        groups["random" if case["name"].split(" ")[0].isdigit() else "chosen"].append(case)
    rows = sum(-(-len(cases) // columns) for cases in groups.values())
    figure = Figure(figsize=(run_plots.PAGE, 0.3 * rows + 0.4))
    axes = figure.subplots()
    y = 0.0
    for group, cases in groups.items():
        axes.text(0, y + 0.3, group, fontsize=7, weight="bold", va="center")
        y += 0.6
        for i, case in enumerate(cases):
            x, row = i % columns, y + i // columns
            color = _COLORS.get(case["verdict"], _WRONG)
            axes.add_patch(Rectangle((x + 0.02, row + 0.04), 0.96, 0.92, color=color, lw=0))
            told = f"{case['error']:.0e}" if case["verdict"] in ("right", "as stated", "wrong") else case["word"]
            axes.text(x + 0.5, row + 0.32, case["name"], fontsize=5, ha="center", va="center")
            axes.text(x + 0.5, row + 0.72, told, fontsize=5, ha="center", va="center", weight="bold")
        y += -(-len(cases) // columns)
    axes.set(xlim=(0, columns), ylim=(y, 0))
    axes.set_axis_off()
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--count", type=int, default=96, help="number of random scenes")
    parser.add_argument("--resume", action="store_true", help="keep the stored results of scenes that have not changed")
    arguments = parser.parse_args()
    path = HERE / "data" / "stability_map.json"
    known = json.loads(path.read_text())["data"]["cases"] if arguments.resume else []

    def keep(found):
        store("stability_map", {"seed": arguments.seed, "summary": summary(found), "cases": found})

    found = run(None, arguments.count, arguments.seed, known, keep)
    keep(found)
    for name, value in summary(found).items():
        print(f"{name}: {value}")
    save(draw(found), "stability_map")


if __name__ == "__main__":
    main()
