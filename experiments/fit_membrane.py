"""Can β, Λ, G and χ be found from the deformation and the charging of a vesicle, with one per cent of noise?

    python -m experiments.fit_membrane          # a table and a figure, four minutes

A vesicle of Δ = 0.9 lies along a field. Its deformation and its largest transmembrane potential (which dyes make
visible) are observed at 64 times, with noise of one per cent of the largest value of each. The trajectories are made
with twice the nodes and a tenth of the tolerance of the model. There are twenty samples of the noise and twenty fits
of all four numbers. Each fit starts three times too high or too low in every number, at random.

What to expect: each number is in its 95 % interval in about nineteen of twenty fits, and in seventeen at least. The
Fisher information is printed first: with the potential the four numbers are distinguished better than from the
deformation alone.
"""

import time

import numpy as np
from matplotlib.figure import Figure

from jaxves.analysis import fit
from jaxves.analysis.observations import Model, Observations, shown
from jaxves.inputs.scene_files import parse
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

from ._common import save, store, styled

TRUTH = {
    "field.beta": 3.2,
    "field.conductivity_ratio": 0.1,
    "field.membrane_conductance": 0.5,
    "field.chi": 0.08,
}
SYMBOLS = dict(zip(TRUTH, "βΛGχ", strict=True))
BOUNDS = {name: (value / 30, 30 * value) for name, value in TRUTH.items()}
SEEN = ("deformation_along_field", "max_V_m")
NOISE = 0.01
QUICK = dict(trajectories=1, N=32, saves=8, tolerance=1e-3, t_end=0.1)


def scene(N, values=TRUTH):
    """Returns one vesicle along a field with these numbers."""
    field = {name.removeprefix("field."): float(value) for name, value in values.items()}
    return parse({"t_end": 1.0, "vesicle": [{"reduced_area": 0.9, "angle": 90.0}], "field": field,
                  "numerics": {"nodes": N}})  # fmt: skip


def clean(N, saves, tolerance, t_end):
    """Returns the observations without noise, and the standard deviations of the noise."""
    blank = Observations(t_end, {name: np.zeros((saves, 1)) for name in SEEN}, dict.fromkeys(SEEN, 1.0))
    seen = shown(Model.of(scene(2 * N), blank, Adaptive(0.1 * tolerance)), TRUTH)
    return seen, {name: NOISE * float(np.max(np.abs(values))) for name, values in seen.items()}


def run(trajectories=20, N=48, saves=64, tolerance=1e-5, t_end=0.2, factor=3.0):
    """Returns values, intervals, χ² and seconds of each fit, and how often each number is in its interval."""
    exact, deviation = clean(N, saves, tolerance, t_end)
    file = scene(N)
    out = []
    for seed in range(trajectories):
        rng = np.random.default_rng(seed)
        seen = {name: values + deviation[name] * rng.normal(size=values.shape) for name, values in exact.items()}
        start = {name: value * factor ** rng.choice([-1, 1]) for name, value in TRUTH.items()}
        began = time.perf_counter()
        found = fit.fit(file, BOUNDS, Observations(t_end, seen, deviation), starts=[start], march=Adaptive(tolerance))
        seconds = time.perf_counter() - began
        row = {"values": found.values, "intervals": found.intervals, "chi2": found.chi2, "loose": found.loose}
        row |= {
            "iterations": found.starts[0].iterations,
            "converged": found.starts[0].converged,
            "seconds": seconds,
            "observations": found.observations,
        }
        row["inside"] = {n: within(found.intervals[n], value) for n, value in TRUTH.items()}
        out.append(row)
        ended = f"{row['iterations']} steps{'' if row['converged'] else ' at most'}, {seconds:.0f} s"
        values = (f"{SYMBOLS[n]} {v:.4g}" for n, v in found.values.items())
        print(f"{seed:3} χ² {found.chi2:8.1f} of {found.observations}, {ended},", *values, *found.loose, flush=True)
    hits = {name: sum(row["inside"][name] for row in out) for name in TRUTH}
    return {"fits": out, "inside": hits, "exact": exact, "deviation": deviation}


def within(interval, value):
    """Returns whether a number is in its interval; a number that is not determined has none."""
    return interval is not None and interval[0] < value < interval[1]


def expected(found_row):
    """Returns the relative half-widths of the intervals of one fit, about the geometric mean; infinite without one."""
    intervals = found_row["intervals"].items()
    return {name: np.inf if ends is None else float(np.log(ends[1] / ends[0]) / 2) for name, ends in intervals}


@styled
def draw(found) -> Figure:
    """Draws the intervals of the first number, and the other numbers against it, relative to the true values."""
    figure = Figure(figsize=(run_plots.PAGE, 2.4))
    left, *others = figure.subplots(1, len(TRUTH))
    first, *rest = TRUTH

    def deviation(row, name):
        return 100 * (row["values"][name] / TRUTH[name] - 1)

    for i, row in enumerate(found["fits"]):
        color = "C0" if row["inside"][first] else "C1"
        if row["intervals"][first] is not None:
            left.plot(100 * (np.array(row["intervals"][first]) / TRUTH[first] - 1), [i, i], color=color, lw=1.5)
        left.plot(deviation(row, first), i, "o", color=color, ms=2.5)
    left.axvline(0, color="0.6", lw=0.8)
    left.set(xlabel=f"{SYMBOLS[first]}, %", ylabel="trajectory", yticks=[])
    left.set_title(f"{found['inside'][first]} of {len(found['fits'])} contain the truth", fontsize="small")
    for axes, name in zip(others, rest, strict=True):
        axes.plot(
            *zip(*((deviation(row, first), deviation(row, name)) for row in found["fits"]), strict=True), "o", ms=3
        )
        axes.axhline(0, color="0.6", lw=0.8)
        axes.axvline(0, color="0.6", lw=0.8)
        axes.set(xlabel=f"{SYMBOLS[first]}, %", ylabel=f"{SYMBOLS[name]}, %")
    return figure


def main():
    found = run()
    for name, hits in found["inside"].items():
        widths = [expected(row)[name] for row in found["fits"]]
        print(f"{SYMBOLS[name]}: {hits} of {len(widths)} in the 95 % interval, ± {100 * np.median(widths):.1f} %")
    store("fit_membrane", found)
    save(draw(found), "fit_membrane")


if __name__ == "__main__":
    main()
