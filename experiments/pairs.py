"""Do two vesicles chain, oscillate or circulate as the conductivity ratio rises?

    python -m experiments.pairs          # a few minutes: table, figures/pairs.png, data/pairs.json

Δ = 0.9, β = 3.2, G = 0, Ca = 0, as in the paper; centres 2.6 a apart, 20° from the horizontal.

What to expect: at small Λ the line of centres swings to the field (90°) and stays, with a film that keeps draining;
in between it passes 90° and comes back; at Λ = 0.5 it turns on and on; beyond Λ = 1 it turns the other way.
"""

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments import _common
from jaxves import shapes, status
from jaxves.marching import Adaptive
from jaxves.scene import dc_field, make_scene

QUICK = dict(ratios=(0.1,), t_end=0.1, saves=2, N=32, tolerance=1e-3)


def run(ratios=(0.1, 0.2, 0.3, 0.5, 0.8, 2.0), t_end=10.0, saves=100, N=64, tolerance=1e-4):
    """For each Λ: word, times, angle of the line of centres (degrees, followed in time), gap, separation."""
    e = shapes.ellipse(N, 0.9, angle=jnp.pi / 2)
    half = 1.3 * np.array([np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))])
    found = {}
    for ratio in ratios:
        field = dc_field(3.2, conductivity_ratio=ratio, vesicles=2)
        setting = make_scene([e, e], centers=[half, -half], field=field)
        state, rows, _ = _common.march(setting, Adaptive(tolerance), t_end * np.arange(1, saves + 1) / saves)
        known = ~np.isnan(rows["t"])
        line = rows["diagnostics/center"][known, 0] - rows["diagnostics/center"][known, 1]
        found[ratio] = {
            "word": status.WORDS[max(int(state.status), status.COMPLETE)],
            "steps": int(state.steps),
            "t": rows["t"][known],
            "angle": np.rad2deg(np.unwrap(np.arctan2(line[:, 1], line[:, 0]))),
            "gap": rows["diagnostics/min_gap"][known],
            "separation": np.hypot(*line.T),
            "tail": rows["diagnostics/spectral_tail"][known].max(),
        }
    return found


def draw(found) -> Figure:
    """Angle and gap against time."""
    figure = Figure(figsize=(6.8, 2.6), layout="constrained")
    turning, draining = figure.subplots(1, 2)
    for ratio, case in found.items():
        turning.plot(case["t"], case["angle"], label=rf"$\Lambda$ = {ratio:g}")
        draining.semilogy(case["t"], case["gap"])
    turning.axhline(90, color="0.7", linewidth=0.8, zorder=0)
    turning.set(xlabel=r"$t/t_\kappa$", ylabel="line of centres (degrees)", ylim=(-400, 700))
    draining.set(xlabel=r"$t/t_\kappa$", ylabel="gap $/a$")
    turning.legend(fontsize="x-small")
    return figure


def main():
    found = run()
    for ratio, case in found.items():
        print(
            f"Λ = {ratio:4g}: {case['word']} at t = {case['t'][-1]:.2f} after {case['steps']} steps; angle from 20 to "
            f"{case['angle'].min():.0f} … {case['angle'].max():.0f}, last {case['angle'][-1]:.0f} degrees; "
            f"gap {case['gap'].min():.4f} … {case['gap'].max():.3f}; tail {case['tail']:.0e}"
        )
    _common.store("pairs", {str(ratio): case for ratio, case in found.items()})
    _common.save(_common.styled(draw)(found), "pairs")


if __name__ == "__main__":
    main()
