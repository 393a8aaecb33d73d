"""Does a run know its own error?

    python -m experiments.random_scenes            # a hundred scenes, about an hour on two cores
    python -m experiments.random_scenes --seed 7   # another hundred

Scenes are drawn at random: one vesicle or a pair, with reduced area, field strength, conductivities, conductance,
charging time and flow over the whole range of the model. Half have 64 nodes and half `nodes = "auto"`. Each is run as
by `jaxves run`, which states its error in the certificate. A finer run gives the true error. It has one and a half
times the largest number of nodes of the first, at least 128, and a hundredth of its tolerance. The error is the
largest distance of any node, in a, or difference of V_m, in a E_inf, over all saved times.

What to expect: no run with the status complete has an error of more than ten times the stated one. At least 90 of the
100 are complete and state at most 1e-2. The median of stated over true error is below 10.
"""

import argparse
import collections
import json
import os
import tempfile
from multiprocessing import get_context
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.base import status
from jaxves.inputs.parameters import with_nodes
from jaxves.inputs.scene_files import parse, to_toml
from jaxves.inputs.scene_tables import SceneFile
from jaxves.numerics import fourier
from jaxves.plots import run_plots
from jaxves.results import run_store
from jaxves.runs.build import build
from jaxves.runs.runner import run as run_file
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

from ._common import HERE, save, store, styled

SAVES = 10
_TOGETHER = 5
QUICK = dict(count=2, seed=3, nodes=(32,), longest=0.02)


def drawn(rng: np.random.Generator, nodes=(64, "auto"), longest=0.5) -> SceneFile:
    """Returns one random scene; it ends after a few of its shortest time scales, at most at `longest`."""

    def log(low, high):
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))

    pair = rng.random() < 0.1
    beta, chi = log(0.1, 20.0), log(0.01, 1.0)
    vesicle = {"reduced_area": float(rng.uniform(0.55, 0.99)), "angle": float(rng.uniform(0.0, 180.0))}
    field = {
        "beta": beta,
        "conductivity_ratio": log(1e-3, 1e3),
        "membrane_conductance": 0.0 if rng.random() < 0.5 else log(1e-2, 10.0),
        "chi": chi,
        "permittivity_ratio": log(0.3, 3.0),
    }
    tables = {"vesicle": [vesicle], "field": field}
    rate = beta / chi
    if rng.random() < 0.5:  # between a shear and an extension, in any direction
        strength, turn, mix = log(0.1, 20.0), rng.uniform(0, 2 * np.pi), rng.uniform()
        c, s = strength * np.cos(turn), strength * np.sin(turn)
        spin = mix * strength
        tables["flow"] = {"kind": "linear", "gradient": [[float(c), float(s + spin)], [float(s - spin), float(-c)]]}
        rate = max(rate, 2 * strength)
    if pair:
        tables["pair"] = {"separation": float(rng.uniform(2.8, 4.0)), "offset_angle": float(rng.uniform(0.0, 90.0))}
    tables["t_end"] = round(min(longest, log(5.0, 50.0) / rate), 4)
    tables["numerics"] = {"nodes": nodes[int(rng.integers(len(nodes)))], "tolerance": log(1e-5, 1e-3)}
    return parse(tables | {"saves": SAVES})


@eqx.filter_jit
def _finer(scene, t_end, tolerance):
    result = simulate(scene, t_end, saves=SAVES, march=Adaptive(tolerance, max_steps=20_000))
    return result.x, result.V_m, result.status


def true_error(scene_file: SceneFile, record: run_store.Record) -> tuple[float, str]:
    """Returns the largest distance of a saved run from a finer one, and the status of the finer run."""
    N = max(128, 2 * round(0.75 * int(np.max(record.nodes))))
    scene = build(with_nodes(scene_file, N))
    x, V_m, code = _finer(scene, jnp.asarray(scene_file.t_end), jnp.asarray(0.01 * scene_file.numerics.tolerance))
    T = len(record.t)
    apart = []
    for found, finer in ((record.x, x), (record.V_m, V_m)):
        K = max(found.shape[2], N)
        on = [fourier.resample(jnp.asarray(values), K, axis=2) for values in (found, finer[:T])]
        apart.append(float(jnp.max(jnp.abs(on[0] - on[1]))))
    return max(apart), status.WORDS[int(code)]


