"""Do two vesicles chain, oscillate or circulate as Λ and G vary, and in which direction do they turn?

    python -m experiments.pairs          # half an hour: table, two figures, data/pairs.json

Δ = 0.9, β = 3.2, Ca = 0, as in the paper; centres 2.6 a apart, 20° from the horizontal.
`jaxves/observables/pair_classes.py` defines the classes. A run ends when its class is known: at rest with a film of
0.03 a, or after three quarters of a turn. If 64 nodes do not resolve the film, the run is repeated with 128.

What to expect: without conductance (G = 0) a chain along the field at small Λ, undamped swings at Λ = 0.3, and
circulation from Λ = 0.5 on, counter-clockwise up to Λ = 1 and clockwise above. A conducting membrane is not charged.
The traction is then nearly normal, nothing treads, and all pairs turn to the field and form chains. They turn more
slowly as Λ approaches 1. Aligned pairs attract, and pairs side by side repel each other.
"""

import numpy as np
from matplotlib.figure import Figure

from experiments import _common, _pairs
from jaxves.plots import run_plots

RATIOS = (0.1, 0.3, 0.5, 0.8, 1.0, 2.0, 5.0)
CONDUCTANCES = (0.0, 0.1, 1.0, 10.0)
FILM = 0.03
COLORS = {"chain": "C0", "oscillation": "C4", "circulation": "C1", "repulsion": "C3", "slanted": "C2", "open": "0.6"}
QUICK = dict(ratios=(0.5, 2.0), conductances=(0.0,), nodes=(32,), ends={0.0: (0.5, 4)}, brief=(0.5, 4))


def run(
    ratios=RATIOS,
    conductances=CONDUCTANCES,
    nodes=(64, 128),
    ends={0.0: (8.0, 160), 0.1: (8.0, 160), 1.0: (800.0, 1600), 10.0: (100.0, 200)},  # noqa: B006
    special=(("aligned", 90.0, 3.2), ("side by side", 0.0, 2.0)),
    brief=(1.0, 20),
):
    """Returns {(Λ, G): history with class}, and those of vesicles aligned and side by side (Λ = 0.5, G = 0)."""
    found = {}
    for G in conductances:
        for ratio in ratios:
            found[ratio, G] = _pairs.resolved(nodes, FILM, *ends[G], conductivity_ratio=ratio, membrane_conductance=G)
    for name, offset, separation in special:
        found[name] = _pairs.resolved(nodes, FILM, *brief, conductivity_ratio=0.5, offset=offset, separation=separation)
    return found


def cells(found) -> dict:
    """Returns the histories of the table."""
    return {key: case for key, case in found.items() if isinstance(key, tuple)}


def draw_table(found) -> Figure:
    """Draws, for each (Λ, G), the final shapes, the paths of the centres, and the class by colour."""
    table = cells(found)
    ratios, conductances = (sorted({key[axis] for key in table}) for axis in (0, 1))
    figure = Figure(figsize=(run_plots.PAGE, 1.25 * len(conductances) + 0.3), layout="constrained")
    axes = figure.subplots(len(conductances), len(ratios), squeeze=False)
    for (ratio, G), case in table.items():
        ax = axes[len(conductances) - 1 - conductances.index(G), ratios.index(ratio)]
        color = COLORS[case["class"]]
        for m in (0, 1):
            ax.plot(*case["center"][:, m].T, color=color, lw=0.6, alpha=0.6)
        run_plots.membranes(ax, case["x"][-1]).set(linewidth=1.0)
        turn = {1.0: "↺ ", -1.0: "↻ "}[case["turns"]] if case["class"] == "circulation" else ""
        ax.set_title(turn + case["class"], color=color, fontsize=6.5, pad=2)
        ax.set(xlim=(-3.2, 3.2), ylim=(-3.2, 3.2), xticks=[], yticks=[])
        ax.spines[:].set_color("0.85")
    for ax, ratio in zip(axes[-1], ratios, strict=True):
        ax.set_xlabel(rf"$\Lambda = {ratio:g}$")
    for ax, G in zip(axes[::-1, 0], conductances, strict=True):
        ax.set_ylabel(f"$G = {G:g}$")
    return figure


def draw(found) -> Figure:
    """Draws the angle of the line of centres and the gap against time, G = 0."""
    figure = Figure(figsize=(6.8, 2.6), layout="constrained")
    turning, draining = figure.subplots(1, 2)
    cases = {ratio: case for (ratio, G), case in cells(found).items() if G == 0}
    for (ratio, case), color in zip(cases.items(), _common.shades(len(cases)), strict=True):
        turning.plot(case["t"], case["angle"], color=color, label=rf"$\Lambda$ = {ratio:g}")
        draining.semilogy(case["t"], case["min_gap"], color=color)
    turning.axhline(90, color="0.7", linewidth=0.8, zorder=0)
    turning.set(xlabel=r"$t/t_\kappa$", ylabel="line of centres (degrees)")
    draining.set(xlabel=r"$t/t_\kappa$", ylabel="gap $/a$")
    turning.legend(fontsize="x-small")
    return figure


def main():
    found = run()
    for key, case in found.items():
        name = key if isinstance(key, str) else f"Λ = {key[0]:g}, G = {key[1]:g}"
        treading, ratio = np.abs(case["tank_treading_speed"][-1]).max(), case["traction_ratio"][-1].max()
        print(f"{name:18} {_pairs.summary(case)}; treading {treading:.1e}, tangential/normal traction {ratio:.2f}")
    _common.store("pairs", {str(key): _pairs.stored(case) for key, case in found.items()})
    _common.save(_common.styled(draw)(found), "pairs")
    _common.save(_common.styled(draw_table)(found), "pairs_table")


if __name__ == "__main__":
    main()
