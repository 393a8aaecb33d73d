"""At which field does a vesicle leave class P, and how does this field depend on all other numbers?

    python -m experiments.critical_field          # tables and a figure, about forty minutes

Λ = 0.1, χ = 0.08, a vesicle along the field. β₀ is computed at G = 0 for Δ = 0.9, 0.8, 0.6, from an ellipse and from
the shape at rest, with its discretisation error and its derivatives. Then follow β₀(Δ) and β₀(G). The paper's values
1.9, 2.6, 5.1 were read off its phase diagram.

What to expect: the derivatives -(∂_p Q)/(∂_β Q) agree for all quantities Q at late times, because all small changes
then lie along the one unstable direction. At G = 0 the least deformation is steep at β₀ but continuous, because the
field that holds the vesicle at the saddle decays as the membrane charges. The derivatives are drawn as tangents of the
curves.
"""

import numpy as np
from matplotlib.figure import Figure

from jaxves.analysis import critical_field as critical
from jaxves.inputs.scene_files import parse
from jaxves.plots import run_plots

from ._common import save, store, styled

PAPER = {0.9: 1.9, 0.8: 2.6, 0.6: 5.1}
QUICK = dict(cases={"ellipse": {0.9: (1.5, 1.8)}}, areas={}, conductances={}, N=32, tolerance=1e-4, late=2)
CASES = {
    "ellipse": {0.9: (1.45, 1.8), 0.8: (1.8, 2.9), 0.6: (3.2, 5.6)},
    "relaxed": {0.9: (1.2, 1.4), 0.8: (1.7, 2.2), 0.6: (2.9, 3.3)},
}
AREAS = {0.95: (1.0, 1.6), 0.85: (1.6, 2.4), 0.75: (2.1, 3.3), 0.7: (2.4, 3.9), 0.65: (2.8, 4.7)}
CONDUCTANCES = {0.05: (1.4, 1.8), 0.1: (1.3, 1.7), 0.2: (1.1, 1.6), 0.3: (1.0, 1.5)}


def scene(reduced_area, *, start="ellipse", conductance=0.0, N=64, tolerance=1e-6, t_end=1.5, saves=75):
    """Returns one vesicle along a field."""
    vesicle = {"reduced_area": reduced_area, "angle": 90.0, "relaxed": start == "relaxed"}
    field = {"beta": 1.0, "conductivity_ratio": 0.1, "membrane_conductance": conductance}
    numerics = {"nodes": N, "tolerance": tolerance}
    return parse({"t_end": t_end, "saves": saves, "vesicle": [vesicle], "field": field, "numerics": numerics})


def one(setting, bracket, late, *, errors=True):
    """Returns β₀, its discretisation error, and its derivatives, up to `late` times the time of least deformation."""
    found = critical.critical_field(setting, bracket)
    vesicle, field = setting.vesicle[0], setting.field
    start = "at rest" if vesicle.relaxed else "ellipse"
    print(f"{start}, Δ = {vesicle.reduced_area}, G = {field.membrane_conductance}: β₀ = {found.beta:.7f}", flush=True)
    slopes = critical.slopes(setting, found.beta, late * found.instant, saves=8)
    out = found._asdict() | {"slopes": slopes._asdict()}
    return out | (critical.discretisation_error(setting, found.beta)._asdict() if errors else {})


def run(
    cases=CASES,
    areas=AREAS,
    conductances=CONDUCTANCES,
    N=64,
    tolerance=1e-6,
    late=1.4,
):
    """Returns β₀ with errors and derivatives by start and Δ, and along Δ at G = 0 and along G at Δ = 0.9."""
    kinds = dict(N=N, tolerance=tolerance)
    table = {
        start: {area: one(scene(area, start=start, **kinds), bracket, late) for area, bracket in brackets.items()}
        for start, brackets in cases.items()
    }
    along_area = {area: one(scene(area, **kinds), bracket, late, errors=False) for area, bracket in areas.items()}
    # With conductance the saddle lasts: more time to leave it.
    along_conductance = {
        G: one(scene(0.9, conductance=G, t_end=3.0, saves=150, **kinds), bracket, late, errors=False)
        for G, bracket in conductances.items()
    }
    return {"cases": table, "along Δ": along_area, "along G": along_conductance}


