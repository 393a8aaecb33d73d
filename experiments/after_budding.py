"""Does a budded vesicle become prolate again, how accurate is its motion, and what does a disturbance change?

    python -m experiments.after_budding          # a table and a figure, about seven minutes

Δ = 0.5, Λ = 0.1, G = 0. The vesicle starts as an ellipse along the field. The three fields are those for which Wu &
Veerapaneni give the time of the narrowest neck. Runs go to t = 1 with 128 nodes and tolerance 1e-5. They are compared
with 192 nodes and a tenth of the tolerance. The scene is symmetric under reflection in both axes, and the solution is
kept symmetric. Another run starts 1e-8 away from symmetry.

What to expect: prolate again at t = 1 at all three fields. Area and perimeter are kept to 1e-6 up to the narrowest
neck. The neck amplifies deviations from symmetry by 1e5 and more, so a real bud would open on one side or shear. The
symmetric solution is right to 1e-4 and 1e-3 at β = 9.6 and 12.8 throughout. At β = 16 it is right up to the narrowest
neck and again at the end.
"""

import equinox as eqx
import numpy as np
from matplotlib.figure import Figure

from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

from ._common import march, pop, save, store, styled
from ._distance import distances

NECK = {9.6: 0.2525, 12.8: 0.2171, 16.0: 0.1773}  # by `pop_and_budding`
APART = 1e-8  # how far from symmetric the disturbed start is
QUICK = dict(betas=(3.2,), N=32, finer=48, t_end=0.1, saves=4, reduced_area=0.9, tolerance=1e-4)


def mirrored(rows, axis):
    """Returns the rows reflected through the origin across `axis`, counter-clockwise again."""
    sign = np.where(np.arange(2) == axis, -1.0, 1.0)
    turned = {name: rows[name][:, :, ::-1] for name in ("x", "V_m", "tension")}
    return turned | {"x": turned["x"] * sign}


def run(betas=tuple(NECK), N=128, finer=192, tolerance=1e-5, t_end=1.0, saves=100, reduced_area=0.5):
    """Returns {β: {status, t, deformation, neck (narrowest chord between nodes), error, asymmetry, area, ...}}."""
    times = t_end * np.arange(1, saves + 1) / saves

    def marched(scene, tolerance):
        state, rows, equation = march(scene, Adaptive(tolerance), times)
        return state, {name: row[~np.isnan(rows["t"])] for name, row in rows.items()}, equation

    def apart(one, other):
        """Returns the distance between the shapes at the times that both have."""
        both = min(len(one["t"]), len(other["t"]))
        one, other = ({name: row[:both] for name, row in rows.items()} for rows in (one, other))
        return distances(one, other)["shape"]

    found = {}
    for beta in betas:
        scene = pop(N, reduced_area=reduced_area, beta=beta)
        state, rows, equation = marched(scene, tolerance)
        _, check, _ = marched(pop(finer, reduced_area=reduced_area, beta=beta), tolerance / 10)
        start = shapes.disturbed(scene.x[0], APART)[None]
        _, other, _ = marched(eqx.tree_at(lambda s: s.x, scene, start), tolerance)
        found[beta] = {
            "status": status.WORDS[max(int(state.status), status.COMPLETE)],
            "steps": int(state.steps),
            "rejected": int(state.rejected),
            "t": rows["t"],
            "deformation": rows["deformation_along_field"][:, 0],
            "neck": rows["self_gap"][:, 0],
            "error": apart(rows, check),
            "asymmetry": np.max([distances(other, mirrored(other, k))["shape"] for k in (0, 1)], axis=0),
            "area": np.abs(rows["area"][:, 0] / float(equation.area[0]) - 1),
            "length": np.abs(rows["length"][:, 0] / (2 * np.pi * float(equation.speed[0])) - 1),
        }
    return found


@styled
def draw(found) -> Figure:
    """Draws deformation along the field, error, and asymmetry of a disturbed start against time."""
    figure = Figure(figsize=(run_plots.PAGE, 2.4))
    left, middle, right = figure.subplots(1, 3)
    for beta, row in found.items():
        left.plot(row["t"], row["deformation"], label=rf"$\beta = {beta:g}$")
        middle.semilogy(row["t"][: len(row["error"])], np.maximum(row["error"], 1e-9))
        right.semilogy(row["t"][: len(row["asymmetry"])], np.maximum(row["asymmetry"], 1e-9))
    left.axhline(0, color="0.6", lw=0.6)
    left.set(xlabel=r"$t/t_\kappa$", ylabel="deformation $D$", title="prolate above, oblate below")
    left.legend()
    middle.set(xlabel=r"$t/t_\kappa$", ylabel="distance / $a$", title="from a finer run")
    right.set(xlabel=r"$t/t_\kappa$", title="between mirror images,\nstart disturbed by $10^{-8}$")
    right.sharey(middle)
    return figure


def main():
    found = run()
    for beta, row in found.items():
        until = row["t"] <= NECK[beta]
        print(
            f"β = {beta:g}: {row['status']} at t = {row['t'][-1]:g} after {row['steps']}+{row['rejected']} steps, "
            f"D = {row['deformation'][-1]:.3f}; area and length to {np.max(row['area'][until]):.0e} and "
            f"{np.max(row['length'][until]):.0e} until the narrowest neck, {np.max(row['area']):.0e} and "
            f"{np.max(row['length']):.0e} to the end; error at most {np.max(row['error']):.0e}, "
            f"{row['error'][-1]:.0e} at the end; disturbed by {APART:.0e}: asymmetry at most "
            f"{np.max(row['asymmetry']):.0e}, {row['asymmetry'][-1]:.0e} at the end"
        )
    store("after_budding", found)
    save(draw(found), "after_budding")


if __name__ == "__main__":
    main()
