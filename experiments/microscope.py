"""Are the intervals right that a fit to the outlines of a film gives, with 0.3 pixels of noise?

    python -m experiments.microscope --coverage   # 200 films of 12 frames, three unknowns, eight minutes
    python -m experiments.microscope              # 20 films of 100 frames, seven unknowns, a figure, eleven minutes

A vesicle of Δ = 0.9 and a = 40 pixels lies along a field and becomes oblate. In the longer film the field is then
switched off. Outlines are made with twice the nodes and a tenth of the tolerance of the model. Each frame has 200
points with noise in both directions, begins at another place, and is shifted at random. `read_frames` reads the film as
from a contour tool. The length is an unknown, because it carries the error of the measured radius. `fit` starts from
values that are disturbed by a random factor up to 1.5, except length and reduced area, which the film shows directly.

The true value should be in the 95 % interval in 95 ± 3 of a hundred short films, and in 17 of 20 long ones. The
half-widths should be at most 1.5 times those of the Fisher information at the true values.
"""

import sys
import tempfile
import time
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

import jaxves
from jaxves.analysis import boxes, fit
from jaxves.analysis.intervals import judged
from jaxves.analysis.observations import Model, Observations
from jaxves.analysis.search import Target, linearised
from jaxves.inputs.scene_files import parse
from jaxves.numerics import fourier
from jaxves.numerics.arrays import as_float
from jaxves.plots import run_plots
from jaxves.runs.build import scene_of
from jaxves.stepping.adaptive import Adaptive

from ._common import save, store, styled

TRUTH = {
    "field.beta": 3.2,
    "field.conductivity_ratio": 0.1,
    "field.membrane_conductance": 0.5,
    "field.chi": 0.08,
    "vesicle.bending": 1.0,
    "vesicle.length": 1.0,
    "vesicle.reduced_area": 0.9,
}
SYMBOLS = dict(zip(TRUTH, (r"$\beta$", r"$\Lambda$", "$G$", r"$\chi$", "bending", "length", r"$\Delta$"), strict=True))
NARROW = {"vesicle.length": (0.9, 1.1), "vesicle.reduced_area": (0.8, 0.98)}
BOUNDS = {name: NARROW.get(name, (value / 30, 30 * value)) for name, value in TRUTH.items()}
RADIUS, PIXEL, TIME_UNIT, POINTS, NOISE = 40.0, 0.25, 20.0, 200, 0.3  # px, µm, s, points of an outline, px
QUICK = dict(films=1, N=32, frames=6, t_end=0.05, pulse=None, tolerance=1e-3, unknowns=("field.beta",))
FULL = dict(films=20, N=32, frames=100, t_end=0.4, pulse=0.25, tolerance=1e-4, unknowns=tuple(TRUTH))
SHORT = ("field.beta", "vesicle.length", "vesicle.reduced_area")
COVERAGE = dict(films=200, N=32, frames=12, t_end=0.1, pulse=None, tolerance=1e-4, unknowns=SHORT)


def scene(N, pulse, values=TRUTH):
    """Returns one vesicle along a field with these numbers, which ends at the time `pulse`."""
    tables = {"field": {}, "vesicle": {"angle": 90.0}}
    for name, value in values.items():
        table, key = name.split(".")
        tables[table][key] = float(value)
    if pulse is not None:
        tables["field"]["time"] = {"kind": "pulse", "start": 0.0, "duration": pulse, "rise": 0.005}
    return parse({"t_end": 1.0, "vesicle": [tables["vesicle"]], "field": tables["field"], "numerics": {"nodes": N}})


def shapes(N, frames, t_end, pulse, tolerance):
    """Returns the exact outlines (frames, 2N, 2) at t = 0 and at equal times up to `t_end`."""
    exact = scene_of(scene(2 * N, pulse), {})
    result = jaxves.simulate(exact, t_end, saves=frames - 1, march=Adaptive(0.1 * tolerance))
    assert result.word == "complete"
    return np.asarray(result.x[:, 0])


def film(x, rng, path, t_end, modes=None):
    """Writes noisy outlines of these shapes as a contour tool does, with y downwards, and reads them."""
    outlines = []
    for shape in x:
        alpha = 2 * np.pi * (np.arange(POINTS) / POINTS + rng.random())
        points = RADIUS * np.asarray(fourier.evaluate(jnp.asarray(shape), jnp.asarray(alpha)))
        points = points * [1, -1] + 200 + 5 * rng.normal(size=2) + NOISE * rng.normal(size=(POINTS, 2))
        outlines.append(points)
    np.save(path, outlines)
    interval = t_end * TIME_UNIT / (len(x) - 1)
    return jaxves.read_frames(path, pixel=PIXEL, interval=interval, modes=modes)


