r"""Does a deflated vesicle with an insulating membrane turn by itself, and is a circulating pair two such rotors?

    python -m experiments.rotor       # table and figure, about five minutes

G = 0, Λ = 0.5, Δ = 0.9, without a flow. A circle turns by itself beyond β_Q = 1 (Quincke rotation). The prolate vesicle
along the field is a steady state at every β. `jaxves.stability` has the growth rate of its leading disturbance. Runs
start there with 1e-6 of this disturbance. The treading speed is zero by symmetry, and its growth is compared with the
rate. Then two vesicles from the start of the scene "circulation" are run below β_Q and above it.

What to expect: the measured growth equals the linear rate. Above a threshold between β = 0.8 and 1.6 the membrane ends
in steady treading around a shape that is tilted from the field. The pair circulates at β = 3.2, not at 0.8.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.analysis.stability import stability
from jaxves.base import status
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.physics.scene import dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

from . import _pairs
from ._common import save, shades, store, styled

STRENGTHS, PAIRS = (3.2, 2.4, 1.6, 0.8), (3.2, 0.8)
AREA, RATIO, CHI, SIZE = 0.9, 0.5, 0.08, 1e-6
FITTED = (30 * SIZE, 3000 * SIZE)  # speeds between which growth is exponential
QUICK = dict(strengths=(3.2,), pairs=(), longest=1.0)


@eqx.filter_jit
def _steady(beta, start):
    """The prolate steady state along the field near `start`, and its leading rates."""
    field = dc_field(beta, conductivity_ratio=RATIO, membrane_conductance=0.0, chi=CHI)
    scene = make_scene(shapes.ellipse(start.x.shape[1], AREA, angle=jnp.pi / 2), field=field)
    return scene, stability(scene, start, count=3)


@eqx.filter_jit
def _disturbed(scene, found, t_end, tolerance, saves):
    """Runs from the steady state with its leading disturbance."""
    y, h = found.steady.y, found.shapes[0].real
    size = SIZE / jnp.max(jnp.abs(found.shapes[0]) + jnp.abs(found.scalars["V_m"][0]))
    x = y.x + size * h[:, None] * Curve.from_nodes(y.x[0]).normal
    V_m = y.V_m + size * found.scalars["V_m"][:1].real
    scene = eqx.tree_at(lambda s: (s.x, s.V_m), scene, (x, V_m), is_leaf=lambda leaf: leaf is None)
    result = simulate(scene, t_end, saves=saves, march=Adaptive(tolerance))
    found = result.diagnostics
    return result.t, found["tank_treading_speed"][:, 0], found["inclination_unwrapped"][:, 0], result.status


def growth(t, values) -> float:
    """Returns the rate at which |values| grows exponentially, from the times at which it is small."""
    low, high = FITTED
    first = int(np.argmax(np.abs(values) > low))
    last = int(np.argmax(np.abs(values) > high))
    if last - first < 3:
        return np.nan
    return float(np.polyfit(t[first:last], np.log(np.abs(values[first:last])), 1)[0])


def charged(N=32) -> Unknowns:
    """Returns the ellipse along the field with about the charge of an insulating membrane."""
    x = shapes.ellipse(N, AREA, angle=jnp.pi / 2)[None]
    return Unknowns.of(x, 1.5 * x[..., 1])


def alone(beta, start, longest=24.0, tolerance=1e-5, saves=240) -> tuple[dict, Unknowns]:
    """Returns the linear rates, the growth of the treading speed in a run, and its history; and the steady state."""
    scene, found = _steady(jnp.asarray(beta), start)
    rate = float(found.rates[0].real)
    t_end = min(longest, 40 / rate) if rate > 0 else 0.25 * longest
    rows = _disturbed(scene, found, jnp.asarray(t_end), jnp.asarray(tolerance), saves)
    t, speed, angle, code = map(np.asarray, rows)
    row = {
        "rates": np.stack([found.rates.real, found.rates.imag], axis=1),
        "breaks": {name: float(share[0]) for name, share in found.breaks.items()},
        "growth": growth(t, speed),
        "status": status.WORDS[int(code)],
        "t": t,
        "speed": speed,
        "angle": np.degrees(angle),
    }
    return row, found.steady.y


def together(beta, N=32, duration=19.2, saves=60) -> dict:
    """Returns the angle of the line of centres of a pair, and the treading speeds."""
    found = _pairs.history(_pairs.scene(RATIO, N=N, beta=beta), duration / beta, saves)
    return {name: found[name] for name in ("word", "t", "angle", "min_gap", "tank_treading_speed")}


def run(strengths=STRENGTHS, pairs=PAIRS, longest=24.0) -> dict:
    """Returns histories of one vesicle and of two, by β. Each steady state is sought from the last one."""
    y, rows = charged(), {}
    for beta in strengths:
        rows[beta], y = alone(beta, y, longest)
    return {"alone": rows, "together": {beta: together(beta) for beta in pairs}}


@styled
def draw(found) -> Figure:
    """Draws speeds that grow with the linear rates, the angle later, and the angle of the line of centres of pairs."""
    figure = Figure(figsize=(run_plots.PAGE, 2.5))
    speeds, angles, lines = figure.subplots(1, 3)
    rows = found["alone"]
    for (beta, row), colour in zip(rows.items(), shades(len(rows)), strict=True):
        t, speed = np.array(row["t"]), np.abs(row["speed"])
        speeds.semilogy(t, speed, color=colour, label=rf"$\beta = {beta:g}$")
        angles.plot(t, row["angle"], color=colour)
        if np.isfinite(row["growth"]):
            first = int(np.argmax(speed > FITTED[0]))
            late = t[first:][t[first:] < t[first] + np.log(1e3) / row["rates"][0][0]]
            speeds.plot(late, speed[first] * np.exp(row["rates"][0][0] * (late - t[first])), "k:", lw=1)
    for beta, row in found["together"].items():
        lines.plot(row["t"], row["angle"], label=rf"$\beta = {beta:g}$")
    speeds.set(xlabel=r"$t$ ($t_\kappa$)", ylabel=r"treading speed ($a/t_\kappa$)", ylim=(1e-9, None))
    angles.set(xlabel=r"$t$ ($t_\kappa$)", ylabel="inclination (degrees)")
    lines.set(xlabel=r"$t$ ($t_\kappa$)", ylabel="line of centres (degrees)")
    speeds.legend()
    if found["together"]:
        lines.legend()
    return figure


def main():
    found = run()
    for beta, row in found["alone"].items():
        rate, later = row["rates"][0], np.abs(row["speed"][-60:])
        print(
            f"β {beta:g}  rate {rate[0]:.5f} {rate[1]:+.5f}i  measured {row['growth']:.5f}  {row['status']}  breaks "
            f"{row['breaks']}  later speed {later.min():.4f} to {later.max():.4f}, angle {row['angle'][-1]:.2f}"
        )
    for beta, row in found["together"].items():
        print(f"pair β {beta:g}: line of centres from {row['angle'][0]:.1f} to {row['angle'][-1]:.1f}, {row['word']}")
    store("rotor", found)
    save(draw(found), "rotor")


if __name__ == "__main__":
    main()