def tried(scene_file: SceneFile) -> dict:
    """Returns the stated and the true error of one scene."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.h5"
        word = run_file(scene_file, path, force=True)
        record = run_store.read_result(path)
    stated = record.attributes.get("error", np.nan)
    true, finer = true_error(scene_file, record) if len(record.t) > 1 else (np.nan, "")
    return {
        "scene": record.scene, "word": word, "stated": float(stated), "true": true, "finer": finer,
        "seconds": float(record.attributes["wall_time"]), "nodes": int(np.max(record.nodes)),
    }  # fmt: skip


def run(count=100, seed=1, nodes=(64, "auto"), longest=0.5, known=(), keep=lambda found: None):
    """Returns the stated and true errors of all scenes. `known` are the first of them; `keep` stores results."""
    rng = np.random.default_rng(seed)
    scenes = [drawn(rng, nodes, longest) for _ in range(count)]
    found = list(known)
    if [case["scene"] for case in found] != [to_toml(scene) for scene in scenes[: len(found)]]:
        raise SystemExit("The stored cases are of other scenes: run without --resume.")
    # A process may hold a limited number of compiled programs: each of these ends after a few scenes. A pool replaces
    # it; an executor with `max_tasks_per_child` can then wait forever (Python 3.11).
    with get_context("spawn").Pool(os.cpu_count(), maxtasksperchild=_TOGETHER) as processes:
        for i, case in enumerate(processes.imap(tried, scenes[len(found) :]), start=len(found)):
            found.append(case)
            keep(found)
            print("{:3} {word:14} stated {stated:.1e} true {true:.1e} finer {finer}".format(i, **case), flush=True)
    return found


def verdict(found) -> dict:
    """Returns a summary; ratios are for complete runs whose finer run is complete as well."""
    known = [
        case for case in found if case["word"] in status.SUCCESS and case["finer"] in (*status.SUCCESS, "inaccurate")
    ]
    ratio = np.array([case["stated"] / max(case["true"], 1e-12) for case in known])
    good = [case for case in found if case["word"] in status.SUCCESS and case["stated"] <= 1e-2]
    return {
        "scenes": len(found),
        "words": dict(collections.Counter(case["word"] for case in found)),
        "complete and stated at most 1e-2": len(good),
        "complete without a finer run": sum(case["word"] in status.SUCCESS for case in found) - len(known),
        "off by more than ten times what they state": int(np.sum(ratio < 0.1)),
        "least of stated over true": float(np.min(ratio, initial=np.inf)),
        "median of stated over true": float(np.median(ratio)) if len(ratio) else np.nan,
    }


@styled
def draw(found) -> Figure:
    """Draws stated against true errors of all scenes that end as complete or inaccurate."""
    figure = Figure(figsize=(0.6 * run_plots.PAGE, 0.5 * run_plots.PAGE))
    axes = figure.subplots()
    for word, marker in (("complete", "o"), ("inaccurate", "x")):
        cases = [case for case in found if case["word"] == word and np.isfinite(case["stated"])]
        if cases:
            axes.loglog([c["true"] for c in cases], [c["stated"] for c in cases], marker, ms=3, lw=0, label=word)
    ends = np.array([1e-8, 1.0])
    axes.loglog(ends, ends, "k-", lw=0.6, label="stated = true")
    axes.loglog(ends, 0.1 * ends, "k:", lw=0.6, label="a tenth of the true error")
    axes.set(xlabel="true error (a, or a E∞ of V_m)", ylabel="stated error", xlim=ends, ylim=ends)
    axes.legend(loc="lower right")
    return figure


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--resume", action="store_true")
    arguments = parser.parse_args()
    seed, known = arguments.seed, []
    if arguments.resume:
        stored = json.loads((HERE / "data" / "random_scenes.json").read_text())["data"]
        seed, known = stored["seed"], stored["cases"]

    def keep(found):
        store("random_scenes", {"seed": seed, "verdict": verdict(found), "cases": found})

    found = run(arguments.count, seed, known=known, keep=keep)
    for name, value in verdict(found).items():
        print(f"{name}: {value}")
    save(draw(found), "random_scenes")


if __name__ == "__main__":
    main()
