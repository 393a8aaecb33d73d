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
_SIZES = (150, 55, 14)  # of marks, by disturbance
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
    """Draws classes over β and G: squares for the symmetric start, dots for the others, crosses for failed runs."""
    rows = found["by area"]
    figure = Figure(figsize=(run_plots.PAGE, 2.6), layout="constrained")
    seen = set()
    for ax, (area, by_disturbance) in zip(figure.subplots(1, len(rows), squeeze=False)[0], rows.items(), strict=True):
        for (disturbance, row), size in zip(by_disturbance.items(), _SIZES, strict=False):
            for beta, classes, words in zip(found["strengths"], row["classes"], row["status"], strict=True):
                for G, word, ended in zip(found["conductances"], classes, words, strict=True):
                    good = word in COLORS and ended in status.SUCCESS
                    marker = ("s" if disturbance == 0 else "o") if good else "X"
                    label = word if good else "broke down"
                    color = COLORS[word] if good else "black"
                    ax.scatter(beta, G, s=size, c=color, marker=marker, linewidths=0.6, edgecolors="white",
                               label=None if label in seen else label)  # fmt: skip
                    seen.add(label)
        ax.set(xlabel=r"$\beta$", ylabel="$G$", title=rf"$\Delta = {area:g}$")
        ax.margins(0.12)
    sizes = zip(next(iter(rows.values())), _SIZES, strict=False)
    for disturbance, size in sizes:
        label = f"moved by {disturbance:g}" if disturbance else "symmetric start"
        ax.scatter([], [], s=size, c="0.8", marker="o" if disturbance else "s", edgecolors="black", label=label)
    figure.legend(loc="outside upper center", ncols=7)
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
