"""How long does a given accuracy take with each scheme, and is the error proportional to the tolerance?

    python -m experiments.convergence          # table and figure, one to two hours
    python -m experiments.convergence POP      # this scene again; the stored numbers of the others stay

Four scenes are computed: prolate to oblate and back (POP), a budding vesicle up to its narrowest neck, tank-treading
in a field, and a pair. The error is the largest over the saved times of the distance between the outlines, of the
difference in V_m, and of that in the tension relative to its largest value (`_distance`). The reference is a
fifth-order solution with more nodes and a tolerance that is at least ten times smaller. Runs are timed after
compilation, in turns, with one BLAS thread. "seconds" are the median of the processor time, which other work on the
machine disturbs less than the elapsed time, "wall".

"Euler" is the first-order scheme of the paper, with a fixed step and without projection. The others control their step
and project. ARK2 and ARK3 are for comparison only and not part of the package (`_schemes`).

What to expect: each digit costs a factor of 10 (Euler), 3.2, 2.2, 1.8, 1.6 (orders 2 to 5) until the nodes limit the
error. Errors are proportional to the tolerance. The flow amplifies a disturbance of the start by a certain factor; the
error of the run cannot be bounded more closely than this factor allows.
"""

import itertools
import json
import sys
import time

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.observables.checks import Checks
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.schemes import ARK4, ARK5, SemiImplicitEuler, for_tolerance

from ._common import HERE, march, pop, save, store, styled, treading
from ._distance import distances
from ._schemes import ARK2, ARK3, Even

SCHEMES = {"Euler": SemiImplicitEuler(), "ARK2": ARK2(), "ARK3": ARK3(), "ARK4": ARK4(), "ARK5": ARK5()}
RATES = {"Euler": 1, "ARK2": 3, "ARK3": 4, "ARK4": 6, "ARK5": 8}  # a step
PARTS = ("shape", "V_m", "tension")
LABELS = {"Euler": "first order, fixed steps"} | {f"ARK{p}": f"order {p}, adaptive" for p in (2, 3, 4, 5)}
JUDGED = ("settings", "shape", "V_m")  # of a table, whether the tolerance is kept
_ENOUGH = 192  # nodes, to follow a displacement of 1e-4
_ALL = Checks(tail=np.inf, drift=np.inf)  # judged here by their error alone


def budding(N: int) -> Scene:
    return pop(N, reduced_area=0.5, beta=12.8)


def pair(N: int) -> Scene:
    """Returns two vesicles side by side and slightly tilted, which circulate."""
    field = dc_field(3.2, conductivity_ratio=0.5, vesicles=2)
    return make_scene([shapes.ellipse(N, 0.9, angle=jnp.pi / 2)] * 2, centers=[[1.25, 0.4], [-1.25, -0.4]], field=field)


# scene, t_end, saves, and nodes and tolerance of the reference
SCENES = {
    "POP": (pop, 1.0, 20, (128, 1e-10)),
    "budding": (budding, 0.25, 10, (320, 1e-8)),
    "tank-treading": (treading, 1.0, 10, (128, 1e-10)),  # long enough that the saved instants do not set the step
    "pair": (pair, 1.0, 10, (96, 1e-9)),
}


def _tolerances(*last):
    """{scheme: tolerances} from 1e-3 down to 1e-`last` of ARK2, ARK3, ARK4 and ARK5 (None: not at all)."""
    names = ("ARK2", "ARK3", "ARK4", "ARK5")
    return {name: tuple(10.0**-k for k in range(3, to + 1)) for name, to in zip(names, last, strict=True) if to}


# by scene and nodes: numbers of steps for Euler, tolerances for the others
PLAN = {
    "POP": {
        64: {"Euler": (500, 1000, 2000)} | _tolerances(5, 6, 7, 7),
        96: _tolerances(None, None, 6, 9),
        256: {"ARK4": (1e-4,), "ARK5": (1e-7,)},
    },
    "budding": {
        128: {"Euler": (1000, 2000)} | _tolerances(4, 5, 6, 6),
        192: _tolerances(None, None, 5, 7),
        256: {"ARK5": (1e-7,)},
    },
    "tank-treading": {
        64: {"Euler": (1000, 2000, 4000)} | _tolerances(5, 6, 7, 7),
        96: _tolerances(None, None, None, 8),
    },
    "pair": {64: {"Euler": (200, 400)} | _tolerances(4, 5, 6, 7)},
}
# nodes that resolve what is asked for, and the least tolerance for which they do
RESOLVED = {
    "POP": {96: 1e-7},
    "budding": {192: 1e-6, 256: 1e-7},
    "tank-treading": {64: 1e-7},
    "pair": {64: 1e-7},
}
QUICK = dict(
    plan={"tank-treading": {32: {"Euler": (40,), "ARK4": (1e-3, 1e-4)}}},
    references={"tank-treading": (32, 1e-6)},
    repeats=1,
)


