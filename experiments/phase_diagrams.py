"""Which of prolate, oblate and prolate-oblate-prolate becomes of a vesicle, over field strength and conductance?

    python -m experiments.phase_diagrams          # a table and a figure; half an hour on two cores

β × G at Λ = 0.1 for Δ = 0.9, 0.8, 0.6, as the paper's figure: 7 × 7 cases each, then refined twice where the class
changes, which gives the boundary of a 25 × 25 grid. A run ends when nothing moves any more, or with POP. Cases that 64
nodes do not resolve are computed again with 128.

What to expect: P at small β, O at large G, POP between, with a critical β at G = 0 that grows as Δ falls. A vesicle
at a boundary lingers: where it has not made up its mind by the end, it is called "open".
"""

import dataclasses
from itertools import pairwise

import numpy as np

from jaxves import status, sweepplot

from ._common import save, store
from ._sweeps import TOY, listed, swept

QUICK = dict(
    areas=(0.9,), beta=(1.0, 5.0, 2), conductance=(0.0, 0.8, 2), levels=1, nodes=32, finer=48,
    t_end=0.6, saves=12, folder=TOY,
)  # fmt: skip


def tables(areas, beta, conductance, levels, nodes, t_end, saves) -> dict:
    """The sweep; an axis is (start, stop, num)."""
    span = ("start", "stop", "num")
    return {
        "scene": {
            "t_end": t_end,
            "saves": saves,
            "vesicle": [{"reduced_area": 0.9, "angle": 90.0}],
            "field": {"beta": 1.0, "conductivity_ratio": 0.1},
            "stop": {"steady": 1e-5, "class": "POP"},
            "numerics": {"nodes": nodes},
        },
        "axes": {
            "vesicle.reduced_area": list(areas),
            "field.beta": dict(zip(span, beta, strict=True)),
            "field.membrane_conductance": dict(zip(span, conductance, strict=True)),
        },
        "refine": {"levels": levels, "along": ["field.beta", "field.membrane_conductance"]},
    }


def run(
    areas=(0.9, 0.8, 0.6),
    beta=(0.5, 8.0, 7),
    conductance=(0.0, 0.8, 7),
    levels=2,
    nodes=64,
    finer=128,
    t_end=6.0,
    saves=120,
    folder=None,
):
    """The record of the sweep, and by Δ: classes over the grid, how many cases were computed, β₀ at G = 0."""
    wanted = tables(areas, beta, conductance, levels, nodes, t_end, saves)
    record = swept(wanted, "phase_diagrams", folder)
    seconds = [record.attributes["wall_time"]]
    again = np.argwhere(record.status == "unresolved")
    if len(again):
        scene = wanted["scene"] | {"numerics": {"nodes": finer}}
        fine = swept({"scene": scene, "cases": [record.at(tuple(i)) for i in again]}, "phase_diagrams_fine", folder)
        record = replaced(record, tuple(again.T), fine)
        seconds.append(fine.attributes["wall_time"])
    strengths = record.coordinates["field.beta"][1]
    found = {}
    for i, area in enumerate(areas):
        good = np.isin(record.status[i], list(status.SUCCESS))
        at_rest = record.classes[i, :, 0]
        found[area] = {
            "cases": int(np.sum(~np.isin(record.status[i], ["skipped", "pending"]))),
            "with finer nodes": int(np.sum(again[:, 0] == i)),
            "without a result": int(np.sum(~good & ~np.isin(record.status[i], ["skipped", "pending"]))),
            "open": int(np.sum(record.classes[i] == "open")),
            "beta_0": bracket(strengths, at_rest),
            "classes": listed(record.classes[i]),
            "status": listed(record.status[i]),
        }
    axes = {name: listed(values) for name, (_, values) in record.coordinates.items()}
    return {"axes": axes, "by area": found, "seconds": seconds, "record": record}


def replaced(record, places, other):
    """The record with the ends and classes of some of its cases taken from another."""
    words, classes = record.status.copy(), record.classes.copy()
    words[places], classes[places] = other.status, other.classes
    return dataclasses.replace(record, status=words, classes=classes)


def bracket(strengths, classes) -> list[float] | None:
    """The greatest β that stays prolate and the least above it that does not."""
    known = [(beta, word) for beta, word in zip(strengths, classes, strict=True) if word]
    for (low, before), (high, after) in pairwise(known):
        if before == "P" and after != "P":
            return [float(low), float(high)]
    return None


def draw(found):
    """One panel for each Δ."""
    return sweepplot.phase_diagram(found["record"])


def main():
    found = run()
    print("Δ      cases  with finer nodes  without result  open  β₀ at G = 0 between")
    for area, row in found["by area"].items():
        counts = f"{row['cases']:5}  {row['with finer nodes']:16}  {row['without a result']:14}  {row['open']:4}"
        print(f"{area:<5}  {counts}  {row['beta_0']}")
    print(*(f"{seconds:.0f} s" for seconds in found["seconds"]))
    save(draw(found), "phase_diagrams")
    store("phase_diagrams", {name: value for name, value in found.items() if name != "record"})


if __name__ == "__main__":
    main()
