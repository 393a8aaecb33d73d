r"""Can the capacitance of a membrane and the inner conductivity be found from AC bursts of several frequencies?

    python -m experiments.charge_fit      # table and figure, about fourteen minutes

A giant vesicle (a = 10 μm, Δ = 0.95, C_m = 1 μF/cm², σ_i = 5 and σ_e = 10 mS/m) is tilted by 45 degrees against an AC
field. A burst of 3 s turns it along the field at low frequencies, and across it beyond the crossover near 7 kHz. Its
deformation along the field is seen after 1.5 s and 3 s, for ten frequencies, with noise of one per cent of the largest
value. Experiments find C_m and σ_i from the frequencies where this deformation changes its sign (Faizi, Dimova and
Vlahovska 2021). There the undulations of the membrane give the area with which a vesicle deforms at rest. Here the
perimeter is fixed, so that a vesicle at rest is either prolate or oblate, and how fast it turns has the information.

The field is averaged over its period, with charge relaxation. The bursts are made with twice the nodes and a tenth of
the tolerance of the model. C_m and σ_i are the unknowns of `fit`, which gets β, χ, Λ and δ of them from
`LabQuantities`. Each of twenty fits starts from values that are wrong by a random factor up to 1.5. Then the same is
done once with low frequencies only, and once with high ones only.

What to expect: the true values are in their 95 % intervals in 17 of 20 fits at least, and half-widths are at most 1.5
times those of the Fisher information at the true values. Low frequencies determine one combination of C_m and σ_i, and
high ones σ_i alone. The fits name what is left open.
"""

import time

import numpy as np
from matplotlib.figure import Figure

import jaxves
from jaxves.analysis import boxes, fit
from jaxves.analysis.intervals import judged
from jaxves.analysis.observations import Model, Observations, shown
from jaxves.analysis.search import Target, linearised
from jaxves.inputs.scene_files import parse
from jaxves.numerics.arrays import as_float
from jaxves.physics.critical_frequency import critical_frequencies
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

from ._common import save, store, styled

TRUTH = {"C_m": 1e-2, "sigma_i": 5e-3}  # F/m², S/m
SYMBOLS = {"C_m": "$C_m$", "sigma_i": r"$\sigma_i$"}
BOUNDS = {name: (value / 10, 10 * value) for name, value in TRUTH.items()}
EPSILON, A = 7e-10, 1e-5  # F/m, m
KNOWN = dict(a=A, E=1.2e3, sigma_e=1e-2, epsilon=EPSILON, kappa_B=1e-19, mu=1e-3)
T_KAPPA = float(jaxves.LabQuantities(**KNOWN, **TRUTH).scales().time)  # 10 s
BANDS = {"all": (1e3, 1e6), "low": (5e2, 2e3), "high": (5e5, 1e6)}  # Hz
SEEN, NOISE, BURST, TIMES = "deformation_along_field", 0.01, 3.0, 2  # s
QUICK = dict(fits=1, others=0, nodes=16, count=2, tolerance=1e-2)


def numbers(unknowns) -> dict:
    """Returns the numbers of the scene for these C_m and σ_i."""
    found = jaxves.LabQuantities(**KNOWN, C_m=unknowns["C_m"], sigma_i=unknowns["sigma_i"]).numbers()
    return {
        "field.beta": found.beta,
        "field.chi": found.chi,
        "field.conductivity_ratio": found.conductivity_ratio,
        "field.charge_relaxation": EPSILON / (A * unknowns["C_m"]),
    }


def scene(nodes):
    """Returns the tilted vesicle in the averaged field."""
    field = {name.removeprefix("field."): float(value) for name, value in numbers(TRUTH).items()}
    field["time"] = {"kind": "ac", "averaged": True, "frequency": 1e4 * T_KAPPA}
    vesicle = {"reduced_area": 0.95, "angle": 45.0}
    return parse({"t_end": 1.0, "vesicle": [vesicle], "field": field, "numerics": {"nodes": nodes}})


def bursts(band, nodes, count, tolerance) -> Observations:
    """Returns exact observations of bursts with `count` frequencies in a band, and the deviation of their noise."""
    frequencies = T_KAPPA * np.geomspace(*BANDS[band], count)
    blank = Observations(
        BURST / T_KAPPA, {SEEN: np.zeros((count, TIMES, 1))}, {SEEN: 1.0},
        conditions={"field.time.frequency": frequencies},
    )  # fmt: skip
    seen = shown(Model.of(scene(2 * nodes), blank, Adaptive(0.1 * tolerance), numbers), TRUTH)
    assert np.all(np.isfinite(seen[SEEN]))
    return blank._replace(seen=seen, deviation={SEEN: NOISE * float(np.max(np.abs(seen[SEEN])))})


def information(file, observations, march) -> dict[str, float]:
    """Returns the half-widths of the 95 % intervals of log C_m and log σ_i by the Fisher information at the truth."""
    inside = boxes.boxes(BOUNDS)
    target = Target.of(Model.of(file, observations, march, numbers), inside, observations)
    _, jacobian = linearised(as_float(boxes.to_coordinates(TRUTH, inside)), target)
    return dict(zip(TRUTH, judged(np.asarray(jacobian), inside).half_widths.tolist(), strict=True))


