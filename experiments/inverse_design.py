"""Which conductivity ratio and field make a vesicle in shear tread at a wanted angle and viscosity?

    python -m experiments.inverse_design          # the search and a figure, two minutes

Δ = 0.9, G = 4, Ca = 10. Wanted: an inclination of 3° and [μ] = 1.7, which a field changes in different ways. The steady
shape follows (Λ, β) by Newton's method, its derivatives are implicit, and Adam (optax) walks in the logarithms of both:
no simulation but the one that finds the first shape.

What to expect: both wishes met within a thousandth in less than a hundred steps.
"""

import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure

from jaxves import plot, sensitivity
from jaxves.parameters import scene_of

from ._common import save, store, styled
from .sensitivity import _next, _start, treading

NAMES = ("field.conductivity_ratio", "field.beta")
WANTED = {"inclination": float(np.radians(3.0)), "effective_viscosity": 1.7}
SCALE = {"inclination": float(np.radians(3.0)), "effective_viscosity": 0.1}
QUICK = dict(N=32, t_end=0.3, most=2)


def run(wanted=WANTED, N=64, t_end=1.5, most=100, rate=0.05, enough=1e-3):
    """The path of the search: numbers, what they give, how far off; the first and last outlines."""
    file = treading(N)
    y = _start(scene_of(file, {}), t_end)
    logs = jnp.log(jnp.array([0.1, 6.4]))
    method = optax.adam(rate)
    state = method.init(logs)
    path, outlines = [], []
    for _ in range(most):
        values = dict(zip(NAMES, np.exp(np.asarray(logs)), strict=True))
        y = _next(file, values, y).y
        outputs, slopes = sensitivity.jacobian(sensitivity.at_rest(file, tuple(wanted), y), values)
        missed = {key: (float(np.ravel(outputs[key])[0]) - wanted[key]) / SCALE[key] for key in wanted}
        given = {key: float(np.ravel(outputs[key])[0]) for key in wanted}
        path.append(values | given | {"off": max(map(abs, missed.values()))})
        outlines.append(np.asarray(y.x[0]))
        if path[-1]["off"] < enough:
            break
        gradient = jnp.array(
            [
                sum(
                    2 * missed[key] / SCALE[key] * float(np.ravel(slopes[key][name])[0]) * values[name]
                    for key in wanted
                )
                for name in NAMES
            ]
        )
        step, state = method.update(gradient, state)
        logs = optax.apply_updates(logs, step)
    return {"path": path, "outlines": np.array([outlines[0], outlines[-1]])}


@styled
def draw(found) -> Figure:
    """The outlines before and after, the way through (Λ, β), and how both wishes came true."""
    figure = Figure(figsize=(plot.PAGE, 2.4))
    left, middle, right = figure.subplots(1, 3)
    path = found["path"]
    for outline, label, row in zip(found["outlines"], ("start", "found"), (path[0], path[-1]), strict=True):
        x = np.concatenate([outline, outline[:1]]) - outline.mean(axis=0)
        (line,) = left.plot(*x.T, label=f"{label}: {np.degrees(row['inclination']):.1f}°")
        ends = 1.5 * np.array([-1, 1])
        left.plot(ends * np.cos(row["inclination"]), ends * np.sin(row["inclination"]), color=line.get_color(), lw=0.7)
    left.set(aspect="equal", xlabel="x", ylabel="y", ylim=(-1.4, 1.4))
    left.legend(loc="upper center")
    middle.plot([row[NAMES[0]] for row in path], [row[NAMES[1]] for row in path], "o-", ms=2)
    middle.plot(path[-1][NAMES[0]], path[-1][NAMES[1]], "k*", ms=9)
    middle.set(xlabel="Λ", ylabel="β")
    right.plot([np.degrees(row["inclination"]) for row in path], label="inclination (degrees)")
    right.plot([row["effective_viscosity"] for row in path], label=r"$[\mu]$")
    for value in (np.degrees(WANTED["inclination"]), WANTED["effective_viscosity"]):
        right.axhline(value, color="0.6", lw=0.8)
    right.set(xlabel="step of the search")
    right.legend()
    return figure


def main():
    found = run()
    for i, row in enumerate(found["path"]):
        if i % 10 == 0 or i == len(found["path"]) - 1:
            angle, viscosity = np.degrees(row["inclination"]), row["effective_viscosity"]
            print(f"{i:3}  Λ = {row[NAMES[0]]:.5f}  β = {row[NAMES[1]]:.4f}  {angle:.4f}°  [μ] = {viscosity:.5f}")
    store("inverse_design", found)
    save(draw(found), "inverse_design")


if __name__ == "__main__":
    main()
