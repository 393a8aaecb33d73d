"""Does the gap in a chain decrease exponentially in time, as the paper says, or like a power of it?

    python -m experiments.chain_gap                # half an hour: table, figures/chain_gap.png, data/chain_gap.json
    python -m experiments.chain_gap 96 128         # with these nodes only, minutes

Λ = 0.1, G = 0, Δ = 0.9, β = 3.2, tolerance 1e-6. With 128 nodes the gap at t = 4 is 0.0568 at tolerance 1e-4 and
0.0470 at 1e-5. Noise in the tension, proportional to the tolerance, ends these two runs as unresolved at t = 4.25 and
4.1. Each run continues to t = 10 or until its film is unresolved. Two laws are fitted to the run with the most nodes,
from a gap of 0.06 on: d = d₀ e^{-rt} and d = d₀ (t - t₀)^{-p}, by least squares in log d. The error of r and p is the
difference between fits to the two halves. The same chain with the trapezoidal rule, without the check of the film,
shows the effect of close evaluation.

What to expect: neither law is exact. The local rate -d'/d shows which one is closer.
"""

import dataclasses
import sys

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import least_squares

from experiments import _common, _pairs
from jaxves.observables.checks import Checks
from jaxves.operators.sums import coupling_for
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

SIZES = (128, 192, 256)
START = 0.06  # the gap from which on the laws are fitted
QUICK = dict(sizes=(32,), t_end=0.1, saves=4, plain=())


def run(sizes=SIZES, t_end=10.0, saves=200, plain=(64,), tolerance=1e-6):
    """Returns {N: history}, {"plain N": history without close evaluation}, and fits to the run with most nodes."""
    march = Adaptive(tolerance)
    found = {N: _pairs.history(_pairs.scene(0.1, N=N), t_end, saves, march=march) for N in sizes}
    for N in plain:
        found[f"plain {N}"] = without_close_evaluation(N, t_end, saves)
    finest = found[max(sizes)]
    late = np.flatnonzero((finest["min_gap"] < START) & (finest["t"] > finest["t"][np.argmax(finest["min_gap"])]))
    return found, laws(finest["t"][late], finest["min_gap"][late]) if len(late) > 8 else {}


def without_close_evaluation(N: int, t_end: float, saves: int) -> dict:
    """Returns the time series with the trapezoidal rule at any distance, without the check of the film."""
    coupling = dataclasses.replace(coupling_for(2, N), near=-0.5)  # no pair is nearer than this
    return _pairs.history(_pairs.scene(0.1, N=N), t_end, saves, checks=Checks(film=np.inf), coupling=coupling)


def exponential(t, gap):
    """Returns the rate, log d at t = 0, and the root mean square residual of log d."""
    slope, level = np.polyfit(t, np.log(gap), 1)
    return -slope, level, float(np.sqrt(np.mean((np.log(gap) - level - slope * t) ** 2)))


def power(t, gap):
    """Returns the exponent p and t₀ of (t - t₀)^-p, log d at t = t₀ + 1, and the residual."""

    def residual(unknowns):
        level, p, t_0 = unknowns
        return np.log(gap) - level + p * np.log(t - t_0)

    best = least_squares(residual, (0.0, 2.0, t[0] - 1.0), bounds=([-np.inf, 0, -np.inf], [np.inf, 50, t[0] - 1e-3]))
    return best.x[1], best.x[2], best.x[0], float(np.sqrt(np.mean(best.fun**2)))


def laws(t, gap) -> dict:
    """Returns both laws for all data and for its halves, and the local rate -d'/d at the beginning and the end."""
    halves = np.array_split(np.arange(len(t)), 2)
    rates = [exponential(t[half], gap[half])[0] for half in halves]
    exponents = [power(t[half], gap[half])[0] for half in halves]
    rate, level, misfit = exponential(t, gap)
    exponent, t_0, power_level, power_misfit = power(t, gap)
    local = -np.gradient(np.log(gap), t)
    return {
        "from": (t[0], gap[0]),
        "to": (t[-1], gap[-1]),
        "exponential": {
            "rate": rate, "error": abs(rates[1] - rates[0]) / 2, "halves": rates, "level": level, "misfit": misfit,
        },
        "power": {
            "exponent": exponent, "error": abs(exponents[1] - exponents[0]) / 2, "halves": exponents, "t_0": t_0,
            "level": power_level, "misfit": power_misfit,
        },
        "local rate": (local[1], local[len(t) // 2], local[-2]),
    }  # fmt: skip


def draw(found, fits) -> Figure:
    """Draws the gap against time with both laws, and its local rate against the gap."""
    figure = Figure(figsize=(run_plots.PAGE, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for name, case in found.items():
        t, gap = case["t"], case["min_gap"]
        plain = isinstance(name, str)
        style = dict(ls="none", marker=".", ms=3, markevery=2, color="0.5") if plain else {}
        label = f"trapezoidal, N = {name.split()[1]}" if plain else f"N = {name}"
        left.semilogy(t, gap, lw=1.0, label=label, **style)
        if not plain:
            thin = gap < 0.2
            right.loglog(gap[thin], -np.gradient(np.log(gap[thin]), t[thin]), lw=1.0)
    if fits:
        t = np.linspace(fits["from"][0], fits["to"][0], 100)
        law = fits["exponential"]
        left.semilogy(t, np.exp(law["level"] - law["rate"] * t), "k--", lw=0.7, label="best exponential")
        law = fits["power"]
        power_law = np.exp(law["level"]) * (t - law["t_0"]) ** -law["exponent"]
        left.semilogy(t, power_law, "k:", lw=1.2, label="best power law")
    left.set(xlabel=r"$t/t_\kappa$", ylabel="gap $/a$")
    right.set(xlabel="gap $/a$", ylabel=r"$-d'/d\ (1/t_\kappa)$")
    left.legend()
    return figure


def main(sizes=SIZES):
    found, fits = run(sizes)
    for name, case in found.items():
        gaps = ", ".join(
            f"{np.interp(t, case['t'], case['min_gap']):.5f}" for t in (3, 4, 5, 6, 8, 10) if t <= case["t"][-1]
        )
        print(f"{name}: {case['word']} at t = {case['t'][-1]:.2f} after {case['steps']} steps; gap at 3, 4, …: {gaps}")
    for name, value in fits.items():
        print(name, value)
    stored = {str(name): _pairs.stored(case) for name, case in found.items()}
    _common.store("chain_gap", {"histories": stored, "fits": fits})
    _common.save(_common.styled(draw)(found, fits), "chain_gap")


if __name__ == "__main__":
    main(tuple(int(N) for N in sys.argv[1:]) or SIZES)
