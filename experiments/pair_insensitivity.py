"""Does the class of a pair depend on where it starts, or on how deflated the vesicles are?

    python -m experiments.pair_insensitivity          # 40 minutes: tables, a figure, data/pair_insensitivity.json

G = 0, Ca = 0, centres 2.6 a apart (3 a at Δ = 0.99); β = 3.2, 4.8, 2.4 at Δ = 0.9, 0.7, 0.99, as in the paper.

What to expect: from any angle between 10° and 80°, and at every Δ, a chain at small Λ and circulation at Λ = 0.5.
Oscillations are between them. The pair circulates counter-clockwise from 10°, 40° and 60°, but clockwise from 80°,
after it has swung back. At Δ = 0.7, Λ = 0.1 the vesicles bud: the gap of each membrane to itself, the neck, closes.
"""

import numpy as np
from matplotlib.figure import Figure

from experiments import _common, _pairs
from jaxves.plots import run_plots

OFFSETS, RATIOS = (10.0, 40.0, 60.0, 80.0), (0.1, 0.3, 0.5)
AREAS = {0.7: (4.8, (96, 128)), 0.99: (2.4, (64, 128))}
FILM = 0.03
QUICK = dict(offsets=(40.0,), ratios=(0.5,), areas={0.99: (2.4, (32,))}, t_end=0.5, saves=4, nodes=(32,))


def run(offsets=OFFSETS, ratios=RATIOS, areas=AREAS, t_end=8.0, saves=80, nodes=(64, 128)):
    """Returns {("offset", Λ, degrees) or ("area", Λ, Δ): history with class}."""
    found = {}
    for ratio in ratios:
        for offset in offsets:
            found["offset", ratio, offset] = _pairs.resolved(
                nodes, FILM, t_end, saves, conductivity_ratio=ratio, offset=offset
            )
        for area, (beta, finer) in areas.items():
            found["area", ratio, area] = _pairs.resolved(
                finer, FILM, t_end, saves, conductivity_ratio=ratio, reduced_area=area, beta=beta, separation=3.0
            )
    return found


def draw(found) -> Figure:
    """Draws the angle of the line of centres against time: for each Λ, above by offset angle and below by Δ."""
    ratios = sorted({key[1] for key in found})
    figure = Figure(figsize=(run_plots.PAGE, 4.8), layout="constrained")
    axes = figure.subplots(2, len(ratios), squeeze=False, sharex=True)
    for (kind, ratio, value), case in found.items():
        ax = axes[0 if kind == "offset" else 1, ratios.index(ratio)]
        start = f"{value:g}°" if kind == "offset" else rf"$\Delta = {value:g}$"
        word = "no class at the end" if case["class"] == "open" else case["class"]
        ax.plot(case["t"], case["angle"], label=f"{start}: {word}", lw=1.0)
    for ax, ratio in zip(axes[0], ratios, strict=True):
        ax.text(0.5, 1.42, rf"$\Lambda = {ratio:g}$", transform=ax.transAxes, ha="center")
    for ax in axes.flat:
        ax.axhline(90, color="0.7", lw=0.8, zorder=0)
        ax.legend(fontsize="x-small", loc="lower center", bbox_to_anchor=(0.5, 1.0))
    for ax in axes[-1]:
        ax.set(xlabel=r"$t/t_\kappa$")
    for ax in axes[:, 0]:
        ax.set(ylabel="line of centres (degrees)")
    return figure


def main():
    found = run()
    for (kind, ratio, value), case in found.items():
        print(f"Λ = {ratio:g}, {kind} {value:g}: {_pairs.summary(case)}; own gap {np.min(case['self_gap']):.3f}")
    _common.store("pair_insensitivity", {str(key): _pairs.stored(case) for key, case in found.items()})
    _common.save(_common.styled(draw)(found), "pair_insensitivity")


if __name__ == "__main__":
    main()
