"""Which field E(t) deforms, turns or separates vesicles as wanted?

    python -m experiments.optimal_control          # three targets, a figure
    python -m experiments.optimal_control deformation      # one of them

The targets were written down before any search. Each is to be met to a relative error of 1e-3 with at most 50 gradient
evaluations. SciPy's COBYQA and Nelder-Mead, which need no derivatives, minimise the same cost, with the same knots and
from the same start. One gradient evaluation takes as long as several runs. This ratio is measured, and the searches are
compared after the same time. Those without derivatives then go on until they meet the target, or for 120 runs.

| target | scene | wanted | bound on the largest V_m |
|---|---|---|---|
| deformation | POP: Δ = 0.9, β = 3.2, Λ = 0.1, prolate at the start | D = -0.15 at t = 1 | 1.0 |
| inclination | Δ = 0.9, β = 6.4, Λ = 0.1, G = 4, shear with Ca = 10, 20° at the start | 30° at t = 0.3 | none |
| separation | two such vesicles side by side across the field, 2.5 a apart | 3.0 a at t = 1 | none |
"""

import dataclasses
import sys
import time
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import minimize

import jaxves
from jaxves.analysis.control import Controlled, Goal, greatest_potential, with_gradient
from jaxves.analysis.steering import MARGIN
from jaxves.numerics.arrays import as_float
from jaxves.plots import run_plots
from jaxves.stepping.march import AbstractMarch

from ._common import pop, save, store, styled, treading


class Target(NamedTuple):
    """What is wanted, when, within which bound, and where the search begins."""

    quantity: str
    wanted: float
    t_end: float
    bound: float
    start: float


TARGETS = {
    "deformation": Target("deformation", -0.15, 1.0, 1.0, 0.7),
    "inclination": Target("inclination", float(np.radians(30.0)), 0.3, float("inf"), 1.0),
    "separation": Target("separation", 3.0, 1.0, float("inf"), 1.0),
}
METHODS = ("COBYQA", "Nelder-Mead")
TOLERANCE = 1e-3  # relative, of the target
FIRST = 0.5  # first change of a value in these searches, as in `steer`
STEPS = 4  # fixed steps between two saved times, to check gradients
MOST_RUNS = 120  # of a search without derivatives
ADAPTIVE = jaxves.Adaptive(recorded=512)
QUICK = dict(names=("inclination",), N=24, knots=4, evaluations=2, march=jaxves.Fixed(2), runs=12)


def scene(name: str, N: int) -> jaxves.Scene:
    """Returns the scene of a target."""
    if name == "inclination":
        return treading(N)
    if name == "deformation":
        return pop(N)
    ellipse = jaxves.ellipse(N, 0.9, angle=jnp.pi / 2)
    return jaxves.make_scene(
        [ellipse, ellipse], centers=[[-1.25, 0.0], [1.25, 0.0]], field=jaxves.dc_field(3.2, conductivity_ratio=0.1)
    )


def _seconds(call) -> float:
    """Returns the seconds of the second of two calls on the cores of this process."""
    jax.block_until_ready(call())
    begin = time.process_time()
    jax.block_until_ready(call())
    return time.process_time() - begin


class Search(NamedTuple):
    """A target in its scene, for all methods."""

    target: Target
    controlled: Controlled
    goal: Goal
    saves: int

    @classmethod
    def of(cls, name: str, N: int, knots: int, march: AbstractMarch = ADAPTIVE) -> "Search":
        """Returns the search for a target, with the cost of `jaxves.steer`."""
        target = TARGETS[name]
        times = jnp.linspace(0.0, target.t_end, knots)
        controlled = Controlled(scene(name, N), times, march, target.quantity, None, None)
        goal = Goal(*map(as_float, (target.wanted, abs(target.wanted), (1 - MARGIN) * target.bound)))
        return cls(target, controlled, goal, 2 * (knots - 1))

    def with_gradient(self, values) -> tuple[float, np.ndarray]:
        """Returns the cost and its gradient."""
        outcome, gradient = with_gradient(self.controlled, self.goal, jnp.asarray(values), self.saves)
        return float(outcome.cost), np.asarray(gradient)

    def run(self, values) -> jaxves.Result:
        """Returns the run with these values."""
        return self.controlled.run(jnp.asarray(values), self.saves)

    def measured(self, result: jaxves.Result) -> tuple[jax.Array, jax.Array]:
        """Returns the quantity of a run, and the largest |V_m| at each saved time."""
        return self.controlled.measured(result), greatest_potential(result)

    def distance(self, quantity: float, V_m: float) -> float:
        """Returns the relative distance from the target, infinite where the bound is exceeded."""
        return abs(quantity / self.target.wanted - 1) if V_m <= self.target.bound else np.inf


