r"""Which statements of the paper change if charge takes time to reach the interfaces?

    python -m experiments.charge_in_the_paper      # a table, about eight minutes

In the paper the charge of the fluids follows at once, δ = ε_e/(a C_m) = 0. For water and C_m = 1 μF/cm² it is 7e-3 for
a = 10 μm and 0.07 for a = 1 μm. Four scenes of the paper are run with the three values:

| scene | numbers |
|---|---|
| POP | Δ = 0.9, β = 3.2, Λ = 0.1 |
| budding | Δ = 0.5, β = 12.8 |
| treading in shear and a field | Δ = 0.7, Λ = 0.1, G = 4, β = 6.4, Ca = 10 |
| pair | G = 0, Λ = 0.5 |

What to expect: with δ = 7e-3 most numbers change by a few per cent, and all classes stay. With 0.07 the vesicle hardly
buds, because its charge lags behind the field that was switched on, and the membrane treads fast: charge that lags
behind a turning membrane exerts a torque.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import jaxves
from jaxves.geometry import shapes
from jaxves.observables import classes
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

from . import _pairs
from ._common import pop, store
from .pop_and_budding import first_minimum

DELTAS = (0.0, 7e-3, 0.07)
AREAS, RATIOS = (0.7,), (0.5,)
QUICK = dict(deltas=(0.0, 0.07), nodes=32, budding=None, areas=(), ratios=(), ends=(0.1, 0.0, 0.0))


def with_delta(scene, delta):
    """Returns the scene with this δ; zero leaves charge relaxation out."""
    if delta == 0:
        return scene
    return eqx.tree_at(
        lambda s: s.field.charge_relaxation, scene, jnp.asarray(delta), is_leaf=lambda leaf: leaf is None
    )


def popping(scene, t_end, saves=100) -> dict:
    """Returns the class of a vesicle along the field, and when D passes through zero and has its minimum."""
    result = simulate(scene, t_end, saves=saves, march=Adaptive(1e-5, recorded=None))
    t, D = np.asarray(result.t), np.asarray(result.diagnostics[classes.DEFORMATION])[:, 0]
    crossings = np.flatnonzero(np.diff(np.sign(D)) != 0)
    times = [float(t[i] - D[i] * (t[i + 1] - t[i]) / (D[i + 1] - D[i])) for i in crossings]
    return {
        "class": jaxves.class_names(D)[0],
        "zeros": times,
        "least D": float(D.min()),
        "greatest V_m": float(np.max(result.diagnostics["max_V_m"])),
        "status": result.word,
    }


def neck(scene, window=(0.16, 0.36), every=4e-3) -> dict:
    """Returns the time and the width of the narrowest neck."""
    times = np.concatenate([[0.05, 0.1], np.arange(window[0], window[1], every)])
    result = simulate(scene, times=jnp.asarray(times), march=Adaptive(1e-4, recorded=None))
    t, width = np.asarray(result.t)[3:], np.asarray(result.diagnostics["self_gap"])[3:, 0]
    moment, least = first_minimum(t, width)
    return {"time": float(moment), "width": float(least), "status": result.word}


def treading(area, delta, nodes, t_end) -> dict:
    """Returns [μ], the inclination in degrees and the treading speed at the end of a run in shear and a field."""
    field = dc_field(6.4, conductivity_ratio=0.1, membrane_conductance=4.0)
    x = shapes.ellipse(nodes, area, angle=np.deg2rad(36.0))
    scene = with_delta(make_scene(x, field=field, flow=Shear(10.0)), delta)
    result = simulate(scene, t_end, saves=10, march=Adaptive(1e-5, recorded=None))
    found = {name: np.ravel(result.diagnostics[name][-2:]) for name in ("effective_viscosity", "tank_treading_speed")}
    return {name: float(value[-1]) for name, value in found.items()} | {
        "inclination": float(np.degrees(result.diagnostics["inclination"][-1, 0])),
        "change": float(np.ptp(found["effective_viscosity"])),
        "status": result.word,
    }


def pair(ratio, delta, nodes, t_end) -> dict:
    """Returns the class of a pair, the range of its line of centres in degrees, the gap and the treading speeds."""
    scene = with_delta(_pairs.scene(ratio, N=nodes), delta)
    found = _pairs.history(scene, t_end, 60, thinnest=0.02, turned=270.0)
    return {
        "class": _pairs.classified(found),
        "angle": [float(found["angle"].min()), float(found["angle"].max()), float(found["angle"][-1])],
        "gap": float(found["min_gap"][-1]),
        "speed": np.asarray(found["tank_treading_speed"][-1]),
        "t": float(found["t"][-1]),
        "status": found["word"],
    }


def run(deltas=DELTAS, nodes=64, budding=96, areas=AREAS, ratios=RATIOS, ends=(1.0, 2.0, 4.0)) -> dict:
    """Returns, by scene and δ, what the paper says something about; `ends` are those of POP, treading and pairs."""
    found = {"POP": {delta: popping(with_delta(pop(nodes), delta), ends[0]) for delta in deltas}}
    if budding is not None:
        found["budding"] = {
            delta: neck(with_delta(pop(budding, reduced_area=0.5, beta=12.8), delta)) for delta in deltas
        }
    for area in areas:
        found[f"treading, Δ = {area:g}"] = {delta: treading(area, delta, nodes, ends[1]) for delta in deltas}
    for ratio in ratios:
        found[f"pair, Λ = {ratio:g}"] = {delta: pair(ratio, delta, nodes, ends[2]) for delta in deltas}
    return found


def main():
    found = run()
    for scene, rows in found.items():
        print(scene)
        for delta, row in rows.items():
            print(f"   δ = {delta:g}:", ", ".join(f"{name} {value}" for name, value in row.items()))
    store("charge_in_the_paper", found)


if __name__ == "__main__":
    main()
