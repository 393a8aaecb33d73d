"""Which conductivity ratio and field give a vesicle in shear a wanted angle and viscosity?

    python -m experiments.inverse_design          # the search and a figure, two minutes

Δ = 0.9, G = 4, Ca = 10. Wanted are an inclination of 20° and [μ] = 1.95. The steady shape is computed by Newton's
method for each (Λ, β), and its derivatives are implicit. Newton's method for the two targets uses the logarithms of
both numbers. Its steps are limited to a sixth, so that the shape can follow. Only the first shape needs a simulation.

What to expect: both targets are met to a millionth of their scales in ten or twenty steps from Λ = 0.4, β = 6.4. Not
every start leads there: [μ] has a minimum near Λ = 0.2, and from below it Newton's method moves away.
"""

import numpy as np
from matplotlib.figure import Figure

from jaxves.analysis import sensitivity
from jaxves.plots import run_plots
from jaxves.runs.build import scene_of

from ._common import save, store, styled
from .sensitivity import _next, _start, treading

NAMES = ("field.conductivity_ratio", "field.beta")
WANTED = {"inclination": float(np.radians(20.0)), "effective_viscosity": 1.95}
SCALE = {"inclination": float(np.radians(3.0)), "effective_viscosity": 0.1}
QUICK = dict(N=32, t_end=0.3, most=2)


def run(wanted=WANTED, N=64, t_end=1.5, most=100, longest=0.15, enough=1e-6):
    """Returns the path of the search: numbers, results and deviations, and the first and last outlines."""
    file = treading(N)
    first = dict(zip(NAMES, (0.4, 6.4), strict=True))
    y = _start(scene_of(file, first), t_end)
    logs = np.log(list(first.values()))
    path, outlines = [], []
    for _ in range(most):
        values = dict(zip(NAMES, np.exp(logs), strict=True))
        y = _next(file, values, y).y
        outputs, slopes = sensitivity.jacobian(sensitivity.AtRest(file, tuple(wanted), y), values)
        given = {key: np.ravel(outputs[key]).item() for key in wanted}
        missed = np.array([(given[key] - wanted[key]) / SCALE[key] for key in wanted])
        path.append(values | given | {"off": np.max(np.abs(missed))})
        outlines.append(np.asarray(y.x[0]))
        if path[-1]["off"] < enough:
            break
        jacobian = [
            [np.ravel(slopes[key][name]).item() * values[name] / SCALE[key] for name in NAMES] for key in wanted
        ]
        step, *_ = np.linalg.lstsq(np.array(jacobian), -missed)
        logs = logs + step * min(1.0, longest / np.max(np.abs(step)))
    return {"path": path, "outlines": np.array([outlines[0], outlines[-1]])}


@styled
def draw(found) -> Figure:
    """Draws the outlines before and after, the path through (Λ, β), and the distance from both targets."""
    figure = Figure(figsize=(run_plots.PAGE, 2.4))
    left, middle, right = figure.subplots(1, 3)
    path = found["path"]
    for outline, label, row in zip(found["outlines"], ("start", "found"), (path[0], path[-1]), strict=True):
        x = np.concatenate([outline, outline[:1]]) - outline.mean(axis=0)
        (line,) = left.plot(*x.T, label=f"{label}: {np.degrees(row['inclination']):.1f}°")
        ends = 1.5 * np.array([-1, 1])
        left.plot(ends * np.cos(row["inclination"]), ends * np.sin(row["inclination"]), color=line.get_color(), lw=0.7)
    left.set(aspect="equal", xlabel="$x/a$", ylabel="$y/a$", ylim=(-1.3, 1.9))
    left.legend(loc="upper center")
    middle.plot([row[NAMES[0]] for row in path], [row[NAMES[1]] for row in path], "o-", ms=2)
    middle.plot(path[-1][NAMES[0]], path[-1][NAMES[1]], "k*", ms=9, label="found")
    middle.set(xlabel=r"conductivity ratio $\Lambda$", ylabel=r"field strength $\beta$")
    middle.legend(loc="lower right", frameon=True)
    for name, label in (("inclination", r"inclination $\theta$"), ("effective_viscosity", r"viscosity $[\mu]$")):
        right.semilogy([abs(row[name] / WANTED[name] - 1) for row in path], "o-", ms=2.5, label=label)
    right.set(xlabel="step of the search", ylabel="relative distance from the target")
    right.legend()
    return figure


def main():
    found = run()
    for i, row in enumerate(found["path"]):
        if i % 5 == 0 or i == len(found["path"]) - 1:
            angle, viscosity = np.degrees(row["inclination"]), row["effective_viscosity"]
            print(f"{i:3}  Λ = {row[NAMES[0]]:.5f}  β = {row[NAMES[1]]:.4f}  {angle:.4f}°  [μ] = {viscosity:.5f}")
    store("inverse_design", found)
    save(draw(found), "inverse_design")


if __name__ == "__main__":
    main()