def slope_error(search: Search, values: np.ndarray, h=2e-3) -> float:
    """Returns the relative difference of the slope along the gradient from differences of fourth order.

    It is taken beside the values that were found, where the gradient is not zero. Steps are fixed: a gradient belongs
    to the steps of one run, and with adaptive steps differences also see how the steps change.
    """
    beside = values + 0.02
    search = search._replace(controlled=dataclasses.replace(search.controlled, march=jaxves.Fixed(STEPS)))
    gradient = search.with_gradient(beside)[1]
    along = gradient / np.max(np.abs(gradient))
    two_before, before, after, two_after = (
        float(search.goal.cost(*search.measured(search.run(beside + step * h * along)))) for step in (-2, -1, 1, 2)
    )
    return abs(gradient @ along / ((8 * (after - before) - (two_after - two_before)) / (12 * h)) - 1)


def without_derivatives(search: Search, method: str, runs: int) -> list[float]:
    """Returns the least relative distance from the target after each run of a search of SciPy.

    The search ends when the target is met.
    """
    distances = []

    def cost(values):
        result = search.run(values)
        if result.word != "complete":
            distances.append(np.inf)
            return 1e3
        quantity, V_m = search.measured(result)
        distances.append(search.distance(float(quantity), float(jnp.max(V_m))))
        return float(search.goal.cost(quantity, V_m))

    def stop(intermediate_result):
        if min(distances) <= TOLERANCE:
            raise StopIteration

    start = np.full(len(search.controlled.times), search.target.start)
    first = {
        "COBYQA": {"initial_tr_radius": FIRST},
        "Nelder-Mead": {"initial_simplex": start + FIRST * np.eye(len(start) + 1, len(start), -1)},
    }
    minimize(cost, start, method=method, callback=stop, options={"maxfev": runs} | first[method])
    return np.minimum.accumulate(distances).tolist()


def one(name: str, N: int, knots: int, evaluations: int, march: AbstractMarch, runs: int) -> dict:
    """Returns the field for one target, the check of the gradient, and the searches without derivatives."""
    search = Search.of(name, N, knots, march)
    target = search.target
    found = jaxves.steer(
        search.controlled.scene,
        target.quantity,
        target.wanted,
        knots=knots,
        max_V_m=None if np.isinf(target.bound) else target.bound,
        t_end=target.t_end,
        start=target.start,
        evaluations=evaluations,
        tolerance=TOLERANCE,
        march=march,
        progress=print,
    )
    seconds = {
        "run": _seconds(lambda: search.run(found.values).x),
        "gradient": _seconds(lambda: search.with_gradient(found.values)[1]),
    }
    ratio = seconds["gradient"] / seconds["run"]
    distances = [search.distance(row.quantity, row.max_V_m) for row in found.history]
    others = {method: without_derivatives(search, method, runs) for method in METHODS}
    equal = round(ratio * len(distances))  # runs that take as long as the search with gradients
    return {
        "word": found.word,
        "quantity": found.quantity,
        "relative error": search.distance(found.quantity, found.max_V_m),
        "evaluations": len(distances),
        "largest V_m": found.max_V_m,
        "slope error": slope_error(search, found.values),
        "runs per gradient": ratio,
        "seconds": seconds,
        "times": np.asarray(found.waveform.times),
        "values": found.values,
        "t": np.asarray(found.result.t),
        "V_m": np.asarray(greatest_potential(found.result)),
        "with gradients": np.minimum.accumulate(distances).tolist(),
        "without, after the same time": {method: least[:equal][-1] for method, least in others.items()},
        **others,
    }


def run(names=tuple(TARGETS), N=32, knots=24, evaluations=50, march=ADAPTIVE, runs=MOST_RUNS) -> dict:
    """Returns what `one` finds, by the name of the target."""
    return {name: one(name, N, knots, evaluations, march, runs) for name in names}


@styled
def draw(found) -> Figure:
    """Draws the field and the largest |V_m| in time, and the distance from the target against the cost."""
    figure = Figure(figsize=(run_plots.PAGE, 4.2))
    axes = figure.subplots(2, len(found), squeeze=False)
    for (name, row), above, below in zip(found.items(), *axes, strict=True):
        above.plot(row["times"], row["values"], ".-", label="field $E(t)$")
        above.plot(row["t"], row["V_m"], label="largest $|V_m|$")
        if np.isfinite(TARGETS[name].bound):
            above.axhline(TARGETS[name].bound, color="0.6", lw=0.8, ls="--", label="bound on $|V_m|$")
        above.set(xlabel=r"time $t/t_\kappa$", title=name)
        ratio = row["runs per gradient"]
        for label in ("with gradients", *METHODS):
            steps = np.arange(1, len(row[label]) + 1) * (ratio if label == "with gradients" else 1)
            below.semilogy(steps, np.where(np.isinf(row[label]), np.nan, row[label]), ".-", ms=3, label=label)
        below.axhline(1e-3, color="0.6", lw=0.8, ls="--", label="1e-3")
        below.set(xlabel="cost in runs")
    axes[0, 0].legend()
    axes[1, 0].set(ylabel="relative distance from the target")
    axes[1, -1].legend()
    return figure


def main():
    found = {}
    for name in sys.argv[1:] or TARGETS:
        print(name)
        found |= run((name,))
        row = found[name]
        print(f"{name}: {row['word']}, {row['quantity']:.6f} after {row['evaluations']} gradients")
        store("optimal_control", found)
    save(draw(found), "optimal_control")


if __name__ == "__main__":
    main()
