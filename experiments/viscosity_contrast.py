r"""When does a vesicle in shear stop treading and tumble, and what is [μ] then?

    python -m experiments.viscosity_contrast            # table and figure, about three minutes
    python -m experiments.viscosity_contrast --figure   # the figure of the stored numbers

One vesicle with Δ = 0.9 in a shear of Ca = 10, for viscosity ratios ν from 0.1 to 1000: inclination of treading, the
time of half a turn, and [μ], which is averaged over whole half-turns where the vesicle tumbles. The theory of Keller
and Skalak in two dimensions is for an ellipse a > b of fixed shape, whose membrane moves linearly in the coordinates.
With k = (a+b)²/(a²+b²), B₀ = (a²-b²)/(a²+b²), k_d = (a+b)²/2ab:

    θ' = -(Ca/2)(1 - B cos 2θ),     B = B₀ + 4a²b²/(a⁴-b⁴) · k/(ν-1+k)
    treading at cos 2θ = 1/B for B > 1, otherwise half-turns of 2π/(Ca √(1-B²));     ν_c = 2a/(a-b)
    [μ] = k_d sin² 2θ + k (ν-1)/(ν-1+k) cos² 2θ,     ⟨cos² 2θ⟩ = (1 - √(1-B²))/B² in tumbling

The theory of quasi-circular vesicles is the leading order of small deficits, with a membrane that does not stretch (R.
Finken, A. Lamura, U. Seifert & G. Gompper, Eur. Phys. J. E 25, 309 (2008)). It has the same motion with

    B = 1/((1 + ν) ε₀),     ε₀ = √(2(1-Δ)/3),     and ν_c = 1/ε₀ - 1

What to expect: the theory of Keller and Skalak is exact only for Δ → 1 and for ν → ∞, where the vesicle is a rigid body
with the mean [μ] of 2. The vesicle deforms, so it treads up to a larger ν. [μ] has its minimum at the transition.
"""

import argparse
import json
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.base import status
from jaxves.geometry import curve, shapes
from jaxves.geometry.curve import Curve
from jaxves.observables.shear_motion import average, classify, half_turns
from jaxves.physics.flow import Shear
from jaxves.physics.scene import make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

from ._common import HERE, save, store, styled

RATIOS = (0.1, 0.3, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 14.0, 20.0, 50.0, 100.0, 1000.0)
AREA, SHEAR = 0.9, 10.0
_MARKERS = {"treading": ("o", "C0"), "tumbling": ("^", "C1"), "swinging": ("s", "C2"), "open": ("x", "k")}
QUICK = dict(ratios=(1.0,), N=32, t_end=0.5, saves=20, tolerance=1e-3)


class KellerSkalak(NamedTuple):
    """The ellipse with semi-axes a > b in a shear of the capillary number Ca."""

    a: float
    b: float
    shear: float = SHEAR

    @classmethod
    def of(cls, reduced_area: float, shear: float = SHEAR) -> "KellerSkalak":
        """Returns the ellipse with this reduced area and the perimeter 2π."""
        c = Curve.from_nodes(shapes.ellipse(128, reduced_area))
        least, most = np.linalg.eigvalsh(curve.second_moments(c)) / float(curve.area(c))
        return cls(2 * np.sqrt(most), 2 * np.sqrt(least), shear)

    @property
    def critical(self) -> float:
        """ν_c, above which the ellipse tumbles."""
        return 2 * self.a / (self.a - self.b)

    def at(self, ratio: float) -> dict[str, float]:
        """Returns inclination in radians, time of half a turn, and [μ]; NaN for what the motion does not have."""
        a, b = self.a, self.b
        k, k_d = (a + b) ** 2 / (a**2 + b**2), (a + b) ** 2 / (2 * a * b)
        inner = k / (ratio - 1 + k)
        B = (a**2 - b**2) / (a**2 + b**2) + 4 * a**2 * b**2 / (a**4 - b**4) * inner
        root = np.sqrt(max(1 - B**2, 0.0))
        cos2 = 1 / B**2 if B > 1 else (1 - root) / B**2
        return {
            "inclination": 0.5 * np.arccos(1 / B) if B > 1 else np.nan,
            "period": 2 * np.pi / (self.shear * root) if B < 1 else np.nan,
            "viscosity": k_d * (1 - cos2) + (ratio - 1) * inner * cos2,
        }


def quasi_circular(ratio: float, reduced_area: float, shear: float = SHEAR) -> dict[str, float]:
    """Returns inclination in radians and time of half a turn to leading order in the deficit; NaN as in `at`."""
    B = 1 / ((1 + ratio) * np.sqrt(2 * (1 - reduced_area) / 3))
    return {
        "inclination": 0.5 * np.arccos(1 / B) if B > 1 else np.nan,
        "period": 2 * np.pi / (shear * np.sqrt(1 - B**2)) if B < 1 else np.nan,
    }


