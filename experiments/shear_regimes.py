"""Which motions does a vesicle with an insulating membrane (G = 0) have in shear and a field, and is one chaotic?

    python -m experiments.shear_regimes          # tables, two figures, about ten minutes

The paper names tumbling, staggering (treading with a periodic inclination), mirrored treading (in the opposite
direction and inclined against the shear) and chaotic staggering, without numbers. Here is one of each, found by
scanning (β, Λ, Δ, Ca) from an ellipse at 45°, and a map at Δ = 0.8.

The cause of all four: at G = 0 the charged membrane rotates by itself above β = 1 (see `quasi_circular`). With the
shear it treads faster. If it started in the opposite direction, it treads against the shear. If the membrane treads
faster than the shape can follow, the shape tumbles. If charging is slower than treading, the two alternate.

What to expect: periods, angles and speeds that do not change with nodes and tolerance. In the chaotic case each
maximum of the inclination determines the next by a one-dimensional map, which is the same for both numbers of nodes.
Neighbouring starts separate exponentially. The rate, the largest Lyapunov exponent, is positive by several of its
errors for both.
"""

import itertools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.base import status
from jaxves.equation.equation import Equation, equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.observables.checks import Checks
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.loop import initial_state
from jaxves.stepping.marching import simulate
from jaxves.stepping.record import advance

from ._common import save, store, styled


class Numbers(NamedTuple):
    """β, Λ, Δ, Ca, and the inclination at the start in degrees."""

    beta: float
    ratio: float
    area: float
    shear: float
    start: float = 45.0


REGIMES = {
    "tumbling": Numbers(3.2, 3.0, 0.8, 5.0),
    "staggering": Numbers(12.8, 0.3, 0.9, 10.0),
    "mirrored treading": Numbers(6.4, 0.5, 0.9, 5.0),
    "chaotic staggering": Numbers(12.8, 0.5, 0.7, 5.0),
}
MAPS = (  # (β, Λ, Ca) and how long; the larger Λ need less
    {"betas": (6.4, 9.6, 12.8), "ratios": (0.2, 0.3, 0.5, 0.8), "shears": (2.0, 5.0, 10.0), "t_end": 16.0},
    {"betas": (3.2, 6.4, 12.8), "ratios": (1.0, 1.5, 3.0, 10.0), "shears": (5.0, 20.0, 60.0), "t_end": 6.0},
)
QUICK = dict(
    regimes=("mirrored treading",), cases=((32, 1e-3),), t_end=4.0, saves=80, chaos=((32, 10),), intervals=4, maps=()
)
_COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"]
KINDS = ("treading", "mirrored treading", "staggering", "mirrored staggering", "reversing", "tumbling", "stopped")


def scene(n: Numbers, N: int) -> Scene:
    """Returns the vesicle at the start, uncharged."""
    x = shapes.ellipse(N, n.area, angle=jnp.deg2rad(n.start))
    return make_scene(x, field=dc_field(n.beta, conductivity_ratio=n.ratio), flow=Shear(n.shear))


@eqx.filter_jit
def _simulated(numbers, N, tolerance, t_end, saves):
    march = Adaptive(tolerance, max_steps=20_000)
    result = simulate(scene(Numbers(*numbers), N), t_end, saves=saves, march=march)
    d = result.diagnostics
    kept = {"t": result.t, "inclination": d["inclination_unwrapped"][:, 0], "speed": d["tank_treading_speed"][:, 0]}
    kept |= {"viscosity": d["effective_viscosity"], "tail": d["spectral_tail"][:, 0]}
    return kept, result.x[:, 0], result.status


def history(n: Numbers, N=64, tolerance=1e-4, t_end=24.0, saves=800) -> dict:
    """Returns inclination (degrees, unwrapped), treading speed and [μ] against time."""
    rows, x, code = _simulated(tuple(map(jnp.asarray, n)), N, jnp.asarray(tolerance), jnp.asarray(t_end), saves)
    known = ~np.isnan(rows["t"])
    out = {name: np.asarray(row)[known] for name, row in rows.items()}
    out["inclination"] = np.rad2deg(out["inclination"])
    return out | {"x": np.asarray(x)[known], "status": status.WORDS[max(int(code), status.COMPLETE)]}


