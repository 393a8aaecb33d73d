"""What accuracy does a tolerance alone reach, and what does it cost to have the nodes chosen?

    python -m experiments.nodes_and_tolerance               # all scenes of `benchmarks`
    python -m experiments.nodes_and_tolerance pop tumbling  # only these

The scenes are those of `benchmarks`: one vesicle in fields and flows of all kinds, a bud, wrinkles, pairs, a periodic
cell. Each is run as by `jaxves run`, with several fixed numbers of nodes and tolerances, and with `nodes = "auto"`, the
default, for each tolerance. The error, of space and time together, is the largest difference of any column from the
benchmark, relative to the largest value of the column. Seconds are those of a second run in the same process, without
compilation and without the run that estimates the error.

"Cost" is the time of a run with adapted nodes over that of the cheapest run with fixed nodes and any of the tolerances
whose error is not larger. The target is 2.

What to expect: an error of the order of the tolerance, and costs near 1 where few nodes are enough.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import jaxves
from jaxves.base import compiling, status
from jaxves.inputs.scene_files import SceneFile, parse
from jaxves.plots import run_plots
from jaxves.runs.programs import forget
from jaxves.runs.runner import run as run_file

from . import benchmarks
from ._common import HERE, save, store, styled

TARGET = 2.0
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6)
NODES = (48, 64, 96, 128)
MANY = {"budding": (96, 128, 192), "wrinkles": (128, 192, 256), "suspension": (32, 48, 64)}
QUICK = dict(names=("relaxation",), nodes=(32,), tolerances=(1e-3,), share=0.1)

_UPRIGHT = {"reduced_area": 0.9, "angle": 90.0}


def _field(beta: float, ratio: float, **more) -> dict:
    return {"beta": beta, "conductivity_ratio": ratio} | more


def _shear(rate: float) -> dict:
    return {"kind": "shear", "capillary_number": rate}


SCENES = {
    "pop": {"vesicle": [_UPRIGHT], "field": _field(3.2, 0.1)},
    "budding": {"vesicle": [_UPRIGHT | {"reduced_area": 0.5}], "field": _field(12.8, 0.1)},
    "shear": {"vesicle": [{"reduced_area": 0.9}], "flow": _shear(10.0)},
    "sheared_field": {
        "vesicle": [{"reduced_area": 0.9, "angle": 20.0}],
        "field": _field(6.4, 0.1, membrane_conductance=4.0),
        "flow": _shear(10.0),
    },
    "circulation": {
        "vesicle": [_UPRIGHT | {"center": [sign * 1.3 * np.cos(np.pi / 9), sign * 1.3 * np.sin(np.pi / 9)]}
                    for sign in (1, -1)],
        "field": _field(3.2, 0.5),
    },
    "relaxation": {"vesicle": [{"reduced_area": 0.7}]},
    "tumbling": {"vesicle": [{"reduced_area": 0.9}], "flow": _shear(10.0), "fluid": {"viscosity_ratio": 10.0}},
    "charge": {"vesicle": [_UPRIGHT], "field": _field(3.2, 0.1, charge_relaxation=0.01, permittivity_ratio=0.5)},
    "alternating": {"vesicle": [_UPRIGHT], "field": _field(6.4, 0.3, time={"kind": "ac", "frequency": 10.0})},
    "cell": {
        "vesicle": [_UPRIGHT | {"center": [0.0, 0.0]}, _UPRIGHT | {"center": [2.1, 1.5]}],
        "cell": {"lattice": [[4.0, 0.0], [0.0, 4.0]]}, "field": _field(3.2, 0.5), "flow": _shear(5.0),
    },
    "wrinkles": {
        "vesicle": [{"shape": "points", "points": benchmarks.wrinkled(1024).tolist()}], "field": _field(80.0, 0.1)
    },
    "suspension": {
        "vesicle": [{"reduced_area": 0.9, "angle": a, "center": c} for a, c in benchmarks.suspended()],
        "cell": {"lattice": [[22.4, 0.0], [0.0, 11.2]]}, "flow": _shear(5.0)
    },
}  # fmt: skip


def scene(name: str, nodes: int | str, tolerance: float, share=1.0) -> SceneFile:
    """Returns a scene of `benchmarks` as a scene file that ends at the first `share` of its saved times."""
    benchmark = benchmarks.BENCHMARKS[name]
    saves = max(1, round(share * benchmark.saves))
    how = {"t_end": benchmark.t_end * saves / benchmark.saves, "saves": saves}
    how |= {"numerics": {"nodes": nodes, "tolerance": tolerance, "certify": False}}
    return parse(SCENES[name] | how)


def measured(scene_file: SceneFile, best: dict[str, np.ndarray]) -> dict:
    """Returns how a run ends, its error and its seconds without compilation."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        run_file(scene_file, path)
        began = time.perf_counter()
        word = run_file(scene_file, path, force=True)
        seconds = time.perf_counter() - began
        record = jaxves.load(path)
    found = {"word": word, "seconds": seconds, "nodes": int(np.max(record.nodes, initial=0)), "error": None}
    if word in (*status.SUCCESS, "inaccurate"):
        columns = benchmarks.series(record.t, record.diagnostics)
        rows = len(columns["t"])
        apart = benchmarks.differences(columns, {key: values[:rows] for key, values in best.items()})
        found["error"] = max(apart.values())
    return found


