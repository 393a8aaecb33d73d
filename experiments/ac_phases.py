r"""Is a vesicle in an AC field prolate or oblate, over frequency and conductivity ratio?

    python -m experiments.ac_phases                 # table and figure, about six minutes
    python -m experiments.ac_phases --deflated      # the same at Δ = 0.8, about twenty minutes

Δ = 0.95, β = 6.4, χ = 0.08, G = 0, δ = 7e-3 (water, a = 10 μm, C_m = 1 μF/cm²), ε_i/ε_e = 1 and 0.5, 32 nodes. The
field is averaged over its period. One start lies exactly along the field and stays symmetric, one is tilted by 45
degrees. A run ends at rest or at t = 4. The lines ω₁ and ω₂ are those of a circle
(`jaxves/physics/critical_frequency.py`). At some points runs that resolve the field are made from the tilted start. At
Δ = 0.8 there are 48 nodes and fewer cases. Those that end as `unresolved` are computed again with 64 and then with 96
nodes. Those that end as `inaccurate` are computed again with the field resolved; their D is the mean over the last
period.

What to expect: the tilted vesicle is prolate below ω₁ and oblate between ω₁ and ω₂, and prolate again beyond ω₂. The
vesicle along the field is a metastable prolate in a part of the region between. At frequencies below the rate at
which shapes change, averaged runs tell that they are inaccurate, and resolved ones find vesicles that breathe.
"""

import sys
import time
from functools import partial

import numpy as np
from matplotlib.figure import Figure

import jaxves
from jaxves.base import status
from jaxves.observables import classes
from jaxves.physics.critical_frequency import critical_frequencies
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

from ._common import save, store, styled
from ._sweeps import TOY, listed, swept

BETA, CHI, DELTA = 6.4, 0.08, 7e-3
STARTS = {"along the field": 90.0, "tilted": 45.0}
PERMITTIVITIES = (1.0, 0.5)
RESOLVED = ((0.4, 0.1), (0.4, 0.5), (0.4, 0.8), (0.4, 1.25), (0.4, 3.0), (2.0, 1.0))
AGAIN = (
    ("unresolved", dict(nodes=64)),
    ("unresolved", dict(nodes=96)),
    ("inaccurate", dict(nodes=64, averaged=False, tolerance=1e-5)),
)
DEFLATED = dict(
    area=0.8, ratios=(0.1, 0.2, 0.4, 0.7, 2.0), frequencies=(5.0, 5e4, 10), resolved=((0.4, 5.0),), nodes=48,
    again=AGAIN,
)  # fmt: skip
QUICK = dict(
    ratios=(0.5,), frequencies=(1.0, 50.0, 2), permittivities=(1.0,), resolved=(), nodes=32, t_end=0.3, saves=6,
    again=(("inaccurate", dict(nodes=16, averaged=False, tolerance=1e-2)),), folder=TOY,
)  # fmt: skip
AXES = ("field.permittivity_ratio", "field.conductivity_ratio", "field.time.frequency")


def tables(area, angle, t_end, saves, *, cases, nodes, averaged=True, tolerance=1e-4) -> dict:
    """Returns the tables of a sweep; `cases` has its key "axes" or "cases"."""
    time = {"kind": "ac", "averaged": averaged, "frequency": 1.0}
    field = {"beta": BETA, "chi": CHI, "conductivity_ratio": 0.5, "charge_relaxation": DELTA, "time": time}
    return {
        "scene": {
            "t_end": t_end,
            "saves": saves,
            "vesicle": [{"reduced_area": area, "angle": angle}],
            "field": field,
            "numerics": {"nodes": nodes, "tolerance": tolerance},
        }
        | ({"stop": {"steady": 1e-4}} if averaged else {}),
    } | cases


