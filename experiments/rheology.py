"""How does a field change the viscosity of a suspension, and the way its vesicles tread?

    python -m experiments.rheology          # tables and two figures; half an hour on two cores

Shear and field together, G = 4: [μ], inclination and tank-treading speed against Λ at β = 6.4 and Ca = 10 for five
reduced areas; then [μ] over (β, Δ) at Λ = 0.1 for Ca = 10 and 50.

What to expect: all settle into tank-treading; inclination and [μ] rise with Λ; vesicles of low Δ tread backwards where
Λ is small; near Δ = 1 the viscosity forgets β and Ca.
"""

import numpy as np
from matplotlib.figure import Figure

from jaxves import plot, status, sweepplot

from ._common import save, store, styled
from ._sweeps import TOY, listed, swept

QUICK = dict(
    areas=(0.9,),
    ratios=(0.1, 1.0),
    over=((0.9, 1.0, 1), (0.0, 6.4, 2)),
    shears=(10.0,),
    nodes=32,
    t_end=0.2,
    saves=4,
    folder=TOY,
)

RATIOS = tuple(float(ratio) for ratio in np.geomspace(0.02, 20, 15))


def scene(capillary_number, nodes, t_end, saves) -> dict:
    """One vesicle in both, from half way between the axes."""
    return {
        "t_end": t_end,
        "saves": saves,
        "vesicle": [{"reduced_area": 0.9, "angle": 36.0}],
        "field": {"beta": 6.4, "conductivity_ratio": 0.1, "membrane_conductance": 4.0},
        "flow": {"kind": "shear", "capillary_number": capillary_number},
        "stop": {"steady": 1e-4},
        "numerics": {"nodes": nodes},
    }


def run(
    areas=(0.5, 0.6, 0.7, 0.8, 0.9),
    ratios=RATIOS,
    over=((0.6, 0.98, 8), (0.0, 9.6, 7)),
    shears=(10.0, 50.0),
    nodes=64,
    t_end=8.0,
    saves=40,
    folder=None,
):
    """The records, and what must hold of them in numbers."""
    against = {
        "scene": scene(10.0, nodes, t_end, saves),
        "axes": {"vesicle.reduced_area": list(areas), "field.conductivity_ratio": list(ratios)},
    }
    records = {"against Λ": swept(against, "rheology_ratio", folder)}
    for shear in shears:
        span = ("start", "stop", "num")
        deflated, strengths = ([ends[0]] if ends[2] == 1 else dict(zip(span, ends, strict=True)) for ends in over)
        grid = {
            "scene": scene(shear, nodes, t_end, saves),
            "axes": {"vesicle.reduced_area": deflated, "field.beta": strengths},
        }
        records[f"Ca = {shear:g}"] = swept(grid, f"rheology_{shear:g}", folder)
    return {"records": records} | found_in(records["against Λ"]) | spreads(records, shears)


def found_in(record) -> dict:
    """By Δ: which treads are steady, how far inclination rises with Λ, and where the treading is backwards."""
    areas, ratios = (values for _, values in record.coordinates.values())
    inside = (..., 0)
    table = {}
    for i, area in enumerate(areas):
        angle = record.data["inclination_final"][i][inside]
        speed = record.data["tank_treading_speed_final"][i][inside]
        steady = record.status[i] == "steady"
        table[float(area)] = {
            "steady": int(steady.sum()),
            "least rise of inclination": float(np.min(np.diff(np.unwrap(angle, period=np.pi)))),
            "least rise of viscosity": float(np.min(np.diff(record.data["effective_viscosity_final"][i]))),
            "backwards up to": float(max(ratios[speed > 0], default=np.nan)),
            "inclination": listed(angle),
            "viscosity": listed(record.data["effective_viscosity_final"][i]),
            "speed": listed(speed),
            "status": listed(record.status[i]),
        }
    return {"ratios": listed(ratios), "against Λ": table}


def spreads(records, shears) -> dict:
    """By Δ: how far [μ] varies with β at each Ca, and between them without a field."""
    out = {}
    for shear in shears:
        record = records[f"Ca = {shear:g}"]
        areas = record.coordinates["vesicle.reduced_area"][1]
        good = np.isin(record.status, list(status.SUCCESS))
        viscosity = np.where(good, record.data["effective_viscosity_final"], np.nan)
        out[f"Ca = {shear:g}"] = {
            float(area): {"viscosity": listed(row), "spread over β": float(np.nanmax(row) - np.nanmin(row))}
            for area, row in zip(areas, viscosity, strict=True)
        }
    return {"over β and Δ": out}


def verdicts(found) -> dict[str, bool]:
    """What the paper says of the first figure."""
    rows = found["against Λ"]
    cases = len(found["ratios"])
    return {
        "all settle into tank-treading": all(row["steady"] == cases for row in rows.values()),
        "inclination rises with Λ": all(row["least rise of inclination"] > 0 for row in rows.values()),
        "low Δ at small Λ treads backwards": rows[min(rows)]["backwards up to"] >= found["ratios"][0],
    }


@styled
def draw(found) -> Figure:
    """The three quantities against Λ."""
    ratios = np.array(found["ratios"])
    figure = Figure(figsize=(plot.PAGE, 2.5))
    for ax, (name, scale, label) in zip(
        figure.subplots(1, 3),
        (
            ("viscosity", 1.0, r"$[\mu]$"),
            ("inclination", 180 / np.pi, "inclination (degrees)"),
            ("speed", 1.0, r"treading speed ($a/t_\kappa$)"),
        ),
        strict=True,
    ):
        for area, row in found["against Λ"].items():
            ax.semilogx(ratios, scale * np.array(row[name]), ".-", ms=3, label=rf"$\Delta = {area:g}$")
        ax.set(xlabel=r"$\Lambda$", ylabel=label)
    ax.axhline(0, color="0.7", linewidth=0.6)
    ax.legend()
    return figure


def main():
    found = run()
    print("Δ     steady  least rise: inclination  [μ]       backwards up to Λ =")
    for area, row in found["against Λ"].items():
        rises = f"{row['least rise of inclination']:.4f}                   {row['least rise of viscosity']:.4f}"
        print(f"{area:<5} {row['steady']:6}  {rises}    {row['backwards up to']:.3g}")
    for shear, rows in found["over β and Δ"].items():
        print(shear, {area: round(row["spread over β"], 4) for area, row in rows.items()})
    save(draw(found), "rheology")
    for name, record in found["records"].items():
        if name.startswith("Ca"):
            figure = sweepplot.quantity_map(record, "effective_viscosity_final")
            save(figure, f"rheology_{name.removeprefix('Ca = ')}")
    store("rheology", {name: value for name, value in found.items() if name != "records"})
    for said, holds in verdicts(found).items():
        print(f"{said}: {holds}")
    assert all(verdicts(found).values())


if __name__ == "__main__":
    main()