def one(name: str, nodes=None, tolerances=TOLERANCES, share=1.0) -> dict:
    """Returns the runs of one scene, with fixed and with adapted nodes, in the order of the tolerances."""
    best, _ = benchmarks.read(name)
    by_hand, auto = [], []
    for tolerance in tolerances:
        for N in nodes or MANY.get(name, NODES):
            row = measured(scene(name, N, tolerance, share), best)
            by_hand.append({"tolerance": tolerance} | row)
        auto.append({"tolerance": tolerance} | measured(scene(name, "auto", tolerance, share), best))
    forget()
    for row in auto:
        enough = [other["seconds"] for other in by_hand if _is_as_good(other, row)]
        row["cost"] = row["seconds"] / min(enough) if enough else None
    return {"by hand": by_hand, "auto": auto}


def _is_as_good(other: dict, row: dict) -> bool:
    return None not in (other["error"], row["error"]) and other["error"] <= row["error"]


def run(names=tuple(SCENES), keep=lambda found: None, **how) -> dict:
    """Returns the runs by scene; `keep` stores what is known so far."""
    found = {}
    for name in names:
        found[name] = one(name, **how)
        print(*lines(name, found[name]), sep="\n", flush=True)
        keep(found)
    return found


def lines(name: str, found: dict):
    """Yields a line for each tolerance."""
    for row in found["auto"]:
        error = "     " if row["error"] is None else f"{row['error']:.0e}"
        cost = "nothing by hand is as accurate" if row["cost"] is None else f"cost {row['cost']:.2f}"
        yield (
            f"{name:14} tolerance {row['tolerance']:.0e}: {row['word']}, error {error}, {row['nodes']} nodes, "
            f"{row['seconds']:.2f} s, {cost}"
        )


@styled
def draw(found: dict, columns=4) -> Figure:
    """Draws error against time for each scene: one line for each number of nodes, and one for adapted nodes."""
    rows = -(-len(found) // columns)
    figure = Figure(figsize=(run_plots.PAGE, 1.7 * rows + 0.4))
    axes = figure.subplots(rows, columns, squeeze=False)
    for place, (name, case) in zip(axes.flat, found.items(), strict=False):
        groups = {}
        for row in case["by hand"]:
            groups.setdefault(row["nodes"], []).append(row)
        for marker, (N, group) in zip("osv^", groups.items(), strict=False):
            _line(place, group, color="0.6", marker=marker, lw=0.8, label=f"{N}")
        _line(place, case["auto"], color="C3", marker="D", lw=1.4, label="adapted")
        place.set(xscale="log", yscale="log", title=name)
        place.legend(fontsize=5)
    for place in axes.flat[len(found) :]:
        place.set_axis_off()
    figure.supxlabel("time in s")
    figure.supylabel("error")
    return figure


def _line(axes, rows: list[dict], **style) -> None:
    good = [row for row in rows if row["error"] is not None]
    axes.plot([row["seconds"] for row in good], [row["error"] for row in good], ms=3, **style)


def main():
    compiling.fast_start()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[[], *SCENES], help="scenes, all by default")
    names = tuple(parser.parse_args().names) or tuple(SCENES)
    path = HERE / "data" / "nodes_and_tolerance.json"
    known = json.loads(path.read_text())["data"] if path.exists() else {}
    found = known | run(names, lambda found: store("nodes_and_tolerance", known | found))
    save(draw({name: found[name] for name in SCENES if name in found}), "nodes_and_tolerance")


if __name__ == "__main__":
    main()