def slope(row, name):
    """Returns dβ₀/d`name`, and the largest deviation of the other quantities from it at the last time."""
    last = {key: values[-1] for key, values in row["slopes"]["ratios"][name].items()}
    value = last["deformation_along_field"]
    return value, max(abs(other - value) for other in last.values())


@styled
def draw(found) -> Figure:
    """Draws β₀ along Δ and along G with tangents from the derivatives, and the ratios against time."""
    figure = Figure(figsize=(run_plots.PAGE, 2.6))
    left, middle, right = figure.subplots(1, 3)
    ellipse = found["cases"]["ellipse"]
    by_area = dict(sorted((ellipse | found["along Δ"]).items()))
    by_conductance = {0.0: ellipse[0.9]} | found["along G"]
    for axes, curve, name in (
        (left, by_area, "vesicle.reduced_area"),
        (middle, by_conductance, "field.membrane_conductance"),
    ):
        places = np.array(list(curve))
        axes.plot(places, [row["beta"] for row in curve.values()], "o", ms=3, label="from an ellipse")
        reach = 0.35 * np.min(np.diff(places)) if len(places) > 1 else 0.02
        for place, row in curve.items():
            ends = place + reach * np.array([-1, 1])
            tangent = row["beta"] + slope(row, name)[0] * (ends - place)
            axes.plot(ends, tangent, color="0.3", lw=1, label="derivative" if place == places[0] else None)
    relaxed = found["cases"].get("relaxed", {})
    at_rest = [row["beta"] for row in relaxed.values()]
    left.plot(list(relaxed), at_rest, "s", ms=3, mfc="none", label="from the shape at rest")
    left.plot(list(PAPER), list(PAPER.values()), "k+", ms=7, label="paper, as drawn")
    left.set(xlabel=r"reduced area $\Delta$", ylabel=r"critical field $\beta_0$ at $G=0$")
    left.margins(y=0.1)
    left.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    middle.set(xlabel="membrane conductance $G$", ylabel=r"critical field $\beta_0$ at $\Delta=0.9$")
    row = ellipse[0.9]
    for key, values in row["slopes"]["ratios"]["field.conductivity_ratio"].items():
        right.plot(row["slopes"]["t"], values, "o-", ms=2.5, label=key.replace("_", " "))
    right.axvline(row["instant"], color="0.6", lw=0.8)
    right.set(xlabel=r"$t/t_\kappa$", ylabel=r"$\partial\beta_0/\partial\Lambda$ by a diagnostic at $t$", ylim=(0, 30))
    right.legend(loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    return figure


def main():
    found = run()
    names = {"vesicle.reduced_area": "Δ", "field.conductivity_ratio": "Λ", "field.membrane_conductance": "G",
             "field.chi": "χ"}  # fmt: skip

    def show(label, row):
        errors = f" nodes {row['nodes']:.0e}, step {row['step']:.0e}" if "nodes" in row else ""
        text = "  ".join("dβ₀/d{} = {:.3f} ± {:.0e}".format(names[name], *slope(row, name)) for name in names)
        print(f"{label:22} β₀ = {row['beta']:.6f}{errors}  at t = {row['instant']:.3f}  {text}")

    for start, rows in found["cases"].items():
        for area, row in rows.items():
            show(f"{start}, Δ = {area} ({PAPER[area]})", row)
    for area, row in found["along Δ"].items():
        show(f"Δ = {area}", row)
    for G, row in found["along G"].items():
        show(f"Δ = 0.9, G = {G}", row)
    store("critical_field", found)
    save(draw(found), "critical_field")


if __name__ == "__main__":
    main()