def fitted(file, exact, seed, march) -> dict:
    """Returns the values, intervals and what is left open of one fit to noisy bursts."""
    rng, began = np.random.default_rng(seed), time.perf_counter()
    seen = exact.seen[SEEN] + exact.deviation[SEEN] * rng.normal(size=exact.seen[SEEN].shape)
    start = {name: value * 1.5 ** rng.uniform(-1, 1) for name, value in TRUTH.items()}
    found = fit.fit(file, BOUNDS, exact._replace(seen={SEEN: seen}), starts=[start], numbers=numbers, march=march)
    print(seed, f"{time.perf_counter() - began:.0f} s,", str(found).replace("\n", "; "), flush=True)
    row = {"values": found.values, "intervals": found.intervals, "chi2": found.chi2}
    row |= {"observations": found.observations, "loose": found.loose, "determined": found.determined}
    return row | {"runs": found.starts[0].iterations, "seconds": time.perf_counter() - began}


def run(fits=20, others=1, nodes=32, count=10, tolerance=1e-4) -> dict:
    """Returns, by band of frequencies, the exact deformations, fits, and the half-widths that are expected."""
    file, march, found = scene(nodes), Adaptive(tolerance, recorded=None), {}
    for band, samples in zip(BANDS, (fits, others, others), strict=True):
        if samples:
            exact = bursts(band, nodes, count, tolerance)
            found[band] = {
                "Hz": np.asarray(exact.conditions["field.time.frequency"]) / T_KAPPA,
                "deformation": exact.seen[SEEN][..., 0],
                "deviation": exact.deviation[SEEN],
                "expected": information(file, exact, march),
                "fits": [fitted(file, exact, seed, march) for seed in range(samples)],
            }
    return found


def inside(row, name) -> bool:
    """Returns whether the true value is in the interval of one fit; a number that is left open has none."""
    interval = row["intervals"][name]
    return interval is not None and interval[0] < TRUTH[name] < interval[1]


def widths(part, name) -> list[float]:
    """Returns the half-widths of the intervals of all fits over that of the Fisher information."""
    intervals = [row["intervals"][name] for row in part["fits"]]
    return [float(np.log(high / low) / 2 / part["expected"][name]) for low, high in filter(None, intervals)]


def crossover() -> float:
    """Returns the frequency in Hz at which the mean load on a circle vanishes."""
    at = {name.removeprefix("field."): float(value) for name, value in numbers(TRUTH).items()}
    first, _ = critical_frequencies(at["conductivity_ratio"], chi=at["chi"], delta=at["charge_relaxation"])
    return float(first) / (2 * np.pi * T_KAPPA)


@styled
def draw(found) -> Figure:
    """Draws the deformation against the frequency, and the intervals of all fits about the true values."""
    part, figure = found["all"], Figure(figsize=(run_plots.PAGE, 2.6))
    left, *others = figure.subplots(1, 1 + len(TRUTH), width_ratios=(2, 1, 1))
    D, noise = np.array(part["deformation"]), part["deviation"]
    for values, label in zip(D.T, ("after 1.5 s", "after 3 s"), strict=True):
        left.errorbar(part["Hz"], values, yerr=1.96 * noise, fmt=".-", lw=0.8, label=label)
    left.axvline(crossover(), color="k", lw=1, label=r"$\omega_1/2\pi$ of a circle")
    left.axhline(0, color="0.6", lw=0.8)
    left.set(xscale="log", xlabel="frequency, Hz", ylabel="$D$ along the field")
    left.legend()
    for axes, name in zip(others, TRUTH, strict=True):
        for i, row in enumerate(part["fits"]):
            color = "C0" if inside(row, name) else "C1"
            if row["intervals"][name] is not None:
                axes.plot(100 * (np.array(row["intervals"][name]) / TRUTH[name] - 1), [i, i], color=color, lw=1.2)
            axes.plot(100 * (row["values"][name] / TRUTH[name] - 1), i, "o", color=color, ms=2)
        axes.axvline(0, color="0.6", lw=0.8)
        hits = sum(inside(row, name) for row in part["fits"])
        axes.set(xlabel=f"{SYMBOLS[name]}, %", title=f"{hits} of {len(part['fits'])}", yticks=[])
    return figure


def main():
    found = run()
    for name in TRUTH:
        part = found["all"]
        hits, over = sum(inside(row, name) for row in part["fits"]), widths(part, name)
        print(f"{name}: inside {hits} of {len(part['fits'])}, ±{part['expected'][name]:.2%} by the Fisher information")
        print(f"  half-widths {min(over):.2f} to {max(over):.2f} times that")
    for band in ("low", "high"):
        print(band, found[band]["expected"], *(row["determined"] + row["loose"] for row in found[band]["fits"]))
    store("charge_fit", found)
    save(draw(found), "charge_fit")


if __name__ == "__main__":
    main()