@eqx.filter_jit
def _simulated(ratio, N, t_end, saves, tolerance):
    start = shapes.ellipse(N, AREA, angle=jnp.pi / 8)
    setting = make_scene(start, flow=Shear(SHEAR), viscosity_ratio=ratio)
    return simulate(setting, t_end, saves=saves, march=Adaptive(tolerance, max_steps=20_000))


def duration(ratio: float) -> float:
    """Returns a time in which treading comes to rest and several half-turns pass."""
    return 3.0 + 1.5 * min(0.5 * (1 + ratio), 5.0)


def measured(ratio: float, N=48, t_end=None, saves=400, tolerance=1e-5) -> dict:
    """Returns class, inclination at the end, time of half a turn, and [μ] of one run."""
    end = duration(ratio) if t_end is None else t_end
    result = _simulated(jnp.asarray(ratio), N, jnp.asarray(end), saves, jnp.asarray(tolerance))
    t, found = np.asarray(result.t), result.diagnostics
    angle, viscosity = np.asarray(found["inclination_unwrapped"][:, 0]), np.asarray(found["effective_viscosity"])
    motion, turning = classify(t, angle), half_turns(t, angle)
    tumbles = motion == "tumbling"
    return {
        "ratio": ratio,
        "status": status.WORDS[int(result.status)],
        "motion": motion,
        "inclination": np.nan if tumbles else float(angle[-1]),
        "period": turning.period if tumbles else np.nan,
        "viscosity": float(average(t, angle, viscosity, len(turning.times) - 1) if tumbles else viscosity[-1]),
    }


def run(ratios=RATIOS, **how) -> dict:
    """Returns one row for each ν, and the theory for the same ν."""
    theory = KellerSkalak.of(AREA)
    return {
        "rows": [measured(ratio, **how) for ratio in ratios],
        "theory": [theory.at(ratio) for ratio in ratios],
        "critical": theory.critical,
    }


@styled
def draw(found) -> Figure:
    """Draws inclination, time of half a turn, and [μ] against ν, with the theories as lines."""
    figure = Figure(figsize=(run_plots.PAGE, 2.4))
    panels = figure.subplots(1, 3, sharex=True)
    theory = KellerSkalak.of(AREA)
    fine = np.geomspace(0.1, 1000, 600)
    lines = [theory.at(ratio) for ratio in fine]
    names = {"inclination": r"$\theta$ (degrees)", "period": r"half a turn ($t_\kappa$)", "viscosity": r"$[\mu]$"}
    for axes, (name, label) in zip(panels, names.items(), strict=True):
        scale = np.degrees if name == "inclination" else np.asarray
        axes.semilogx(fine, scale([line[name] for line in lines]), color="0.5", label="Keller-Skalak")
        if name != "viscosity":
            values = scale([quasi_circular(ratio, AREA)[name] for ratio in fine])
            axes.semilogx(fine, values, "--", color="0.7", label="quasi-circular")
        for motion, (marker, colour) in _MARKERS.items():
            rows = [row for row in found["rows"] if row["motion"] == motion and np.isfinite(row[name])]
            if rows:
                values = scale([row[name] for row in rows])
                axes.plot([row["ratio"] for row in rows], values, marker, color=colour, ms=4, label=motion)
        axes.set(xlabel=r"$\nu$", ylabel=label)
    panels[1].set_ylim(0, 2.5)
    labels = {label: line for axes in panels for line, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    panels[0].legend(labels.values(), labels, loc="upper right")
    return figure


def main():
    parser = argparse.ArgumentParser(
        prog="python -m experiments.viscosity_contrast", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--figure", action="store_true", help="only the figure, of the stored numbers")
    if parser.parse_args().figure:
        stored = json.loads((HERE / "data" / "viscosity_contrast.json").read_text())["data"]
        save(draw(stored), "viscosity_contrast")
        return
    found = run()
    print(f"Keller-Skalak: nu_c = {found['critical']:.3f} at reduced area {AREA}")
    for row, theory in zip(found["rows"], found["theory"], strict=True):
        print(
            f"nu {row['ratio']:7g} {row['status']} {row['motion']:9}",
            *(f"{name} {row[name]:8.4f} ({theory[name]:8.4f})" for name in ("inclination", "period", "viscosity")),
        )
    store("viscosity_contrast", found)
    save(draw(found), "viscosity_contrast")


if __name__ == "__main__":
    main()
