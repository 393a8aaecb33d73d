r"""At which viscosity ratio does tank-treading end, for which reduced area and which shear?

    python -m experiments.critical_ratio       # table and figure, about ten minutes

`jaxves.critical_value` follows the treading vesicle from ν = 1 to the fold at ν_c, where it meets an unstable steady
state. In the theory of Keller and Skalak in two dimensions an ellipse a > b of fixed shape has ν_c = 2a/(a - b), at any
shear. Each search starts from the end of a short run at ν = 1, with 48 nodes, or 64 at Δ = 0.6. The error is the change
with 1.5 times as many nodes.

What to expect: the theory is exact for Δ → 1, and its relative deviation falls about like 1 - Δ. A vesicle deforms, so
that it treads up to a larger ν, and more so in a stronger shear. By the units ν_c depends on Δ and on Ca a³/κ_B only.
The vesicle is almost along the flow at ν_c. The error grows towards low Δ, where the ends of the vesicle are sharper.
"""

import itertools

import numpy as np
from matplotlib.figure import Figure

from jaxves.analysis import fold
from jaxves.analysis.critical import NoCriticalValue
from jaxves.inputs.scene_files import parse
from jaxves.plots import run_plots

from ._common import save, shades, store, styled
from .viscosity_contrast import KellerSkalak

AREAS = {48: (0.98, 0.95, 0.9, 0.8, 0.7), 64: (0.6,)}  # by number of nodes
SHEARS = (1.0, 10.0, 100.0)
RATIO = "fluid.viscosity_ratio"
QUICK = dict(areas={32: (0.95,)}, shears=(10.0,), errors=False)


def scene(reduced_area, shear, N):
    """Returns one vesicle in shear at ν = 1, from the angle of the theory to where it treads."""
    angle = float(np.degrees(KellerSkalak.of(reduced_area).at(1.0)["inclination"]))
    tables = {
        "t_end": 0.6 + 3.0 / shear,
        "saves": 1,
        "vesicle": [{"reduced_area": reduced_area, "angle": angle}],
        "fluid": {"viscosity_ratio": 1.0},
        "flow": {"kind": "shear", "capillary_number": shear},
        "numerics": {"nodes": N, "tolerance": 1e-4},
    }
    return parse(tables)


def one(reduced_area, shear, N, *, errors=True) -> dict:
    """Returns ν_c with inclination and [μ] there, its discretisation error and derivatives; or why there is none."""
    setting, theory = scene(reduced_area, shear, N), KellerSkalak.of(reduced_area, shear)
    try:
        found = fold.critical_value(setting, RATIO)
        error = fold.discretisation_error(setting, RATIO, found).nodes if errors else np.nan
    except NoCriticalValue as reason:
        return {"theory": theory.critical, "reason": str(reason)}
    slopes = fold.slopes(setting, RATIO, found, ("vesicle.reduced_area", "flow.capillary_number"))
    return {
        "ratio": found.value,
        "error": error,
        "theory": theory.critical,
        "inclination": float(found.diagnostics["inclination"][0]),
        "viscosity": float(found.diagnostics["effective_viscosity"]),
        "by area": slopes["vesicle.reduced_area"],
        "by shear": slopes["flow.capillary_number"],
    }


def run(areas=AREAS, shears=SHEARS, errors=True) -> dict:
    """Returns {Ca: {Δ: row}}."""
    found = {shear: {} for shear in shears}
    for N, few in areas.items():
        for shear, area in itertools.product(shears, few):
            row = found[shear][area] = one(area, shear, N, errors=errors)
            told = row.get("reason") or f"ν_c {row['ratio']:.6f} ± {row['error']:.0e}"
            print(f"Δ {area:4g}  Ca {shear:3g}  {told}", flush=True)
    return found


@styled
def draw(found) -> Figure:
    """Draws ν_c against Δ with the theory and with tangents from the derivatives, and the deviation from the theory."""
    figure = Figure(figsize=(run_plots.PAGE, 2.8))
    left, right = figure.subplots(1, 2)
    areas = sorted({area for rows in found.values() for area in rows})
    fine = np.linspace(min(areas) - 0.01, max(areas) + 0.002, 60)
    left.plot(fine, [KellerSkalak.of(area).critical for area in fine], color="0.5", label="Keller-Skalak")
    for (shear, rows), colour, marker in zip(found.items(), shades(len(found)), itertools.cycle("os^"), strict=False):
        rows = {area: row for area, row in rows.items() if "ratio" in row}
        places, ratios = np.array(list(rows)), np.array([row["ratio"] for row in rows.values()])
        left.plot(places, ratios, marker, color=colour, ms=4, mfc="none", label=f"Ca = {shear:g}")
        for area, row in rows.items():
            ends = area + np.array([-0.01, 0.01])
            left.plot(ends, row["ratio"] + row["by area"] * (ends - area), color=colour, lw=0.8)
        theory = np.array([row["theory"] for row in rows.values()])
        right.loglog(1 - places, ratios / theory - 1, marker + "-", color=colour, ms=4, mfc="none")
    guide = np.array([0.02, 0.3])
    right.loglog(guide, 1.2 * guide, ":", color="0.5", label=r"$\propto 1-\Delta$")
    places = [1 - area for area in areas]
    right.set_xticks(places, [f"{place:.2g}" for place in places], minor=False)
    right.minorticks_off()
    right.set_yticks([0.03, 0.1, 0.3], ["0.03", "0.1", "0.3"])
    left.set(xlabel=r"reduced area $\Delta$", ylabel=r"critical viscosity ratio $\nu_c$")
    right.set(xlabel=r"$1-\Delta$", ylabel=r"$\nu_c$ over Keller-Skalak, minus 1")
    left.legend()
    right.legend()
    return figure


def main():
    found = run()
    for shear, rows in found.items():
        for area, row in rows.items():
            values = "  ".join(f"{name} {value:9.5g}" for name, value in row.items() if name != "reason")
            print(f"Ca {shear:3g}  Δ {area:4g}  {values}")
    store("critical_ratio", found)
    save(draw(found), "critical_ratio")


if __name__ == "__main__":
    main()