def maxima(t, values):
    """Returns times and heights of the local maxima, by parabolas through three saves."""
    inside = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] >= values[2:])) + 1
    fits = [(i, np.polyfit(t[i - 1 : i + 2] - t[i], values[i - 1 : i + 2], 2)) for i in inside]
    times = [t[i] - b / (2 * a) for i, (a, b, _) in fits]
    return np.array(times), np.array([c - b**2 / (4 * a) for _, (a, b, c) in fits])


def measured(rows, after=0.5) -> dict[str, float]:
    """Returns numbers of the motion after the fraction `after` of the run."""
    late = rows["t"] > after * rows["t"][-1]
    t, angle, speed = (rows[name][late] for name in ("t", "inclination", "speed"))
    times, heights = maxima(t, angle)
    turned = angle[-1] - angle[0]
    rate = np.polyfit(t, angle, 1)[0]
    found = {"least": angle.min(), "greatest": angle.max(), "turned": turned, "speed": speed.mean()}
    found |= {
        "speed least": speed.min(),
        "speed greatest": speed.max(),
        "half turn": 180 / abs(rate) if abs(turned) > 180 else np.nan,
    }
    found |= {"viscosity": np.trapezoid(rows["viscosity"][late], t) / (t[-1] - t[0]), "tail": rows["tail"].max()}
    return found | {
        "period": np.mean(np.diff(times)) if len(times) > 1 else np.nan,
        "spread of maxima": np.ptp(heights) if len(heights) > 1 else np.nan,
    }


def kind(rows, ripple=2.0) -> str:
    """Returns one of `KINDS`, from the last third of a run: 180° make a tumble, `ripple`° a stagger."""
    if rows["status"] != "complete":
        return "stopped"
    m = measured(rows, 2 / 3)
    if abs(m["turned"]) > 180:
        return "tumbling"
    if m["greatest"] - m["least"] < ripple:
        return "treading" if m["speed"] < 0 else "mirrored treading"
    if m["speed least"] < 0 < m["speed greatest"]:
        return "reversing"
    return "staggering" if m["speed"] < 0 else "mirrored staggering"


def scanned(betas, ratios, shears, t_end, area=0.8, N=48, tolerance=1e-3, saves=400) -> list[tuple]:
    """Returns (β, Λ, Ca, kind) of every case."""
    cases = itertools.product(betas, ratios, shears)
    return [
        (*case, kind(history(Numbers(case[0], case[1], area, case[2]), N, tolerance, t_end, saves))) for case in cases
    ]


def _norm(y: Unknowns):
    return jnp.sqrt(jnp.mean(jnp.sum(y.x**2, axis=-1)) + jnp.mean(y.V_m**2))


@eqx.filter_jit
def _stretches(equation: Equation, march: Fixed, state, tangent: Unknowns, interval, count: int):
    """Logarithms of the growth of a small disturbance over `count` intervals; it starts each at length 1."""
    stops = jnp.zeros(1)
    checks = Checks(tail=np.inf, drift=np.inf)

    def once(carry, _):
        state, tangent = carry

        def moved(y):
            at = eqx.tree_at(lambda s: s.y, state, y)
            after, rows = advance(equation, march, at, at.t[None] + interval, stops, checks)
            return after.y, (after, rows.diagnostics["inclination"][0, 0])

        _, grown, (after, angle) = jax.jvp(moved, (state.y,), (tangent,), has_aux=True)
        length = _norm(grown)
        tangent = jax.tree.map(lambda leaf: leaf / length, grown)
        return (after, tangent), (jnp.log(length), angle)

    (state, tangent), found = jax.lax.scan(once, (state, tangent), length=count)
    return state, tangent, found


