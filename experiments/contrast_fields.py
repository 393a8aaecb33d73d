r"""What does another viscosity inside change for a vesicle in a field?

    python -m experiments.contrast_fields      # tables and figure, about eight minutes

One vesicle, Δ = 0.9. First D(t) along a field of β = 3.2 with Λ = 0.1 and G = 0, for ν from 0.01 to 100. Then the
field β₀(ν) at which the vesicle leaves class P, from an ellipse at G = 0, with its derivative. Last [μ] in shear and
field over Λ, with β = 6.4, Ca = 10, G = 4.

What to expect: the vesicle has to become oblate while its membrane charges. This takes the time χ(1 + 1/Λ) for every
ν, while shapes follow in times proportional to 1 + ν. So β₀ depends on ν and becomes proportional to 1 + ν, although
the states at rest at G = 0 do not depend on ν.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.analysis import critical_field as critical
from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.inputs.scene_files import parse
from jaxves.observables import classes, shear_motion
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

from ._common import save, shades, store, styled

RATIOS = (0.01, 0.1, 1.0, 2.0, 3.0, 10.0, 100.0)
CRITICAL = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0)
VISCOSITIES = (0.1, 1.0, 5.0)
CONDUCTIVITIES = (0.05, 0.1, 0.3, 1.0, 3.0, 10.0)
RATIO = "fluid.viscosity_ratio"
QUICK = dict(ratios=(1.0,), critical_at=(), viscosities=(1.0,), conductivities=(0.1,), nodes=32, t_end=0.05)


@eqx.filter_jit
def _along(ratio, nodes, t_end, tolerance=1e-4):
    start = shapes.ellipse(nodes, 0.9, angle=jnp.pi / 2)
    setting = make_scene(start, field=dc_field(3.2, conductivity_ratio=0.1), viscosity_ratio=ratio)
    return simulate(setting, t_end, saves=200, march=Adaptive(tolerance, max_steps=20_000))


@eqx.filter_jit
def _sheared(ratio, conductivity, nodes, t_end, tolerance=1e-4):
    start = shapes.ellipse(nodes, 0.9, angle=jnp.pi / 5)
    field = dc_field(6.4, conductivity_ratio=conductivity, membrane_conductance=4.0)
    setting = make_scene(start, field=field, flow=Shear(10.0), viscosity_ratio=ratio)
    return simulate(setting, t_end, saves=60, march=Adaptive(tolerance, max_steps=20_000))


def history(ratio: float, nodes: int, t_end: float) -> dict:
    """Returns D(t), the class, and the times at which D becomes negative and positive again (NaN where it does not)."""
    result = _along(jnp.asarray(ratio), nodes, jnp.asarray(t_end))
    t, D = np.asarray(result.t), np.asarray(result.diagnostics["deformation_along_field"][:, 0])
    places = np.flatnonzero(np.diff(np.sign(D)))
    crossings = [float(t[i] + (t[i + 1] - t[i]) * D[i] / (D[i] - D[i + 1])) for i in places[:2]]
    return {
        "status": status.WORDS[int(result.status)],
        "class": classes.class_names(D[:, None])[0],
        "flips": crossings + [np.nan] * (2 - len(crossings)),
        "least": float(np.min(D)),
        "last": float(D[-1]),
        "t": t,
        "D": D,
    }


def leaving(ratio: float, nodes: int) -> dict:
    """Returns β₀ and dβ₀/dν. The bracket is a guess that β₀ is proportional to 1 + ν for large ν."""
    vesicle, fluid = {"reduced_area": 0.9, "angle": 90.0}, {"viscosity_ratio": ratio}
    field = {"beta": 1.0, "conductivity_ratio": 0.1, "membrane_conductance": 0.0}
    numerics = {"nodes": nodes, "tolerance": 1e-4}
    tables = {"t_end": 1.5, "saves": 75, "vesicle": [vesicle], "fluid": fluid, "field": field, "numerics": numerics}
    setting, guess = parse(tables), 0.75 + 0.9 * ratio
    found = critical.critical_field(setting, (0.6 * guess, 1.7 * guess), tolerance=1e-5)
    by = critical.slopes(setting, found.beta, 1.4 * found.instant, saves=4, names=(RATIO,)).ratios[RATIO]
    return {
        "beta": found.beta,
        "instant": found.instant,
        "by ratio": float(by["deformation_along_field"][-1]),
        "apart": float(np.ptp([values[-1] for values in by.values()])),
    }


def sheared(ratio: float, conductivity: float, nodes: int, t_end: float) -> dict:
    """Returns motion, inclination and [μ] at the end."""
    result = _sheared(jnp.asarray(ratio), jnp.asarray(conductivity), nodes, jnp.asarray(t_end))
    t, angle = np.asarray(result.t), np.asarray(result.diagnostics["inclination_unwrapped"][:, 0])
    return {
        "status": status.WORDS[int(result.status)],
        "motion": shear_motion.classify(t, angle, ratio),
        "inclination": float(angle[-1]),
        "viscosity": float(result.diagnostics["effective_viscosity"][-1]),
    }


def run(
    ratios=RATIOS,
    critical_at=CRITICAL,
    viscosities=VISCOSITIES,
    conductivities=CONDUCTIVITIES,
    nodes=48,
    t_end=3.0,
) -> dict:
    """Returns D(t) by ν, β₀ by ν, and [μ] by ν and Λ."""
    return {
        "histories": {ratio: history(ratio, nodes, t_end) for ratio in ratios},
        "critical": {ratio: leaving(ratio, nodes) for ratio in critical_at},
        "sheared": {
            ratio: {at: sheared(ratio, at, nodes, t_end * max(1.0, 0.5 * (1 + ratio))) for at in conductivities}
            for ratio in viscosities
        },
    }


@styled
def draw(found) -> Figure:
    """Draws D(t), β₀ against ν with tangents, and [μ] against Λ."""
    figure = Figure(figsize=(run_plots.PAGE, 2.6))
    left, middle, right = figure.subplots(1, 3)
    for (ratio, row), colour in zip(found["histories"].items(), shades(len(found["histories"])), strict=True):
        left.plot(row["t"], row["D"], color=colour, label=f"{ratio:g}")
    left.set(xlabel=r"$t/t_\kappa$", ylabel=r"$D$ along the field", xlim=(0, 1.3))
    left.legend(title=r"$\nu$", fontsize=6)
    places = 1 + np.array(list(found["critical"]))
    betas = np.array([row["beta"] for row in found["critical"].values()])
    middle.loglog(places, betas, "o", ms=3)
    for place, row in zip(places, found["critical"].values(), strict=True):
        ends = place * np.array([0.8, 1.25])
        middle.plot(ends, row["beta"] + row["by ratio"] * (ends - place), color="0.3", lw=1)
    middle.plot(places, betas[-1] * places / places[-1], ":", color="0.5", label=r"$\propto 1+\nu$")
    middle.axhline(3.2, color="0.7", lw=0.8, label=r"$\beta$ on the left")
    middle.set(xlabel=r"$1+\nu$", ylabel=r"critical field $\beta_0$ at $G=0$")
    middle.legend()
    for (ratio, rows), colour in zip(found["sheared"].items(), shades(len(found["sheared"])), strict=True):
        viscosity = [row["viscosity"] for row in rows.values()]
        right.semilogx(list(rows), viscosity, "o-", color=colour, ms=3, label=rf"$\nu = {ratio:g}$")
    right.set(xlabel=r"$\Lambda$", ylabel=r"$[\mu]$ at $\beta=6.4$, Ca = 10, $G=4$")
    right.legend()
    return figure


def main():
    found = run()
    for ratio, row in found["histories"].items():
        flips = " ".join(f"{t:.4f}" for t in row["flips"])
        least, last = row["least"], row["last"]
        print(f"ν {ratio:6g}: {row['status']} {row['class']:4} flips {flips}  D ≥ {least:.4f}, at the end {last:.4f}")
    for ratio, row in found["critical"].items():
        slope = f"{row['by ratio']:.4f} ± {row['apart']:.0e}"
        print(f"ν {ratio:6g}: β₀ {row['beta']:.5f} at {row['instant']:.3f}, slope {slope}")
    for ratio, rows in found["sheared"].items():
        for at, row in rows.items():
            angle = np.degrees(row["inclination"])
            print(f"ν {ratio:3g} Λ {at:4g}: {row['status']} {row['motion']} {angle:7.2f}° [μ] {row['viscosity']:.4f}")
    store("contrast_fields", found)
    save(draw(found), "contrast_fields")


if __name__ == "__main__":
    main()
