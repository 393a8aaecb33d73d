"""Is a vesicle that tank-treads for a hundred t_κ steady?

    python -m experiments.long_run          # a table, about six minutes

Shear alone, Ca = 10, Δ = 0.7. The run is made with equal steps and with controlled ones. After the vesicle has reached
its inclination, only area, perimeter, node spacing and the high modes of the shape can drift.

What to expect: inclination, [μ] and tank-treading speed constant to 1e-6 from t = 20 on, nodes equispaced to 1e-6,
area and perimeter kept to 1e-8, and the centre at its place.
"""

import jax.numpy as jnp
import numpy as np

from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.physics.flow import Shear
from jaxves.physics.scene import make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.schemes import ARK4

from ._common import march, store
from ._schemes import Even

CHANGES = ("inclination", "viscosity", "speed", "center")
ERRORS = ("spacing", "area", "length", "tail")
QUICK = dict(t_end=0.5, saves=10, N=32, steps_per_unit=160, tolerances=(), reduced_area=0.9)


def measured(rows, equation, settled):
    """Returns the largest changes after `settled`, and the largest errors of conserved quantities at any time."""

    def spread(name):
        values = rows[name][rows["t"] >= settled]
        return float(np.max(np.ptp(values, axis=0))) if len(values) else np.nan

    rows = {key: row[~np.isnan(rows["t"])] for key, row in rows.items()}
    area = rows["area"] / np.asarray(equation.area) - 1
    length = rows["length"] / (2 * np.pi * np.asarray(equation.speed)) - 1
    return {
        "inclination": spread("inclination"),
        "viscosity": spread("effective_viscosity"),
        "speed": spread("tank_treading_speed"),
        "center": spread("center"),
        "spacing": float(np.max(rows["metric_error"])),
        "area": float(np.max(np.abs(area))),
        "length": float(np.max(np.abs(length))),
        "tail": float(np.max(rows["spectral_tail"])),
    }


def run(
    t_end=100.0, saves=200, settled=None, N=96, steps_per_unit=200, tolerances=(1e-5, 1e-7), reduced_area=0.7, Ca=10.0
):
    """Returns {method: {status, t, steps, turns, and the changes and errors of `measured`}}."""
    settled = 0.2 * t_end if settled is None else settled
    times = t_end * np.arange(1, saves + 1) / saves
    scene = make_scene(shapes.ellipse(N, reduced_area, angle=jnp.deg2rad(20.0)), flow=Shear(Ca))
    methods = {f"equal steps of {1 / steps_per_unit:g}": Even(round(steps_per_unit * t_end / saves), ARK4())}
    methods |= {f"tolerance {tolerance:g}": Adaptive(tolerance) for tolerance in tolerances}
    found = {}
    for name, method in methods.items():
        state, rows, equation = march(scene, method, times)
        speed = rows["tank_treading_speed"]
        found[name] = {
            "status": status.WORDS[max(int(state.status), status.COMPLETE)],
            "t": float(state.t),
            "steps": int(state.steps),
            "turns": float(np.abs(np.mean(speed)) * t_end / (2 * np.pi)),
        } | measured(rows, equation, settled)
    return found


def main():
    found = run()
    for name, row in found.items():
        print(f"{name}: {row['status']} at t = {row['t']:g} after {row['steps']} steps and {row['turns']:.0f} turns")
        for title, keys in (("changes once settled", CHANGES), ("largest errors", ERRORS)):
            print(f"   {title}: " + ", ".join(f"{key} {row[key]:.1e}" for key in keys))
    store("long_run", found)


if __name__ == "__main__":
    main()
