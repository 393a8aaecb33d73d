"""How long does a given accuracy take, by scheme, and does the tolerance mean anything?

    python -m experiments.convergence          # tables and figures, about fifteen minutes

Four scenes: prolate to oblate and back (POP), a budding vesicle through its narrowest neck, tank-treading in a field,
and a pair. Error is the largest over the saved instants of the distance between the outlines, whatever their nodes,
of V_m, and of the tension relative to its largest (`_distance`); the reference is a fifth-order solution with more
nodes and a tolerance at least ten times tighter. Time is the median of warm runs, which take turns, one BLAS thread.

"Euler" is the first-order scheme with a fixed step and nothing corrected, as in the paper; the others control their
step and project. ARK2 and ARK3 are baselines that the package itself does not have (`_schemes`).

What to expect: each digit costs a factor of 10 (Euler), 3.2, 2.2, 1.8, 1.6 (orders 2 to 5) until the nodes limit it,
and errors in proportion to the tolerance. What a scene makes of a disturbance of its start is its amplification: no
tolerance per step can bound the error of the run closer than that.
"""

import itertools
import time

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves import fourier, plot, shapes, status
from jaxves.curve import Curve
from jaxves.marching import Adaptive, Checks
from jaxves.scene import Scene, dc_field, make_scene
from jaxves.steppers import ARK4, ARK5, SemiImplicitEuler

from ._common import march, pop, save, store, styled, treading
from ._distance import distances
from ._schemes import ARK2, ARK3, Even

SCHEMES = {"Euler": SemiImplicitEuler(), "ARK2": ARK2(), "ARK3": ARK3(), "ARK4": ARK4(), "ARK5": ARK5()}
RATES = {"Euler": 1, "ARK2": 3, "ARK3": 4, "ARK4": 6, "ARK5": 8}  # a step
PARTS = ("shape", "V_m", "tension")
_ALL = Checks(tail=np.inf, drift=np.inf)  # judged here by their error alone


def budding(N: int) -> Scene:
    return pop(N, reduced_area=0.5, beta=12.8)


def pair(N: int) -> Scene:
    """Two vesicles side by side and a little askew, which circle each other."""
    field = dc_field(3.2, conductivity_ratio=0.5, vesicles=2)
    return make_scene([shapes.ellipse(N, 0.9, angle=jnp.pi / 2)] * 2, centers=[[1.25, 0.4], [-1.25, -0.4]], field=field)


# scene, t_end, saves, and nodes and tolerance of the reference
SCENES = {
    "POP": (pop, 1.0, 20, (128, 1e-10)),
    "budding": (budding, 0.25, 10, (192, 1e-8)),
    "tank-treading": (treading, 0.2, 10, (128, 1e-10)),
    "pair": (pair, 1.0, 10, (96, 1e-9)),
}


def _tolerances(*last):
    """{scheme: tolerances} from 1e-3 down to 1e-`last` of ARK2, ARK3, ARK4 and ARK5 (None: not at all)."""
    names = ("ARK2", "ARK3", "ARK4", "ARK5")
    return {name: tuple(10.0**-k for k in range(3, to + 1)) for name, to in zip(names, last, strict=True) if to}


# by scene and nodes: numbers of steps for Euler, tolerances for the others
PLAN = {
    "POP": {
        64: {"Euler": (500, 1000, 2000, 4000)} | _tolerances(6, 7, 7, 7),
        96: _tolerances(None, None, 8, 8),
        256: {"ARK5": (1e-4, 1e-7)},
    },
    "budding": {128: {"Euler": (1000, 2000)} | _tolerances(5, 6, 7, 7)},
    "tank-treading": {
        64: {"Euler": (200, 400, 800, 1600)} | _tolerances(6, 7, 7, 7),
        96: _tolerances(None, None, 8, 8),
    },
    "pair": {64: {"Euler": (200, 400, 800)} | _tolerances(5, 6, 7, 7)},
}
QUICK = dict(
    plan={"tank-treading": {32: {"Euler": (40,), "ARK4": (1e-3, 1e-4)}}},
    references={"tank-treading": (32, 1e-6)},
    repeats=1,
)


