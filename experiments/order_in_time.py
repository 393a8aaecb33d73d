"""Which order in time do the schemes reach, and what does a given accuracy cost?

    python -m experiments.order_in_time          # table and a figure, about two minutes

Two scenes with 96 nodes and fixed steps: prolate to oblate and back, and tank-treading in a field. Shape, potential
and tension are compared with a fifth-order solution with more steps than any of the others.

What to expect: slopes of about 4 and 5 in all three, and 1 for the semi-implicit Euler scheme. Its area and length
also drift at first order, while the projection keeps those of the others to round-off. There is no entry if a run
breaks down with too few steps. Euler takes eight times as many steps, to show its order.
"""

import time

import jax
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxves.observables.checks import Checks
from jaxves.plots import run_plots
from jaxves.stepping.schemes import ARK4, ARK5, SemiImplicitEuler

from ._common import march, pop, save, store, styled, treading
from ._schemes import Even

SCENES = {"POP": (pop, 0.3), "tank-treading": (treading, 0.2)}
# stepper, whether to project, and how many times as many steps, so that what is seen is its order
METHODS = {
    "ARK4": (ARK4(), True, 1),
    "ARK5": (ARK5(), True, 1),
    "Euler, unprojected": (SemiImplicitEuler(), False, 8),
}
PARTS = ("x", "V_m", "tension")
QUICK = dict(scenes=("tank-treading",), methods=("ARK4",), sizes=(20, 40), N=64, reference=160)
_ALL = Checks(tail=np.inf, drift=np.inf)  # judged here by their error alone


def solution(scene, t_end, stepper, projection, steps):
    """Final x, V_m, tension, and the relative errors of area and length; NaN when the run broke down."""
    _, rows, equation = march(scene, Even(steps, stepper, projection), [t_end], checks=_ALL)
    last = {part: rows[part][-1] for part in PARTS}
    last["area"] = rows["area"][-1] / np.asarray(equation.area) - 1
    last["length"] = rows["length"][-1] / (2 * np.pi * np.asarray(equation.speed)) - 1
    arrived = all(np.all(np.isfinite(last[part])) for part in PARTS)
    return last if arrived else jax.tree.map(lambda a: a + np.nan, last)


def largest(a) -> float:
    return float(np.max(np.abs(a)))


def run(scenes=tuple(SCENES), methods=tuple(METHODS), sizes=(20, 40, 80, 160, 320), N=96, reference=640):
    """{scene: {method: {steps, x, V_m, tension, area, length, seconds, and the observed orders}}}.

    The entry "reference" of a scene holds its distance to the one with half the steps: how far it can be trusted.
    """
    found = {}
    for name in scenes:
        make, t_end = SCENES[name]
        scene = make(N)
        best = solution(scene, t_end, ARK5(), True, reference)
        half = solution(scene, t_end, ARK5(), True, reference // 2)
        found[name] = {"reference": {part: largest(best[part] - half[part]) for part in PARTS}}
        for method in methods:
            found[name][method] = _errors(scene, t_end, METHODS[method], sizes, best)
    return found


def _errors(scene, t_end, method, sizes, best):
    *method, more = method
    sizes = [more * steps for steps in sizes]
    solution(scene, t_end, *method, 10)  # compiles
    table = {"steps": sizes, "seconds": []} | {part: [] for part in (*PARTS, "area", "length")}
    for steps in sizes:
        start = time.perf_counter()
        last = solution(scene, t_end, *method, steps)
        table["seconds"].append(time.perf_counter() - start)
        for part in PARTS:
            table[part].append(largest(last[part] - best[part]))
        for kept in ("area", "length"):
            table[kept].append(largest(last[kept]))
    table["orders"] = {part: np.log2(np.divide(table[part][:-1], table[part][1:])) for part in PARTS}
    return table


@styled
def draw(found) -> Figure:
    """Draws errors against steps, errors of area and length against steps, error against time; one row per scene."""
    figure = Figure(figsize=(run_plots.PAGE, 2.3 * len(found) + 0.4), layout="constrained")
    for row, (name, methods) in zip(np.atleast_2d(figure.subplots(len(found), 3)), found.items(), strict=True):
        for i, table in enumerate(table for method, table in methods.items() if method != "reference"):
            steps = table["steps"]
            for part, style in zip(PARTS, ("-o", "--s", ":^"), strict=True):
                row[0].loglog(steps, table[part], style, color=f"C{i}", ms=3)
            for kept, style in (("area", "-o"), ("length", "--s")):
                row[1].loglog(steps, np.maximum(table[kept], 1e-16), style, color=f"C{i}", ms=3)
            row[2].loglog(table["seconds"], table["x"], "-o", color=f"C{i}", ms=3)
        for axes in row[:2]:
            steps = sorted({n for method, table in methods.items() if method != "reference" for n in table["steps"]})
            axes.set_xticks(steps[::2], [str(n) for n in steps[::2]])
            axes.minorticks_off()
        row[0].set(title=name, ylabel="largest error at the end", xlabel="steps")
        row[1].set(title="area and length", ylabel="relative error", xlabel="steps")
        row[2].set(title=r"error in $x$", xlabel="wall time (s)")
    methods = [method for method in next(iter(found.values())) if method != "reference"]
    handles = [Line2D([], [], color=f"C{i}", lw=2, label=method) for i, method in enumerate(methods)]
    for label, style in ((r"$x$, or area", "-o"), ("$V_m$, or length", "--s"), (r"tension $\lambda$", ":^")):
        handles += figure.axes[0].plot([], [], style, color="0.3", ms=3, label=label)
    figure.legend(handles=handles, loc="outside upper center", ncols=6)
    return figure


def main():
    found = run()
    for scene, methods in found.items():
        print(f"{scene}: reference against half its steps {methods['reference']}")
        for method, table in list(methods.items())[1:]:
            print(f"  {method:20} steps      x       order  V_m     order  λ       order  area    length  seconds")
            for i, steps in enumerate(table["steps"]):
                order = {p: f"{table['orders'][p][i - 1]:5.2f}" if i else "     " for p in PARTS}
                errors = "".join(f"  {table[p][i]:.1e} {order[p]}" for p in PARTS)
                print(f"  {steps:25d}{errors}" + "".join(f"  {table[k][i]:.0e}" for k in ("area", "length", "seconds")))
    store("order_in_time", found)
    save(draw(found), "order_in_time")


if __name__ == "__main__":
    main()
