"""Which inclination and viscosity has a vesicle in shear without a field, also as it becomes a circle?

    python -m experiments.shear          # tables and a figure, about three minutes

Steady inclination and intrinsic viscosity [μ] at Ca = 10 for several reduced areas Δ, with three numbers of nodes and
two tolerances each; then an extrapolation to Δ = 1.

What to expect: four digits that do not change with nodes and tolerance. A circle has exactly [μ] = 2. [μ] differs from
it by a term in 1 - Δ, and the inclination differs from π/4 by a term in √(1 - Δ). Polynomials in these variables must
have both limits.
"""

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.geometry import shapes
from jaxves.physics.flow import Shear
from jaxves.physics.scene import make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

from ._common import march, save, store, styled

AREAS = (0.6, 0.7, 0.8, 0.9)
NEARLY_ROUND = (0.97, 0.98, 0.99, 0.995)


QUICK = dict(areas=(0.9,), cases=((32, 1e-4),), nearly_round=(0.97, 0.98, 0.99), N=32, tolerance=1e-5, t_end=2.0)


def steady(reduced_area, N, tolerance, capillary_number=10.0, t_end=4.0):
    """Inclination (rad), [μ] and tank-treading speed at `t_end`; how much the first two changed in its last eighth."""
    setting = make_scene(shapes.ellipse(N, reduced_area, angle=0.8 * jnp.pi / 4), flow=Shear(capillary_number))
    _, rows, _ = march(setting, Adaptive(tolerance), t_end * np.array([7 / 8, 1.0]))
    names = {"inclination": "inclination", "viscosity": "effective_viscosity", "speed": "tank_treading_speed"}
    series = {name: rows[key].reshape(2) for name, key in names.items()}
    found = {name: float(values[-1]) for name, values in series.items()}
    still = max(abs(series[name][1] - series[name][0]) for name in ("inclination", "viscosity"))
    return found | {"still": float(still)}


def limits(table):
    """Returns values at Δ = 1 of polynomials through the nearly round vesicles.

    [μ] is a polynomial in 1 - Δ, the inclination in √(1 - Δ). Polynomials of one degree less through all but the
    roundest give an error estimate.
    """
    out = {}
    for name, power in (("viscosity", 1.0), ("inclination", 0.5)):
        deficit = np.array([1 - area for area in table]) ** power
        values = np.array([row[name] for row in table.values()])
        out[name] = float(np.polyfit(deficit, values, len(values) - 1)[-1])
        out[f"{name}, one less"] = float(np.polyfit(deficit[:-1], values[:-1], len(values) - 2)[-1])
    return out


def run(
    areas=AREAS,
    cases=((64, 1e-5), (96, 1e-5), (128, 1e-5), (96, 1e-6)),
    nearly_round=NEARLY_ROUND,
    N=64,
    tolerance=1e-7,
    t_end=4.0,
):
    """Returns steady values by Δ and (nodes, tolerance), those towards a circle, and their limits."""
    table = {
        area: {f"N = {n}, tolerance {tol:.0e}": steady(area, n, tol, t_end=t_end) for n, tol in cases} for area in areas
    }
    towards = {area: steady(area, N, tolerance, t_end=t_end) for area in nearly_round}
    return {"steady": table, "nearly round": towards, "limits": limits(towards)}


@styled
def draw(found) -> Figure:
    """Draws inclination and [μ] in the variables in which they are smooth."""
    points = {area: list(rows.values())[-1] for area, rows in found["steady"].items()} | found["nearly round"]
    figure = Figure(figsize=(run_plots.PAGE, 2.5))
    left, right = figure.subplots(1, 2)
    deficit = 1 - np.array(list(points))
    for axes, name, power, limit, scale in (
        (left, "inclination", 0.5, 45.0, 180 / np.pi),
        (right, "viscosity", 1.0, 2.0, 1.0),
    ):
        near = [area for area in points if area in found["nearly round"]]
        fit = np.polyfit((1 - np.array(near)) ** power, [scale * points[a][name] for a in near], len(near) - 1)
        fine = np.linspace(0, (1 - min(near)) ** power, 50)
        axes.plot(deficit**power, [scale * row[name] for row in points.values()], "o", ms=3.5, label="steady states")
        axes.plot(fine, np.polyval(fit, fine), color="C1", label="polynomial through the four roundest")
        axes.plot(0, limit, "k+", ms=8, label="circle, exact")
    left.set(xlabel=r"$\sqrt{1-\Delta}$", ylabel="inclination (degrees)")
    right.set(xlabel=r"$1-\Delta$", ylabel=r"intrinsic viscosity $[\mu]$")
    right.legend()
    return figure


def main():
    found = run()
    print("Δ        nodes, tolerance            inclination/π   [μ]        speed      still changing by")

    def show(area, name, row):
        angle, viscosity = row["inclination"] / np.pi, row["viscosity"]
        print(f"{area:<7}  {name:26}  {angle:.6f}      {viscosity:.6f}  {row['speed']:.5f}  {row['still']:.0e}")

    for area, rows in found["steady"].items():
        for name, row in rows.items():
            show(area, name, row)
    for area, row in found["nearly round"].items():
        show(area, "N = 64, tolerance 1e-07", row)
    ends = found["limits"]
    for name, unit, exact in (("viscosity", 1.0, 2.0), ("inclination", np.pi, 0.25)):
        best, less = ends[name] / unit, ends[f"{name}, one less"] / unit
        print(f"Δ → 1: {name} {best:.6f} (one point less: {less:.6f}), exact {exact}")
    store("shear", found)
    save(draw(found), "shear")


if __name__ == "__main__":
    main()
