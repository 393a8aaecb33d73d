"""What becomes of a budded vesicle: does it turn prolate again, and is it still symmetric then?

    python -m experiments.after_budding          # a table and a figure, about four minutes

Δ = 0.5, Λ = 0.1, G = 0, from an ellipse along the field, at the three fields for which Wu & Veerapaneni give the time
of the narrowest neck, and on to t = 1 with 128 nodes and tolerance 1e-5. The scene is symmetric under reflection in
both axes, and so is its solution; necks under compression amplify what round-off breaks of it.

What to expect: prolate again at t = 1 at all three fields, area and perimeter kept to 1e-6 up to the narrowest neck;
the distance between the outline and its mirror images grows from 1e-13 by a factor of 1e8 and more while there are
necks, to a visible size at β = 9.6 and 16, and falls once they have opened.
"""

import numpy as np
from matplotlib.figure import Figure

from jaxves import plot, status
from jaxves.marching import Adaptive

from ._common import march, pop, save, store, styled
from ._distance import distances

NECK = {9.6: 0.2525, 12.8: 0.2171, 16.0: 0.1773}  # by `pop_and_budding`
QUICK = dict(betas=(3.2,), N=32, t_end=0.1, saves=4, reduced_area=0.9, tolerance=1e-4)


def mirrored(rows, axis):
    """The rows as seen in a mirror through the origin across `axis`, again counter-clockwise."""
    sign = np.where(np.arange(2) == axis, -1.0, 1.0)
    turned = {name: rows[name][:, :, ::-1] for name in ("x", "V_m", "tension")}
    return turned | {"x": turned["x"] * sign}


def run(betas=tuple(NECK), N=128, tolerance=1e-5, t_end=1.0, saves=100, reduced_area=0.5):
    """{β: {status, t, deformation, neck (narrowest chord between nodes), asymmetry, area, length, ...}} over time."""
    found = {}
    for beta in betas:
        times = t_end * np.arange(1, saves + 1) / saves
        scene = pop(N, reduced_area=reduced_area, beta=beta)
        state, rows, equation = march(scene, Adaptive(tolerance), times, together=saves)
        rows = {name: row[~np.isnan(rows["t"])] for name, row in rows.items()}
        asymmetry = [distances(rows, mirrored(rows, axis))["shape"] for axis in (0, 1)]
        found[beta] = {
            "status": status.WORDS[max(int(state.status), status.COMPLETE)],
            "steps": int(state.steps),
            "rejected": int(state.rejected),
            "t": rows["t"],
            "deformation": rows["diagnostics/deformation_along_field"][:, 0],
            "neck": rows["diagnostics/self_gap"][:, 0],
            "asymmetry": np.max(asymmetry, axis=0),
            "area": np.abs(rows["diagnostics/area"][:, 0] / float(equation.area[0]) - 1),
            "length": np.abs(rows["diagnostics/length"][:, 0] / (2 * np.pi * float(equation.speed[0])) - 1),
        }
    return found


@styled
def draw(found) -> Figure:
    """Deformation along the field, and asymmetry, against time."""
    figure = Figure(figsize=(plot.PAGE, 2.4))
    left, right = figure.subplots(1, 2)
    for beta, row in found.items():
        left.plot(row["t"], row["deformation"], label=rf"$\beta = {beta:g}$")
        right.semilogy(row["t"], np.maximum(row["asymmetry"], 1e-16))
    left.axhline(0, color="0.6", lw=0.6)
    left.set(xlabel=r"$t/t_\kappa$", ylabel="deformation $D$", title="prolate above, oblate below")
    left.legend()
    right.set(xlabel=r"$t/t_\kappa$", ylabel="distance / $a$", title="between the outline and its mirror images")
    return figure


def main():
    found = run()
    for beta, row in found.items():
        until = row["t"] <= NECK[beta]
        print(
            f"β = {beta:g}: {row['status']} at t = {row['t'][-1]:g} after {row['steps']}+{row['rejected']} steps, "
            f"D = {row['deformation'][-1]:.3f}; area and length to {np.max(row['area'][until]):.0e} and "
            f"{np.max(row['length'][until]):.0e} until the narrowest neck, {np.max(row['area']):.0e} and "
            f"{np.max(row['length']):.0e} to the end; asymmetry at most {np.max(row['asymmetry']):.0e}, "
            f"{row['asymmetry'][-1]:.0e} at the end"
        )
    store("after_budding", found)
    save(draw(found), "after_budding")


if __name__ == "__main__":
    main()