def outcomes(record, nodes) -> dict[str, np.ndarray]:
    """Returns what is kept of each case of a sweep: D at the end, swing, status word, nodes, and two flags.

    For runs that resolve the field, D is the mean over the last period, and the swing is NaN.
    """
    data, resolved = record.data, classes.MEAN + "_final" in record.data
    D = data[(classes.MEAN if resolved else classes.DEFORMATION) + "_final"][..., 0]
    return {
        "deformation": D,
        "swing": np.full(D.shape, np.nan) if resolved else data["averaged_swing_final"][..., 0],
        "status": record.status,
        "nodes": np.full(D.shape, nodes),
        "resolved": np.full(D.shape, resolved),
        "breathing": record.classes == "breathing",
    }


def compute_again(part, made, again, axes, label, folder) -> None:
    """Computes cases of `part` again that ended with a word of `again`, and replaces their outcomes."""
    for k, (word, options) in enumerate(again):
        places = np.argwhere(part["status"] == word)
        cases = [dict(zip(AXES, (of[i] for of, i in zip(axes, place, strict=True)), strict=True)) for place in places]
        if cases:
            record = swept(made(cases={"cases": cases}, **options), f"{label}_{word}_{k}", folder)
            for key, values in outcomes(record, options["nodes"]).items():
                part[key][tuple(places.T)] = values


def frequencies_of(ratio, permittivity) -> np.ndarray:
    """Returns ω₁ and ω₂ of a circle."""
    found = critical_frequencies(ratio, chi=CHI, delta=DELTA, permittivity_ratio=permittivity)
    return np.asarray(found)


def resolved_run(area, ratio, omega, nodes, t_end=4.0, periods=3) -> dict:
    """Returns the class of a run from the tilted start that resolves the field, in at least so many periods."""
    period = 2 * np.pi / omega
    field = jaxves.dc_field(
        BETA, conductivity_ratio=ratio, chi=CHI, charge_relaxation=DELTA, history=jaxves.AC(1 / period)
    )
    scene = jaxves.make_scene(jaxves.ellipse(nodes, area, angle=np.pi / 4), field=field)
    t_end = max(t_end, periods * period)
    result = jaxves.simulate(scene, t_end, saves=40, march=Adaptive(1e-4, recorded=None))
    last = {name: float(result.diagnostics[name][-1, 0]) for name in classes.DIAGNOSTICS[1:]}
    return {"class": jaxves.class_names(result.diagnostics)[0], "status": result.word, "omega": float(omega)} | last


def run(
    area=0.95,
    ratios=(0.05, 0.1, 0.2, 0.4, 0.7, 0.9, 2.0),
    frequencies=(0.5, 5e4, 14),
    permittivities=PERMITTIVITIES,
    resolved=RESOLVED,
    nodes=32,
    t_end=4.0,
    saves=8,
    again=(),
    folder=None,
) -> dict:
    """Returns the last D, status words and swings of averaged runs by start, over ε, Λ and ω, and resolved runs.

    `frequencies` are ω as (start, stop, num). `again` has pairs of a status word and options of `tables`: cases that
    end with this word are computed again with these options. The pairs are used one after the other.
    """
    omega = np.geomspace(*frequencies)
    found = {"omega": omega, "ratio": ratios, "permittivity": permittivities, "averaged": {}}
    axes = [[float(value) for value in of] for of in (permittivities, ratios, omega / (2 * np.pi))]
    for name, angle in STARTS.items():
        began, label = time.perf_counter(), f"ac_{angle:.0f}_{area}"
        made = partial(tables, area, angle, t_end, saves)
        first = swept(made(cases={"axes": dict(zip(AXES, axes, strict=True))}, nodes=nodes), label, folder)
        part = outcomes(first, nodes)
        compute_again(part, made, again, axes, label, folder)
        found["averaged"][name] = {key: listed(of) for key, of in part.items()}
        found["averaged"][name]["seconds"] = time.perf_counter() - began
    rows = []
    for ratio, share in resolved:
        first = frequencies_of(ratio, 1.0)[0]
        omega = share * first if np.isfinite(first) else 10 * share
        rows.append({"ratio": ratio, "over first": share} | resolved_run(area, ratio, omega, nodes))
    return found | {"resolved": rows}


