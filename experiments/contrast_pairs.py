r"""Does another viscosity inside turn the circulation of a pair into oscillation?

    python -m experiments.contrast_pairs      # table and figure, about five minutes

The pair is that of `pairs` at G = 0: Δ = 0.9, β = 3.2, centres 2.6 a apart and 20° from the horizontal, for Λ = 0.5
and 2 and for viscosity ratios ν from 0.1 to 10. It has 32 nodes and a tolerance of 1e-3.

What to expect: a pair circulates because the field makes its vesicles tread. A viscous inside slows treading, while
the attraction of aligned vesicles does not depend on it. So a chain may take the place of circulation at large ν.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

from . import _pairs
from ._common import save, shades, store, styled

RATIOS = (0.1, 1.0, 3.0, 10.0)
CONDUCTIVITIES = (0.5, 2.0)
QUICK = dict(ratios=(3.0,), conductivities=(0.5,), t_end=0.2, saves=4, nodes=16)


def paired(ratio: float, conductivity: float, nodes: int, t_end: float, saves: int) -> dict:
    """Returns the history of a pair and its class."""
    alone = _pairs.scene(conductivity, N=nodes)
    scene = eqx.tree_at(lambda s: s.viscosity_ratio, alone, jnp.full(2, ratio), is_leaf=lambda leaf: leaf is None)
    found = _pairs.history(scene, t_end, saves, march=Adaptive(1e-3), thinnest=0.03, turned=270.0)
    turns = float(np.sign(found["angle"][-1] - found["angle"][0]))
    return found | {"N": nodes, "class": _pairs.classified(found), "turns": turns}


def run(ratios=RATIOS, conductivities=CONDUCTIVITIES, t_end=12.0, saves=240, nodes=32) -> dict:
    """Returns the histories by Λ and ν."""
    return {at: {ratio: paired(ratio, at, nodes, t_end, saves) for ratio in ratios} for at in conductivities}


@styled
def draw(found) -> Figure:
    """Draws the line of centres and the gap against time for each Λ."""
    figure = Figure(figsize=(run_plots.PAGE, 3.6))
    panels = figure.subplots(2, len(found), sharex="col", squeeze=False)
    for (above, below), (at, rows) in zip(panels.T, found.items(), strict=True):
        for (ratio, row), colour in zip(rows.items(), shades(len(rows)), strict=True):
            above.plot(row["t"], row["angle"], color=colour, label=f"{ratio:g}")
            below.plot(row["t"], row["min_gap"], color=colour)
        above.axhline(90, color="0.7", lw=0.8, zorder=0)
        above.set(title=rf"$\Lambda = {at:g}$", ylabel="line of centres (degrees)")
        below.set(xlabel=r"$t/t_\kappa$", ylabel="gap $/a$", ylim=(0, None))
    panels[0, 0].legend(title=r"$\nu$", fontsize=6)
    return figure


def main():
    found = run()
    for at, rows in found.items():
        for ratio, row in rows.items():
            print(f"Λ {at:g} ν {ratio:4g}: {_pairs.summary(row)}")
    store(
        "contrast_pairs", {at: {ratio: _pairs.stored(row) for ratio, row in rows.items()} for at, rows in found.items()}
    )
    save(draw(found), "contrast_pairs")


if __name__ == "__main__":
    main()
