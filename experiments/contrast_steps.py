r"""Do time steps keep order 4 with another viscosity inside, and what do steps and accuracy cost then?

    python -m experiments.contrast_steps      # tables and figure, about five minutes

One vesicle, Δ = 0.9, in a shear of Ca = 10, treads with ν = 2 and tumbles with ν = 10. Runs with equal steps of ARK4
are compared with a run of more steps at the same 64 nodes, and so are adaptive runs at several tolerances. Then single
steps are timed in turns, in one thread: without another viscosity, with it, and for two vesicles that are far apart or
close to each other.

What to expect: order 4 until errors of 1e-10, and errors that fall with the tolerance. Each evaluation of F needs the
matrix of the double layer and another LU factorisation of 2N unknowns.
"""

import time

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.geometry import shapes
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.schemes import ARK4

from ._common import interleaved, march, save, shades, store, styled
from ._schemes import Even
from .charge_steps import slopes
from .throughput import compiled, equation_for, step

MOTIONS = {"treading": (2.0, 0.2), "tumbling": (10.0, 0.4)}  # ν and the end of the run
COUNTS, EXACT = (16, 32, 64, 128), 512
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7)
PLACES = {"far pair": 6.0, "near pair": 0.1}  # gap between the ends of two vesicles one behind the other
QUICK = dict(motions=("treading",), counts=(4, 8), exact=32, tolerances=(1e-2,), nodes=32, timed=(32,), repeats=1)


def scene(nodes: int, ratio: float | None, gap: float | None = None) -> Scene:
    """Returns one vesicle, or two with a gap between them, in shear."""
    shape = shapes.ellipse(nodes, 0.9, angle=jnp.pi / 8 if gap is None else 0.0)
    half = None if gap is None else 0.5 * gap + float(jnp.max(shape[:, 0]))
    centers = [[0.0, 0.0]] if half is None else [[-half, 0.0], [half, 0.0]]
    return make_scene([shape] * len(centers), centers=centers, flow=Shear(10.0), viscosity_ratio=ratio)


def accuracy(motion: str, counts, exact, tolerances, nodes) -> dict:
    """Returns errors of the nodes with equal steps and their orders, and errors and seconds by tolerance."""
    ratio, t_end = MOTIONS[motion]
    given = scene(nodes, ratio)

    def end(method):
        return march(given, method, [t_end])[1]["x"][-1]

    right = end(Even(exact, ARK4()))
    errors = [float(np.max(np.abs(end(Even(count, ARK4())) - right))) for count in counts]
    adaptive = {}
    for tolerance in tolerances:
        method = Adaptive(tolerance)
        end(method)  # compiles
        start = time.process_time()
        state, rows, _ = march(given, method, [t_end])
        adaptive[tolerance] = {
            "error": float(np.max(np.abs(rows["x"][-1] - right))),
            "seconds": time.process_time() - start,
            "steps": int(state.steps),
        }
    return {"errors": errors, "orders": slopes(errors, counts), "adaptive": adaptive}


def costs(timed, repeats) -> dict:
    """Returns by number of nodes the seconds of a plain step, and ratios of steps: medians over the turns."""
    found = {}
    for nodes in timed:
        kinds = {"plain": scene(nodes, None), "contrast": scene(nodes, 10.0)}
        kinds |= {name: scene(nodes, 10.0, gap) for name, gap in PLACES.items()}
        calls = {}
        for name, given in kinds.items():
            equation = equation_for(given)
            calls[name] = compiled(step, equation, equation.start(), jnp.asarray(1e-3))[0]
        seconds = {name: np.array(turns) for name, turns in interleaved(calls, repeats).items()}
        found[nodes] = {"plain": float(np.median(seconds["plain"]))} | {
            f"{name} / {unit}": float(np.median(seconds[name] / seconds[unit]))
            for name, unit in (("contrast", "plain"), ("far pair", "contrast"), ("near pair", "contrast"))
        }
    return found


def run(
    motions=tuple(MOTIONS), counts=COUNTS, exact=EXACT, tolerances=TOLERANCES, nodes=64, timed=(64, 128), repeats=41
) -> dict:
    """Returns errors, orders and seconds by motion, and the costs of steps by number of nodes."""
    return {
        "counts": counts,
        "costs": costs(timed, repeats),
        "motions": {motion: accuracy(motion, counts, exact, tolerances, nodes) for motion in motions},
    }


@styled
def draw(found) -> Figure:
    """Draws errors against equal steps, and against the seconds of adaptive runs."""
    figure = Figure(figsize=(run_plots.PAGE, 2.6))
    left, right = figure.subplots(1, 2)
    counts = np.array(found["counts"], dtype=float)
    for (motion, rows), colour in zip(found["motions"].items(), shades(len(found["motions"])), strict=True):
        label = rf"{motion}, $\nu = {MOTIONS[motion][0]:g}$"
        left.loglog(counts, rows["errors"], "o-", color=colour, ms=3, label=label)
        left.loglog(counts, rows["errors"][0] * (counts / counts[0]) ** -4.0, ":", color=colour, lw=1)
        adaptive = list(rows["adaptive"].values())
        right.loglog([row["seconds"] for row in adaptive], [row["error"] for row in adaptive], "o-", color=colour, ms=3)
    left.set_xticks(counts, [f"{count:g}" for count in counts])
    left.minorticks_off()
    right.set_xticks([0.1, 0.2], ["0.1", "0.2"])
    right.minorticks_off()
    left.set(xlabel="equal steps (dotted: order 4)", ylabel="largest error of the nodes")
    right.set(xlabel="processor time of an adaptive run (s)", ylabel="largest error of the nodes")
    left.legend()
    return figure


def main():
    found = run()
    for nodes, row in found["costs"].items():
        print(nodes, "nodes:", ", ".join(f"{name} {value:.3g}" for name, value in row.items()))
    for motion, rows in found["motions"].items():
        print(motion, "errors", " ".join(f"{e:.1e}" for e in rows["errors"]), "orders", np.round(rows["orders"], 2))
        for tolerance, row in rows["adaptive"].items():
            print(f"  {tolerance:g}: error {row['error']:.1e}, {row['seconds']:.2f} s, {row['steps']} steps")
    store("contrast_steps", found)
    save(draw(found), "contrast_steps")


if __name__ == "__main__":
    main()