def lyapunov(n: Numbers, N=48, steps=20, interval=0.1, intervals=240, together=20, skipped=0.25) -> dict:
    """Returns the largest Lyapunov exponent and its error, by tangents of the discrete flow.

    Steps of a fixed size are used, so that no tolerance enters. The first quarter, in which the disturbance finds its
    direction, is left out. The error is that of the mean of ten consecutive intervals.
    """
    equation = eqx.filter_jit(equation_for)(scene(n, N))
    march = Fixed(steps)
    state = eqx.filter_jit(initial_state)(equation, march)
    key = jax.random.PRNGKey(0)
    tangent = equation.filtered(Unknowns.of(jnp.zeros_like(state.y.x), jax.random.normal(key, state.y.V_m.shape)))
    logs = []
    for _ in range(0, intervals, together):
        count = min(together, intervals)
        state, tangent, (found, _) = _stretches(equation, march, state, tangent, jnp.asarray(interval), count)
        logs.extend(np.asarray(found))
        if int(state.status) != status.RUNNING:
            break
    counted = np.array(logs[int(skipped * len(logs)) :]) / interval
    means = [part.mean() for part in np.array_split(counted, min(10, len(counted)))]
    return {
        "exponent": float(np.mean(counted)),
        "error": float(np.std(means, ddof=1) / np.sqrt(len(means))),
        "t": interval * np.arange(1, len(logs) + 1),
        "growth": np.cumsum(logs),
        "status": status.WORDS[max(int(state.status), status.COMPLETE)],
    }


def run(
    regimes=tuple(REGIMES),
    cases=((48, 1e-4), (64, 1e-5)),
    t_end=24.0,
    saves=800,
    chaos=((48, 20), (64, 20)),
    intervals=240,
    maps=MAPS,
):
    """Histories by regime and (nodes, tolerance); Lyapunov exponents by (nodes, steps in 0.1 t_κ); the map."""
    found = {"regimes": {}, "lyapunov": {}}
    for name in regimes:
        rows = {f"N = {N}, tolerance {tol:.0e}": history(REGIMES[name], N, tol, t_end, saves) for N, tol in cases}
        found["regimes"][name] = {"history": rows, "measured": {case: measured(row) for case, row in rows.items()}}
    for N, steps in chaos:
        label = f"N = {N}, step {0.1 / steps:.2g}"
        found["lyapunov"][label] = lyapunov(REGIMES["chaotic staggering"], N, steps, intervals=intervals)
    found["map"] = [case for grid in maps for case in scanned(**grid)]
    return found


@styled
def draw(found) -> Figure:
    """Draws inclination against time and, for the chaotic case, the return map and the growth of a disturbance."""
    figure = Figure(figsize=(run_plots.PAGE, 3.6))
    panels = figure.subplots(2, 3)
    places = dict(zip(REGIMES, (panels[0, 0], panels[0, 1], panels[0, 2], panels[1, 0]), strict=True))
    for name, case in found["regimes"].items():
        axes, rows = places[name], list(case["history"].values())[-1]
        shown = rows["t"] <= (12.0 if name.startswith("chaotic") else 6.0)
        axes.plot(rows["t"][shown], rows["inclination"][shown])
        n = REGIMES[name]
        label = rf"$\beta={n.beta:g},\,\Lambda={n.ratio:g},\,\Delta={n.area:g},\,Ca={n.shear:g}$"
        axes.set(title=f"{name}\n{label}", xlabel=r"$t/t_\kappa$", ylabel="inclination (°)")
        if name.startswith("chaotic"):
            for mark, (label, run) in zip("os", case["history"].items(), strict=False):
                _, heights = maxima(run["t"], run["inclination"])
                panels[1, 1].plot(heights[3:-1], heights[4:], mark, ms=3, mfc="none", label=label.partition(",")[0])
            panels[1, 1].legend()
            ends = np.array([heights[3:].min(), heights[3:].max()])
            panels[1, 1].plot(ends, ends, color="0.6", lw=0.8)
    panels[1, 1].set(title="return map", xlabel="maximum (°)", ylabel="next maximum (°)")
    for label, case in found["lyapunov"].items():
        panels[1, 2].plot(case["t"], case["growth"], label=f"{label}: {case['exponent']:.2f} ± {case['error']:.2f}")
    panels[1, 2].set(
        ylim=(-12, None), title="growth of a disturbance", xlabel=r"$t/t_\kappa$", ylabel="log of its length"
    )
    panels[1, 2].legend(fontsize=5.5, loc="lower center")
    return figure