def agreement(found) -> dict:
    """Returns, by start and ε, in how many of the accurate cases the sign of D is that of the load on a circle."""
    out = {}
    omega = np.array(found["omega"])
    for name, part in found["averaged"].items():
        for k, permittivity in enumerate(found["permittivity"]):
            right = total = 0
            for i, ratio in enumerate(found["ratio"]):
                first, second = frequencies_of(ratio, permittivity)
                oblate = (omega > first) & ~(omega > second)
                D, words = np.array(part["deformation"])[k, i], np.array(part["status"])[k, i]
                good = np.isin(words, list(status.SUCCESS)) & (np.abs(D) > classes.THRESHOLD)
                right, total = right + int(np.sum(good & ((D < 0) == oblate))), total + int(np.sum(good))
            out[f"{name}, ε = {permittivity:g}"] = [right, total]
    return out


@styled
def draw(found) -> Figure:
    """Draws classes over Λ and ω: averaged runs as dots, inaccurate ones as crosses.

    Resolved runs are squares in place of averaged ones, and rings around them.
    """
    figure = Figure(figsize=(run_plots.PAGE, 4.6))
    names, permittivities = list(found["averaged"]), found["permittivity"]
    axes = figure.subplots(len(permittivities), len(names), sharex=True, sharey=True, squeeze=False)
    fine = np.geomspace(min(found["ratio"]), max(found["ratio"]), 400)
    colours = {"prolate": "C0", "oblate": "C1", "breathing": "C4", "neither": "0.6"}
    for row, (k, permittivity) in zip(axes, enumerate(permittivities), strict=True):
        lines = np.array([frequencies_of(ratio, permittivity) for ratio in fine])
        for ax, name in zip(row, names, strict=True):
            part = found["averaged"][name]
            for i, ratio in enumerate(found["ratio"]):
                columns = (part[key][k][i] for key in ("deformation", "status", "resolved", "breathing"))
                for omega, D, word, resolved, breathing in zip(found["omega"], *columns, strict=True):
                    word_of = "prolate" if D > classes.THRESHOLD else "oblate" if D < -classes.THRESHOLD else "neither"
                    word_of = "breathing" if breathing else word_of
                    marker = "x" if word not in status.SUCCESS else "s" if resolved else "o"
                    ax.plot(ratio, omega, marker, color=colours[word_of], ms=3.5)
            for line, style, label in zip(lines.T, ("-", "--"), (r"$\omega_1$", r"$\omega_2$"), strict=True):
                ax.plot(fine, line, style, color="k", lw=1, label=label)
            if name == "tilted" and permittivity == 1.0:
                for case in found["resolved"]:
                    word_of = {"P": "prolate", "POP": "prolate", "O": "oblate"}.get(case["class"], case["class"])
                    colour = colours.get(word_of, "0.6")
                    ax.plot(case["ratio"], case["omega"], "o", mfc="none", mec=colour, ms=8)
            ax.set(xscale="log", yscale="log", title=rf"{name}, $\varepsilon = {permittivity:g}$")
    for ax in axes[-1]:
        ax.set_xlabel(r"$\Lambda$")
    for ax in axes[:, 0]:
        ax.set_ylabel(r"$\omega$ ($1/t_\kappa$)")
        ax.set_ylim(0.7 * min(found["omega"]), 1.5 * max(found["omega"]))
    for word, colour in colours.items():
        axes[0, 0].plot([], [], "o", color=colour, ms=3.5, label=word)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6)
    return figure


def main():
    variant = "deflated" if sys.argv[1:] == ["--deflated"] else ""
    found = run(**(DEFLATED if variant else {}))
    for name, (right, total) in agreement(found).items():
        print(f"{name}: {right} of {total} accurate cases have the sign of the load on a circle")
    for case in found["resolved"]:
        print("resolved:", {key: value if isinstance(value, str) else round(value, 4) for key, value in case.items()})
    store("ac_phases", found | {"agreement": agreement(found)}, variant)
    save(draw(found), "ac_phases" + (variant and f"_{variant}"))


if __name__ == "__main__":
    main()
