"""How does a chain of prolates become one of oblates as the conductance grows, and at which Λ are there kidneys?

    python -m experiments.pair_transition          # ten minutes: table, a figure, data/pair_transition.json

Δ = 0.9, β = 3.2, Ca = 0, G from 0 to 4 for Λ = 0.1 (the paper's text) and Λ = 0.9 (its caption); 2.6 a apart, 20°.

The paper has damped oscillations and kidney shapes at G = 0.096, 0.144, 0.192, and direct chains at the others. The
outline of a kidney is concave in a part: its least curvature is below zero at the end.
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments import _common, _pairs
from jaxves.geometry.curve import Curve
from jaxves.observables import pair_classes
from jaxves.plots import run_plots

RATIOS = (0.1, 0.9)
CONDUCTANCES = (0.0, 0.048, 0.096, 0.144, 0.192, 0.5, 1.0, 4.0)
FILM = 0.03
QUICK = dict(ratios=(0.1,), conductances=(4.0,), t_end=0.5, saves=4, nodes=(32,))


def run(ratios=RATIOS, conductances=CONDUCTANCES, t_end=12.0, saves=240, nodes=(64, 128)):
    """{(Λ, G): history with class, complete swings beyond a degree about the field, least curvature at each save}."""
    found = {}
    for ratio in ratios:
        for G in conductances:
            case = _pairs.resolved(nodes, FILM, t_end, saves, conductivity_ratio=ratio, membrane_conductance=G)
            tilt = pair_classes.tilt(np.deg2rad(case["angle"]), np.pi / 2)
            swings = np.rad2deg(pair_classes.swings(tilt))
            curvature = jax.jit(jax.vmap(jax.vmap(lambda x: jnp.min(Curve.from_nodes(x).curvature))))(case["x"])
            found[ratio, G] = case | {"swings": swings, "least_curvature": np.asarray(curvature).min(axis=1)}
    return found


def draw(found) -> Figure:
    """Draws, for each Λ, the final shapes and the angle of the line of centres against time."""
    ratios = sorted({key[0] for key in found})
    conductances = sorted({key[1] for key in found})
    figure = Figure(figsize=(run_plots.PAGE, 3.4 * len(ratios)), layout="constrained")
    parts = np.atleast_1d(figure.subfigures(len(ratios), 1))
    for part, ratio in zip(parts, ratios, strict=True):
        shapes, angles = part.subfigures(2, 1, height_ratios=(1, 1.3))
        panels = shapes.subplots(1, len(conductances), squeeze=False)[0]
        turning = angles.subplots()
        for panel, G, color in zip(panels, conductances, _common.shades(len(conductances)), strict=True):
            case = found[ratio, G]
            run_plots.membranes(panel, case["x"][-1]).set(linewidth=1.0)
            panel.set(xlim=(-2.6, 2.6), ylim=(-3, 3), xticks=[], yticks=[], title=f"$G = {G:g}$")
            turning.plot(case["t"], case["angle"], color=color, label=f"$G = {G:g}$", lw=1.0)
        turning.axhline(90, color="0.7", lw=0.8, zorder=0)
        turning.set(xlabel=r"$t/t_\kappa$", ylabel="line of centres (degrees)")
        turning.legend(ncols=2, fontsize="x-small")
        part.suptitle(rf"$\Lambda = {ratio:g}$", fontsize=8)
    return figure


def main():
    found = run()
    for (ratio, G), case in found.items():
        swings = ", ".join(f"{swing:+.1f}" for swing in case["swings"]) or "none"
        curvature = case["least_curvature"]
        print(
            f"Λ = {ratio:g}, G = {G:5g}: {_pairs.summary(case)}; D {case['deformation'][-1].mean():+.3f}; "
            f"swings {swings}; least curvature {curvature.min():+.2f}, last {curvature[-1]:+.2f}"
        )
    _common.store("pair_transition", {str(key): _pairs.stored(case) for key, case in found.items()})
    _common.save(_common.styled(draw)(found), "pair_transition")


if __name__ == "__main__":
    main()