_MARKS = dict(zip(KINDS, zip("o^sD*Px", [*_COLOURS, "0.5"], strict=True), strict=True))


@styled
def draw_map(found) -> Figure:
    """Draws kinds of motion over (Λ, Ca), one panel for each β."""
    betas = sorted({case[0] for case in found["map"]})
    figure = Figure(figsize=(run_plots.PAGE, 2.3))
    panels = figure.subplots(1, len(betas), sharey=True, squeeze=False)[0]
    for axes, beta in zip(panels, betas, strict=True):
        for name, (mark, colour) in _MARKS.items():
            at = [case[1:3] for case in found["map"] if (case[0], case[3]) == (beta, name)]
            axes.plot(*np.reshape(at, (-1, 2)).T, mark, color=colour, ms=5, label=name)
        axes.set(
            xscale="log",
            yscale="log",
            title=rf"$\beta = {beta:g}$",
            xlabel=r"conductivity ratio $\Lambda$",
            xlim=(0.15, 14),
            ylim=(1.5, 80),
        )
        axes.set_yticks([2, 5, 10, 20, 60], ["2", "5", "10", "20", "60"])
        axes.set_xticks([0.2, 0.5, 1, 3, 10], ["0.2", "0.5", "1", "3", "10"])
        axes.minorticks_off()
    panels[0].set(ylabel=r"shear rate $Ca$, $\Delta = 0.8$")
    there = {case[3] for case in found["map"]}
    shown = [handle for handle in panels[0].get_lines() if handle.get_label() in there]
    figure.legend(handles=shown, loc="outside lower center", ncols=len(shown))
    return figure


def main():
    found = run()
    for name, case in found["regimes"].items():
        print(f"{name}: β, Λ, Δ, Ca, start = {tuple(REGIMES[name])}")
        for label, m in case["measured"].items():
            print(
                f"  {label}: θ in [{m['least']:.3f}, {m['greatest']:.3f}]°, period {m['period']:.4f}, maxima within "
                f"{m['spread of maxima']:.2g}°, half turn in {m['half turn']:.4f}, speed {m['speed']:.3f} in "
                f"[{m['speed least']:.2f}, {m['speed greatest']:.2f}], [μ] {m['viscosity']:.3f}, tail {m['tail']:.0e}, "
                f"{case['history'][label]['status']}"
            )
    for label, case in found["lyapunov"].items():
        print(f"largest exponent, {label}: {case['exponent']:.2f} ± {case['error']:.2f} per t_κ ({case['status']})")
    for *numbers, name in found["map"]:
        print("β = {:g}, Λ = {:g}, Ca = {:g}:".format(*numbers), name)
    save(draw(found), "shear_regimes")
    save(draw_map(found), "shear_regimes_map")
    kept = {name: case["measured"] for name, case in found["regimes"].items()}
    tops = {}
    for name, case in found["regimes"].items():
        rows = list(case["history"].values())[-1]
        tops[name] = maxima(rows["t"], rows["inclination"])[1]
    exponents = {label: {"exponent": c["exponent"], "error": c["error"]} for label, c in found["lyapunov"].items()}
    store("shear_regimes", {"regimes": kept, "maxima": tops, "lyapunov": exponents, "map": found["map"]})


if __name__ == "__main__":
    main()
