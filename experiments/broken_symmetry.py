"""Does a vesicle that starts almost symmetric end like the symmetric one?

    python -m experiments.broken_symmetry          # a table and a figure, five minutes

The solution from an ellipse along the field is symmetric about its centre and in both axes, and jaxves keeps it so. A
real vesicle need not follow it. Here the same cases start with outlines moved by 1e-6 a and 1e-3 a, over β and G at Λ
= 0.1 for Δ = 0.9, 0.8, 0.6, to t = 6 at most, with 96 nodes.

What to expect: no change if G is far from the boundary of O and POP. At the boundary, and at Δ = 0.6 in all strong
fields, the symmetric oblate shape across the field is unstable. At G = 0.2 a disturbed vesicle rolls over and ends
prolate. At Δ = 0.6 it may continue to roll and fold until the nodes no longer resolve it.
"""

import numpy as np
from matplotlib.figure import Figure

from jaxves.base import status
from jaxves.plots import run_plots

from . import phase_diagrams
from ._common import save, store, styled
from ._sweeps import TOY, listed, swept

DISTURBANCES = (0.0, 1e-6, 1e-3)
QUICK = dict(areas=(0.9,), strengths=(5.0,), conductances=(0.0,), disturbances=(0.0, 1e-3), nodes=32, folder=TOY)
COLORS = {"P": "C0", "O": "C1", "POP": "C2", "open": "0.6"}


def tables(areas, strengths, conductances, disturbances, nodes) -> dict:
    """Returns the tables of the sweep."""
    return {
        "scene": phase_diagrams.scene(nodes),
        "axes": {
            "vesicle.disturbance": list(disturbances),
            "vesicle.reduced_area": list(areas),
            "field.beta": list(strengths),
            "field.membrane_conductance": list(conductances),
        },
        "max_steps": [1000, 2000],
    }


def run(
    areas=(0.9, 0.8, 0.6),
    strengths=(3.0, 4.5, 6.0, 7.5),
    conductances=(0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8),
    disturbances=DISTURBANCES,
    nodes=96,
    folder=None,
):
    """Returns classes and status words (β, G) by Δ and disturbance, and how many cases change."""
    record = swept(tables(areas, strengths, conductances, disturbances, nodes), "broken_symmetry", folder)
    found = {}
    for i, area in enumerate(areas):
        found[area] = {}
        for k, disturbance in enumerate(disturbances):
            changed = (record.classes[k, i] != record.classes[0, i]) | (record.status[k, i] != record.status[0, i])
            found[area][disturbance] = {
                "classes": listed(record.classes[k, i]),
                "status": listed(record.status[k, i]),
                "changed": int(np.sum(changed)),
            }
    return {"strengths": list(strengths), "conductances": list(conductances), "by area": found}


@styled
def draw(found) -> Figure:
    """Draws the classes over β and G, one column of panels for each Δ and one row for each start."""
    rows = found["by area"]
    starts = list(next(iter(rows.values())))
    figure = Figure(figsize=(run_plots.PAGE, 0.6 + 1.6 * len(starts)), layout="constrained")
    panels = figure.subplots(len(starts), len(rows), squeeze=False, sharex=True, sharey=True)
    seen = {}
    for column, (area, by_disturbance) in zip(panels.T, rows.items(), strict=True):
        for ax, disturbance in zip(column, starts, strict=True):
            row = by_disturbance[disturbance]
            for beta, classes, words in zip(found["strengths"], row["classes"], row["status"], strict=True):
                for G, word, ended in zip(found["conductances"], classes, words, strict=True):
                    good = word in COLORS and ended in status.SUCCESS
                    label, color = (word, COLORS[word]) if good else ("broke down", "black")
                    marker = "s" if good else "x"
                    seen[label] = ax.scatter(beta, G, s=45 if good else 20, c=color, marker=marker, linewidths=1.0)
            ax.margins(0.12)
        column[0].set_title(rf"$\Delta = {area:g}$")
        column[-1].set_xlabel(r"field strength $\beta$")
    for ax, disturbance in zip(panels[:, 0], starts, strict=True):
        start = rf"moved by {disturbance:g} $a$" if disturbance else "symmetric start"
        ax.set_ylabel(f"{start}\nconductance $G$")
    figure.legend(seen.values(), seen, loc="outside upper center", ncols=5)
    return figure


def main():
    found = run()
    for area, by_disturbance in found["by area"].items():
        for disturbance, row in by_disturbance.items():
            print(f"Δ = {area}, moved by {disturbance:g}: {row['changed']} cases end otherwise")
            for beta, classes, words in zip(found["strengths"], row["classes"], row["status"], strict=True):
                ends = (f"{word or '-':4} {ended:13}" for word, ended in zip(classes, words, strict=True))
                print(f"    β = {beta:g}: " + " ".join(ends))
    store("broken_symmetry", found)
    save(draw(found), "broken_symmetry")


if __name__ == "__main__":
    main()