def method_of(scheme, setting, saves):
    """Returns fixed steps for Euler, otherwise adaptive steps with a tolerance."""
    if scheme == "Euler":
        return Even(setting // saves, SCHEMES[scheme], projection=False)
    return Adaptive(setting, SCHEMES[scheme])


def solve(name, N, method):
    """Returns the last state, and the rows of a complete run (otherwise None)."""
    state, rows = followed(name, SCENES[name][0](N), method)
    arrived = int(state.status) == status.RUNNING and np.all(np.isfinite(rows["x"]))
    return state, rows if arrived else None


def followed(name, scene, method):
    """Last state and rows, NaN from where it broke down, of a scene over the span and the instants of scene `name`."""
    _, t_end, saves, _ = SCENES[name]
    state, rows, _ = march(scene, method, t_end * np.arange(1, saves + 1) / saves, checks=_ALL)
    return state, rows


def timed(calls, repeats):
    """What each call returned, and medians of processor and wall seconds of `repeats` runs of each, in turns."""
    results = {key: call() for key, call in calls.items()}  # compiles
    seconds, wall = ({key: [] for key in calls} for _ in range(2))
    for _ in range(repeats):
        for key, call in calls.items():
            start = time.process_time(), time.perf_counter()
            call()
            seconds[key].append(time.process_time() - start[0])
            wall[key].append(time.perf_counter() - start[1])
    return results, {key: (float(np.median(seconds[key])), float(np.median(wall[key]))) for key in calls}


def against_time(name, N, schemes, reference, repeats):
    """{scheme: {settings, steps, rejected, rates, seconds, wall, shape, V_m, tension}}; NaN where a run broke down."""
    saves = SCENES[name][2]
    keys = [(scheme, setting) for scheme, settings in schemes.items() for setting in settings]
    calls = {key: lambda key=key: solve(name, N, method_of(*key, saves)) for key in keys}
    results, seconds = timed(calls, repeats)
    found = {}
    for scheme, settings in schemes.items():
        table = {"settings": list(settings)}
        table |= {key: [] for key in ("steps", "rejected", "rates", "seconds", "wall", *PARTS)}
        for setting in settings:
            state, rows = results[scheme, setting]
            steps, rejected = int(state.steps), int(state.rejected)
            table["steps"].append(steps)
            table["rejected"].append(rejected)
            table["rates"].append(RATES[scheme] * steps + (RATES[scheme] - 1) * rejected)
            for kind, value in zip(("seconds", "wall"), seconds[scheme, setting], strict=True):
                table[kind].append(value)
            apart = None if rows is None else distances(rows, reference)
            for part in PARTS:
                table[part].append(np.nan if apart is None else float(np.max(apart[part])))
        found[scheme] = table
    return found


def amplification(name, reference, size=1e-4, tolerance=1e-6, starts=5, seed=0):
    """By instant at which the first vesicle is displaced a little: how many times as large the change is at its most.

    The displacement is smooth, random and normal to the membrane; the change is that of shape or V_m at any later
    saved instant, NaN where the run broke down. A lone vesicle is displaced in keeping with its symmetry, as its
    motion keeps it. One vesicle alone moves: a displacement of all together would be none.
    """
    make, t_end, saves, _ = SCENES[name]
    M, N = reference["x"].shape[1], min(reference["x"].shape[2], _ENOUGH)
    scene = make(N)
    x, V_m = (np.asarray(fourier.resample(jnp.asarray(reference[part]), N, axis=2)) for part in ("x", "V_m"))
    x = np.concatenate([scene.x[None], x])
    V_m = np.concatenate([np.zeros((1, M, N)), V_m])
    modes = np.random.default_rng(seed).normal(size=(2, 6))
    modes[1] *= M > 1 or scene.flow is not None  # mirrored in an axis
    k = (2 if M == 1 else 1) * np.arange(6)[:, None] * fourier.grid(N)
    bumps = modes[0] @ np.cos(k) + modes[1] @ np.sin(k)
    bumps *= size / np.max(np.abs(bumps))

    parts = ("x", "V_m", "tension")
    found = {}
    for i in range(0, saves, max(1, saves // starts)):
        moved = x[i, 0] + bumps[:, None] * Curve.from_nodes(jnp.asarray(x[i, 0])).normal
        shifted = Scene(jnp.asarray(x[i]).at[0].set(moved), scene.bending, scene.field, scene.flow, jnp.asarray(V_m[i]))
        _, rows = followed(name, shifted, Adaptive(tolerance, ARK5()))
        apart = distances({p: rows[p][: saves - i] for p in parts}, {p: reference[p][i:] for p in parts})
        found[i * t_end / saves] = float(np.max([apart["shape"], apart["V_m"]]) / size)
    return found


def run(plan=None, references=None, repeats=3):
    """{scene: {"reference": its distance to one ten times looser, "amplification", "nodes": {N: {scheme: table}}}}."""
    plan, references = plan or PLAN, references or {}
    found = {}
    for name, sizes in plan.items():
        N, tolerance = references.get(name, SCENES[name][3])
        _, reference = solve(name, N, Adaptive(tolerance, ARK5()))
        _, looser = solve(name, N, Adaptive(10 * tolerance, ARK5()))
        apart = {part: float(np.max(value)) for part, value in distances(looser, reference).items()}
        found[name] = {
            "reference": {"N": N, "tolerance": tolerance} | apart,
            "amplification": amplification(name, reference),
            "nodes": {str(N): against_time(name, N, which, reference, repeats) for N, which in sizes.items()},
        }
    return found


def seconds_for(table, error, part="shape"):
    """Seconds until `part` is right to `error`: log-log between the two runs about it, or beyond the last by its order.

    Returns the seconds and, beyond the last run, the measured order in the steps that was used (else NaN); NaN twice
    where the error is not reached and does not fall.
    """
    runs = zip(table[part], table["seconds"], table["steps"], strict=True)
    runs = [run for run in runs if np.isfinite(run[0])]
    if runs and runs[0][0] <= error:
        return runs[0][1], np.nan
    for (e0, s0, _), (e1, s1, _) in itertools.pairwise(runs):
        if e0 >= error >= e1:
            return s0 * (s1 / s0) ** (np.log(e0 / error) / np.log(e0 / e1)), np.nan
    if len(runs) < 2 or runs[-1][0] >= runs[-2][0]:
        return np.nan, np.nan
    (e0, _, n0), (e1, seconds, n1) = runs[-2:]
    order = np.log(e0 / e1) / np.log(n1 / n0)
    return seconds * (e1 / error) ** (1 / order), order


def tolerances(table):
    """Largest of the errors of shape and V_m over the tolerance, and the slope of their logarithms."""
    error = np.maximum(table["shape"], table["V_m"])
    asked = np.asarray(table["settings"])
    return error / asked, float(np.polyfit(np.log(asked), np.log(error), 1)[0]) if len(asked) > 1 else np.nan


def by_default(schemes, vesicles):
    """What `tolerances` needs, of the runs that `method = "auto"` makes, by falling tolerance."""
    runs = [
        run
        for scheme in ("ARK4", "ARK5")
        if scheme in schemes
        for run in zip(*(schemes[scheme][part] for part in JUDGED), strict=True)
        if type(SCHEMES[scheme]) is type(for_tolerance(run[0], vesicles))
    ]
    return dict(zip(JUDGED, zip(*sorted(runs, reverse=True), strict=True), strict=True))


def resolved(nodes, least, vesicles):
    """Likewise, each with the fewest nodes that resolve it: `least` is {nodes: least tolerance}."""
    runs, above = [], np.inf
    for N, tolerance in least.items():
        table = by_default(nodes[str(N)], vesicles)
        runs += [run for run in zip(*table.values(), strict=True) if 0.9 * tolerance < run[0] < 0.9 * above]
        above = tolerance
    return dict(zip(JUDGED, zip(*runs, strict=True), strict=True))


@styled
def draw(found) -> Figure:
    """Draws the error of the shape against seconds for one scene, POP if it is there: the best number of nodes."""
    name, scene = ("POP", found["POP"]) if "POP" in found else next(iter(found.items()))
    figure = Figure(figsize=(run_plots.COLUMN + 0.6, 2.6))
    axes = figure.add_subplot()
    for scheme in SCHEMES:
        tables = [tables[scheme] for tables in scene["nodes"].values() if scheme in tables]
        seconds, errors = best(tables)
        axes.loglog(seconds, errors, ".-", ms=5, color=_color(scheme), label=LABELS[scheme])
    axes.set(title=f"{name} to t = 1", xlabel="run time (seconds)", ylabel="largest error of the shape ($a$)")
    low, high = axes.get_xlim()
    ticks = [tick for tick in (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50) if low <= tick <= high]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.xaxis.set_minor_formatter("")
    axes.legend()
    return figure


def best(tables) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times and errors of those runs of which no other run of these tables is faster and more accurate."""
    pairs = [pair for table in tables for pair in zip(table["seconds"], table["shape"], strict=True)]
    kept = []
    for seconds, error in sorted(pair for pair in pairs if np.all(np.isfinite(pair))):
        if not kept or error < kept[-1][1]:
            kept.append((seconds, error))
    return np.reshape(kept, (-1, 2)).T


def _color(scheme):
    return f"C{list(SCHEMES).index(scheme)}"


def _proportion(table) -> str:
    ratio, slope = tolerances(table)
    return f"error over tolerance {', '.join(f'{r:.2g}' for r in ratio)}; slope {slope:.2f}"


def report(found) -> None:
    """Prints the results of `run` and what follows from them."""
    for name, scene in found.items():
        grown = ", ".join(f"{g:.3g} (t = {float(t):g})" for t, g in scene["amplification"].items())
        print(f"{name}: reference {scene['reference']}; displacements grow, by their instant, {grown} times")
        vesicles = len(SCENES[name][0](32).x)
        for N, schemes in scene["nodes"].items():
            for scheme, table in schemes.items():
                print(f"  N = {N}, {scheme}: setting    steps rejected    rates  seconds     wall  shape    V_m      λ")
                for i, setting in enumerate(table["settings"]):
                    counts = "".join(f"{table[key][i]:9d}" for key in ("steps", "rejected", "rates"))
                    times = "".join(f"  {table[key][i]:7.3f}" for key in ("seconds", "wall"))
                    errors = "".join(f"  {table[part][i]:.1e}" for part in PARTS)
                    print(f"{setting:26.0e}{counts}{times}{errors}")
                if scheme != "Euler":
                    print(f"    {_proportion(table)}")
            if {"ARK4", "ARK5"} <= schemes.keys():
                print(f'  N = {N}, as method = "auto" chooses: {_proportion(by_default(schemes, vesicles))}')
        least = RESOLVED[name]
        if all(str(N) in scene["nodes"] for N in least):
            kept = _proportion(resolved(scene["nodes"], least, vesicles))
            print(f"  N = {' and '.join(map(str, least))}, likewise, where they resolve it: {kept}")
    if "Euler" in (schemes := found.get("POP", {}).get("nodes", {}).get("64", {})):
        euler, order = seconds_for(schemes["Euler"], 1e-4)
        ours, _ = seconds_for(schemes["ARK4"], 1e-4)
        print(
            f"POP to 1e-4: {ours:.2f} s; Euler at its order {order:.2f} {euler:.0f} s, {euler / ours:.0f} times as long"
        )
        tables = [table for schemes in found["POP"]["nodes"].values() for table in schemes.values()]
        least = [
            min((seconds_for(table, e)[0] for table in tables if np.nanmin(table["shape"]) <= e), default=np.nan)
            for e in (1e-4, 1e-7)
        ]
        print(f"POP, the fastest: 1e-4 in {least[0]:.2f} s, 1e-7 in {least[1]:.2f} s, {least[1] / least[0]:.1f} times")


def main(names):
    if unknown := [name for name in names if name not in SCENES]:
        sys.exit(f"scene {unknown[0]!r}: expected some of {', '.join(SCENES)}")
    path = HERE / "data" / "convergence.json"
    found = json.loads(path.read_text())["data"] if names and path.exists() else {}
    for name in names or SCENES:
        found |= run({name: PLAN[name]})
        store("convergence", found)
    found = {name: found[name] for name in SCENES if name in found}
    report(found)
    save(draw(found), "convergence")


if __name__ == "__main__":
    main(sys.argv[1:])
