"""How do the membranes, the fluid and the dipoles of a circulating pair move?

    python -m experiments.pair_circulation          # two minutes: figures/pair_circulation.png, table

Λ = 0.5, G = 0, Δ = 0.9, β = 3.2, Ca = 0. The figure has membranes coloured by V_m, streamlines of the fluid, and an
arrow along each dipole, at three instants of one revolution.

What to expect: each vesicle treads, both circulate about each other in the same direction, and the dipoles stay tilted
from the field to the same side.
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments import _common, _pairs
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.observables.fields import fields_at
from jaxves.plots import run_plots, style

INSTANTS = (3.0, 4.5, 5.5)
QUICK = dict(instants=(0.25, 0.5), N=32, t_end=0.5, saves=4, resolution=8)
HALF = 3.0  # half the width of the window


def run(instants=INSTANTS, N=64, t_end=8.0, saves=160, resolution=100):
    """{t: nodes, V_m, dipole angles, speeds of treading, velocity at the points of a square grid}, and the grid."""
    setting = _pairs.scene(0.5, N=N)
    case = _pairs.history(setting, t_end, saves)
    grid = np.linspace(-HALF, HALF, resolution) + 0.013
    points = jnp.asarray(np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2))

    @jax.jit
    def velocity(t, x, V_m):
        return fields_at(equation_for(setting), t, Unknowns.of(x, V_m), points).velocity

    found = {}
    for instant in instants:
        row = int(np.argmin(np.abs(case["t"] - instant)))
        flow = velocity(case["t"][row], jnp.asarray(case["x"][row]), jnp.asarray(case["V_m"][row]))
        found[float(case["t"][row])] = {
            **{name: case[name][row] for name in ("x", "V_m", "center", "dipole_angle", "tank_treading_speed")},
            "velocity": np.asarray(flow).reshape(resolution, resolution, 2),
        }
    return found, grid


def draw(found, grid) -> Figure:
    """Draws one panel for each of up to three instants."""
    figure = Figure(figsize=(6.4, 2.2), layout="constrained")
    colors = style.scale(np.stack([case["V_m"] for case in found.values()]))
    axes = figure.subplots(1, 3, squeeze=False).ravel()
    for ax, (t, case) in zip(axes, found.items(), strict=False):
        u, v = np.moveaxis(case["velocity"], -1, 0)
        ax.streamplot(grid, grid, u, v, density=0.8, color="0.6", linewidth=0.4, arrowsize=0.4)
        run_plots.membranes(ax, case["x"], case["V_m"], colors)
        for center, angle in zip(case["center"], np.deg2rad(np.atleast_1d(case["dipole_angle"])), strict=False):
            half = 0.35 * np.array([np.cos(angle), np.sin(angle)])
            arrow = dict(arrowstyle="-|>", color=run_plots.INK, linewidth=1.0, shrinkA=0, shrinkB=0)
            ax.annotate("", center + half, center - half, arrowprops=arrow)
        ax.set(xlim=(-HALF, HALF), ylim=(-HALF, HALF), xticks=[], yticks=[], title=style.time_label(t))
    figure.colorbar(colors, ax=axes, label=style.SYMBOLS["V_m"], shrink=0.9, aspect=20)
    return figure


def main():
    found, grid = run()
    for t, case in found.items():
        print(
            f"t = {t:.2f}: dipoles {np.round(case['dipole_angle'], 1)} degrees from x, "
            f"treading {np.round(case['tank_treading_speed'], 2)}"
        )
    _common.save(_common.styled(draw)(found, grid), "pair_circulation")


if __name__ == "__main__":
    main()