def method_of(scheme, setting, saves):
    """Fixed steps for Euler, else a tolerance."""
    if scheme == "Euler":
        return Even(setting // saves, SCHEMES[scheme], projection=False)
    return Adaptive(setting, SCHEMES[scheme])


def solve(name, N, method, shift=None):
    """Last state, and the rows of a run that arrived (else None)."""
    make, t_end, saves, _ = SCENES[name]
    scene = make(N) if shift is None else shift(make(N))
    state, rows, _ = march(scene, method, t_end * np.arange(1, saves + 1) / saves, checks=_ALL, together=saves)
    arrived = int(state.status) == status.RUNNING and np.all(np.isfinite(rows["x"]))
    return state, rows if arrived else None


def timed(calls, repeats):
    """What each call returned, and its seconds: `repeats` runs of each, in turns, after one that compiles."""
    results = {key: call() for key, call in calls.items()}
    seconds = {key: [] for key in calls}
    for _ in range(repeats):
        for key, call in calls.items():
            start = time.perf_counter()
            call()
            seconds[key].append(time.perf_counter() - start)
    return results, {key: float(np.median(found)) for key, found in seconds.items()}


def against_time(name, N, schemes, reference, repeats):
    """{scheme: {settings, steps, rejected, rates, seconds, shape, V_m, tension}}; NaN where a run broke down."""
    saves = SCENES[name][2]
    keys = [(scheme, setting) for scheme, settings in schemes.items() for setting in settings]
    calls = {key: lambda key=key: solve(name, N, method_of(*key, saves)) for key in keys}
    results, seconds = timed(calls, repeats)
    found = {}
    for scheme, settings in schemes.items():
        table = {"settings": list(settings), "steps": [], "rejected": [], "rates": [], "seconds": []}
        table |= {part: [] for part in PARTS}
        for setting in settings:
            state, rows = results[scheme, setting]
            steps, rejected = int(state.steps), int(state.rejected)
            table["steps"].append(steps)
            table["rejected"].append(rejected)
            table["rates"].append(RATES[scheme] * steps + (RATES[scheme] - 1) * rejected)
            table["seconds"].append(seconds[scheme, setting])
            apart = None if rows is None else distances(rows, reference)
            for part in PARTS:
                table[part].append(np.nan if apart is None else float(np.max(apart[part])))
        found[scheme] = table
    return found


def amplification(name, N, reference, tolerance=1e-8, size=1e-5, seed=0):
    """How much the run enlarges a smooth random displacement of its start: shape, by saved instant."""
    modes = np.random.default_rng(seed).normal(size=(2, 6, 1 + (name == "pair")))

    def shift(scene):
        alpha = fourier.grid(N)
        k = jnp.arange(6)[:, None]
        bumps = jnp.einsum("ckm,ckn->mn", modes, jnp.stack([jnp.cos(k * alpha), jnp.sin(k * alpha)]))
        bumps = size * bumps / jnp.max(jnp.abs(bumps))
        normals = jnp.stack([Curve.from_nodes(x).normal for x in scene.x])
        return Scene(scene.x + bumps[..., None] * normals, scene.bending, scene.field, scene.flow)

    _, rows = solve(name, N, Adaptive(tolerance, ARK5()), shift)
    return distances(rows, reference)["shape"] / size


def run(plan=None, references=None, repeats=3):
    """{scene: {"reference": its distance to one ten times looser, "nodes": {N: {scheme: table}}}}."""
    plan, references = plan or PLAN, references or {}
    found = {}
    for name, sizes in plan.items():
        N, tolerance = references.get(name, SCENES[name][3])
        _, reference = solve(name, N, Adaptive(tolerance, ARK5()))
        _, looser = solve(name, N, Adaptive(10 * tolerance, ARK5()))
        apart = {part: float(np.max(value)) for part, value in distances(looser, reference).items()}
        found[name] = {"reference": {"N": N, "tolerance": tolerance} | apart}
        found[name]["nodes"] = {N: against_time(name, N, which, reference, repeats) for N, which in sizes.items()}
    return found


def seconds_for(table, error, part="shape"):
    """Seconds until `part` is right to `error`: log-log between the two runs about it, or beyond the last by its order.

    Returns the seconds and the measured order (of the error in the time) that was used; NaN where the error is never
    reached and does not fall.
    """
    points = [(e, s) for e, s in zip(table[part], table["seconds"], strict=True) if np.isfinite(e)]
    for (e0, s0), (e1, s1) in itertools.pairwise(points):
        if e0 >= error >= e1:
            slope = np.log(s1 / s0) / np.log(e0 / e1)
            return s0 * (e0 / error) ** slope, 1 / slope
    if points and points[0][0] < error:
        return points[0][1], np.nan
    if len(points) < 2 or points[-1][0] >= points[-2][0]:
        return np.nan, np.nan
    (e0, s0), (e1, s1) = points[-2:]
    slope = np.log(s1 / s0) / np.log(e0 / e1)
    return s1 * (e1 / error) ** slope, 1 / slope


def tolerances(table):
    """Largest of the errors of shape and V_m over the tolerance, and the slope of their logarithms."""
    error = np.maximum(table["shape"], table["V_m"])
    asked = np.asarray(table["settings"])
    return error / asked, float(np.polyfit(np.log(asked), np.log(error), 1)[0]) if len(asked) > 1 else np.nan


@styled
def draw(found) -> Figure:
    """A panel a scene: error of the shape against seconds."""
    figure = Figure(figsize=(plot.PAGE, 2.4))
    panels = np.atleast_1d(figure.subplots(1, len(found), sharey=True))
    for axes, (name, scene) in zip(panels, found.items(), strict=True):
        for N, marker in zip(scene["nodes"], "os^", strict=False):
            for scheme, table in scene["nodes"][N].items():
                color = f"C{list(SCHEMES).index(scheme)}"
                axes.loglog(table["seconds"], table["shape"], f"-{marker}", color=color, ms=3, label=f"{scheme}, {N}")
        axes.set(title=name, xlabel="seconds")
        axes.legend(fontsize=5)
    panels[0].set_ylabel("largest error of the shape")
    return figure


def main():
    found = run()
    for name, scene in found.items():
        print(f"{name}: reference {scene['reference']}")
        for N, schemes in scene["nodes"].items():
            for scheme, table in schemes.items():
                print(f"  N = {N}, {scheme}: setting  steps  rejected  rates  seconds  shape    V_m      λ")
                for i, setting in enumerate(table["settings"]):
                    counts = "".join(f"{table[key][i]:9d}" for key in ("steps", "rejected", "rates"))
                    errors = "".join(f"  {table[part][i]:.1e}" for part in PARTS)
                    print(f"{setting:24.0e}{counts}  {table['seconds'][i]:7.3f}{errors}")
    store("convergence", found)
    save(draw(found), "convergence")


if __name__ == "__main__":
    main()
