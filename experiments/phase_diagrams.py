"""In which class (P, O or POP) is a vesicle, over field strength and conductance?

    python -m experiments.phase_diagrams          # a table and a figure; half an hour on two cores

β × G at Λ = 0.1 for Δ = 0.9, 0.8, 0.6, as in the paper's figure. There are 7 × 7 cases each, refined twice where the
class changes, which gives the boundary of a 25 × 25 grid. A run ends when the shape is steady, or with POP. Cases that
64 nodes do not resolve are computed again with 128. At seven G the critical field β₀ is computed with
`jaxves.critical_field`, between the fields of the grid on both sides of it, and drawn as points.

What to expect: P at small β, O at large G, POP between, with a critical β at G = 0 that grows as Δ falls. A vesicle
near a boundary changes slowly. If its class is not known at the end, it is called "open". All starts are exactly
symmetric; `broken_symmetry` shows which of these classes do not depend on this.
"""

import dataclasses
import time
from itertools import pairwise

import numpy as np

from jaxves.analysis import critical_field as critical
from jaxves.analysis.critical import NoCriticalValue
from jaxves.base import status
from jaxves.inputs import scene_files
from jaxves.plots import sweep_plots
from jaxves.results.sweep_store import DUE, SKIPPED

from ._common import save, store, styled
from ._sweeps import TOY, listed, swept

QUICK = dict(
    areas=(0.9,), beta=(1.0, 5.0, 2), conductance=(0.0, 0.8, 2), levels=1, nodes=32, finer=48,
    t_end=0.6, saves=12, folder=TOY,
)  # fmt: skip


def scene(nodes, t_end=6.0, saves=120) -> dict:
    """Returns a vesicle along the field; the run ends when the shape is steady or the class is POP."""
    return {
        "t_end": t_end,
        "saves": saves,
        "vesicle": [{"reduced_area": 0.9, "angle": 90.0}],
        "field": {"beta": 1.0, "conductivity_ratio": 0.1},
        "stop": {"steady": 1e-5, "class": "POP"},
        "numerics": {"nodes": nodes},
    }


def tables(areas, beta, conductance, levels, nodes, t_end, saves) -> dict:
    """Returns the tables of the sweep; an axis is (start, stop, num)."""
    span = ("start", "stop", "num")
    return {
        "scene": scene(nodes, t_end, saves),
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
    """Returns the records of the sweeps as one, and by Δ: classes, numbers of cases, seconds, β₀(G)."""
    records, found = [], {}
    for area in areas:
        began = time.perf_counter()
        wanted = tables([area], beta, conductance, levels, nodes, t_end, saves)
        record = swept(wanted, f"phase_diagrams_{area}", folder)
        again = np.argwhere(record.status == "unresolved")
        if len(again):
            places = [record.at(tuple(i)) for i in again]
            fine = swept({"scene": scene(finer, t_end, saves), "cases": places}, f"phase_diagrams_{area}_fine", folder)
            record = replaced(record, tuple(again.T), fine)
        seconds = time.perf_counter() - began
        good = np.isin(record.status[0], list(status.SUCCESS))
        computed = ~np.isin(record.status[0], [*DUE, SKIPPED])
        brackets = boundary(record)
        found[area] = {
            "cases": int(np.sum(computed)),
            "with finer nodes": len(again),
            "without a result": int(np.sum(~good & computed)),
            "open": int(np.sum(record.classes[0] == "open")),
            "beta_0": brackets.get(0.0),
            "critical": critical_fields(wanted["scene"], area, brackets),
            "seconds": seconds,
            "seconds with critical fields": time.perf_counter() - began,
            "classes": listed(record.classes[0]),
            "status": listed(record.status[0]),
        }
        records.append(record)
    record = joined(records)
    axes = {name: listed(values) for name, (_, values) in record.coordinates.items()}
    return {"axes": axes, "by area": found, "record": record}


def boundary(record) -> dict[float, list[float]]:
    """Returns {G: the largest β in class P, the least β above it in another class}, if the grid has both."""
    strengths, conductances = (record.coordinates[f"field.{name}"][1] for name in ("beta", "membrane_conductance"))
    found = {float(G): bracket(strengths, record.classes[0, :, j]) for j, G in enumerate(conductances)}
    return {G: pair for G, pair in found.items() if pair is not None}


def critical_fields(scene, area, brackets, most=7) -> dict[float, float | str]:
    """Returns β₀ at up to `most` of the conductances of `brackets`, or why there is none."""
    chosen = list(brackets)[:: -(-len(brackets) // most)] if brackets else []
    found = {}
    for G in chosen:
        field = scene["field"] | {"membrane_conductance": G}
        vesicle = [scene["vesicle"][0] | {"reduced_area": area}]
        resolved = {"nodes": scene["numerics"]["nodes"], "tolerance": 1e-5}
        whole = {"t_end": scene["t_end"], "saves": 2 * scene["saves"], "vesicle": vesicle, "field": field}
        try:
            setting = scene_files.parse(whole | {"numerics": resolved})
            found[G] = critical.critical_field(setting, tuple(brackets[G]), tolerance=1e-4).beta
        except NoCriticalValue as error:
            found[G] = str(error)
    return found


def joined(records):
    """Returns the results and classes of sweeps that differ only in Δ, as one record."""
    first = records[0]
    name = "vesicle.reduced_area"
    dims, _ = first.coordinates[name]
    areas = np.concatenate([record.coordinates[name][1] for record in records])
    ends = {part: np.concatenate([getattr(record, part) for record in records]) for part in ("status", "classes")}
    return dataclasses.replace(first, coordinates=first.coordinates | {name: (dims, areas)}, **ends)


def replaced(record, places, other):
    """Returns the record with the results of some of its cases taken from another."""
    words, classes = record.status.copy(), record.classes.copy()
    words[places], classes[places] = other.status, other.classes
    return dataclasses.replace(record, status=words, classes=classes)


def bracket(strengths, classes) -> list[float] | None:
    """Returns the largest β in class P and the least β above it in another class."""
    known = [(beta, word) for beta, word in zip(strengths, classes, strict=True) if word]
    for (low, before), (high, after) in pairwise(known):
        if before == "P" and after != "P":
            return [float(low), float(high)]
    return None


@styled
def draw(found):
    """Draws one panel for each Δ, with the critical fields as points."""
    figure = sweep_plots.phase_diagram(found["record"])
    for ax, row in zip(figure.axes, found["by area"].values(), strict=True):
        known = {G: beta for G, beta in row["critical"].items() if not isinstance(beta, str)}
        (points,) = ax.plot(
            list(known.values()), list(known), "o", color="black", mfc="white", ms=3.5, mew=0.9, clip_on=False
        )
    figure.legend([points], [r"critical field $\beta_0$"], loc="outside upper right")
    return figure


def main():
    found = run()
    print("Δ      cases  with finer nodes  without a result  open  β₀ at G = 0 between      s   s with critical fields")
    for area, row in found["by area"].items():
        counts = f"{row['cases']:5}  {row['with finer nodes']:16}  {row['without a result']:14}  {row['open']:4}"
        print(f"{area:<5}  {counts}  {row['beta_0']}  {row['seconds']:.0f}  {row['seconds with critical fields']:.0f}")
        for G, beta in row["critical"].items():
            print(f"    G = {G:.3f}: β₀ = {beta if isinstance(beta, str) else f'{beta:.4f}'}")
    save(draw(found), "phase_diagrams")
    store("phase_diagrams", {name: value for name, value in found.items() if name != "record"})


if __name__ == "__main__":
    main()