def information(file, bounds, observations, march, truth):
    """Returns the half-widths of the 95 % intervals by the Fisher information at the true values, in coordinates."""
    inside = boxes.boxes(bounds)
    target = Target.of(Model.of(file, observations, march), inside, observations)
    _, jacobian = linearised(as_float(boxes.to_coordinates(truth, inside)), target)
    return judged(np.asarray(jacobian), inside).half_widths


def search(file, bounds, observations, truth, rng, march):
    """Fits from disturbed values. They are drawn again if 32 nodes do not resolve the first run, which a fit says."""
    while True:
        start = {n: v if n in NARROW else v * 1.5 ** rng.uniform(-1, 1) for n, v in truth.items()}
        try:
            return fit.fit(file, bounds, observations, starts=[start], march=march)
        except ValueError as error:
            if "every run broke down" not in str(error):
                raise


def run(films, N, frames, t_end, pulse, tolerance, unknowns):
    """Returns one row for each film: values, intervals, what is open, χ²; and the half-widths that are expected."""
    x, file, march = shapes(N, frames, t_end, pulse, tolerance), scene(N, pulse), Adaptive(tolerance)
    bounds, truth = {name: BOUNDS[name] for name in unknowns}, {name: TRUTH[name] for name in unknowns}
    rows, modes = [], None
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(films):
            rng = np.random.default_rng(seed)
            began = time.perf_counter()
            seen = film(x, rng, Path(folder) / "film.npy", t_end, modes)
            modes = seen.modes  # the same for all films, so that one compiled program serves all
            observations = Observations.of_frames(seen, TIME_UNIT)
            if seed == 0:
                expected = information(file, bounds, observations, march, truth)
            found = search(file, bounds, observations, truth, rng, march)
            row = {"values": found.values, "intervals": found.intervals, "chi2": found.chi2}
            row |= {"observations": found.observations, "loose": found.loose, "determined": found.determined}
            row |= {"seconds": time.perf_counter() - began, "iterations": found.starts[0].iterations}
            row |= {"noise": seen.noise, "modes": seen.modes, "radius": seen.radius.value}
            rows.append(row)
            print(seed, f"{row['seconds']:.0f} s,", str(found).replace("\n", "; "), flush=True)
    return {"fits": rows, "expected": dict(zip(unknowns, expected.tolist(), strict=True))}


def true_value(row, name):
    """Returns the true value of a number in the units of one film, in which lengths are relative to the seen radius."""
    return TRUTH[name] * (RADIUS * PIXEL / row["radius"] if name == "vesicle.length" else 1.0)


def inside(row, name):
    """Returns whether the true value is in the interval of one fit, or None if the number is left open."""
    interval = row["intervals"][name]
    return None if interval is None else bool(interval[0] < true_value(row, name) < interval[1])


def table(found):
    """Yields one line for each number: how often it is determined, and inside; widths over the information."""
    for name, expected in found["expected"].items():
        closed = [row for row in found["fits"] if row["intervals"][name] is not None]
        hits = sum(inside(row, name) for row in closed)
        line = f"{name}: inside {hits} of {len(closed)}, left open in {len(found['fits']) - len(closed)}"
        if closed:
            box = boxes.boxes(BOUNDS)[name]
            scale = 1.0 if box.positive else box.upper - box.lower
            widths = [np.log(row["intervals"][name][1] / row["intervals"][name][0]) / 2 / scale for row in closed]
            line += f", ±{np.median(widths):.2%}, at most {np.max(widths) / expected:.2f} times the information"
        yield line


@styled
def draw(found) -> Figure:
    """Draws the intervals of all fits about the true values, in per cent; a number that is left open has none."""
    names = list(found["expected"])
    figure = Figure(figsize=(run_plots.PAGE, 2.4))
    for axes, name in zip(figure.subplots(1, len(names), sharey=True), names, strict=True):
        closed = 0
        for i, row in enumerate(found["fits"]):
            if row["intervals"][name] is None:
                axes.plot(0, i, "x", color="0.6", ms=2.5)
                continue
            middle, low, high = 100 * (
                np.array([row["values"][name], *row["intervals"][name]]) / true_value(row, name) - 1
            )
            color, closed = ("C0" if inside(row, name) else "C1"), closed + 1
            axes.plot([low, high], [i, i], color=color, lw=1.2)
            axes.plot(middle, i, "o", color=color, ms=2)
        axes.axvline(0, color="0.6", lw=0.8)
        axes.xaxis.set_major_locator(MaxNLocator(3))
        hits = sum(bool(inside(row, name)) for row in found["fits"])
        axes.set(xlabel=f"{SYMBOLS[name]}, %", title=f"{hits} of {closed}" if closed else "left open")
        axes.set_yticks([])
    figure.axes[0].set(ylabel="film")
    return figure


def main():
    coverage = sys.argv[1:] == ["--coverage"]
    found = run(**(COVERAGE if coverage else FULL))
    print(*table(found), sep="\n")
    store("microscope", found, "coverage" if coverage else "")
    if not coverage:
        save(draw(found), "microscope")


if __name__ == "__main__":
    main()
