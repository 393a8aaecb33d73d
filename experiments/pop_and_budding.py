"""Does a deflated vesicle turn from prolate to oblate and back, and when is the neck of a bud narrowest?

    python -m experiments.pop_and_budding          # table and five figures, about five minutes

The scenes are those of the POP transition and of budding in Wu & Veerapaneni: Λ = 0.1, G = 0, from an ellipse along
the field. Δ = 0.9, β = 3.2 becomes a square; Δ = 0.5, β = 12.8 buds. The narrowest neck is the first local minimum of
its width after the bud has formed. The paper gives t = 0.253, 0.216, 0.184 for β = 9.6, 12.8, 16.

What to expect: times within one per cent of the paper's for the two weaker fields, and 4 % earlier for β = 16. None of
them changes with nodes or tolerance. The neck is compressed (λ < 0) from about then on: before the minimum for β near
12.8, shortly after it for 9.6 and 16. Λ = 10 has no transition. Budding is shown up to t = 0.3: compressed necks
amplify round-off, and later shapes lose their mirror symmetry at a time that depends on the nodes.
"""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from jaxves import plots
from jaxves.base import status
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import curve as geometry
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.observables import classes as phases
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive

from ._common import march, pop, save, store, styled

PAPER = {9.6: 0.253, 12.8: 0.216, 16.0: 0.184}
WINDOWS = {9.6: (0.22, 0.28), 11.2: (0.21, 0.26), 12.0: (0.2, 0.26), 12.8: (0.19, 0.25)}
WINDOWS |= {13.6: (0.18, 0.235), 14.4: (0.17, 0.225), 16.0: (0.155, 0.205)}
QUICK = dict(cases=(), N=32, t_end=0.2, saves=10)
_AT_MINIMUM = ("tension_min", "spectral_tail", "tension_tail")
# β, nodes, tolerance; the coarser ones show what these are worth, and how the minimum moves with β
CASES = ((12.8, 192, 1e-5), (9.6, 192, 1e-5), (16.0, 256, 1e-5))
CASES += tuple((beta, 128, 1e-4) for beta in (11.2, 12.0, 12.8, 13.6, 14.4, 16.0))


def history(setting, times, tolerance=1e-4):
    """Returns the rows of a run at `times`, the numbers of steps, and the status."""
    state, rows, _ = march(setting, Adaptive(tolerance), times)
    rows = {name: row[~np.isnan(rows["t"])] for name, row in rows.items()}
    word = status.WORDS[max(int(state.status), status.COMPLETE)]
    return rows | {"steps": int(state.steps), "rejected": int(state.rejected), "status": word}


@jax.jit
def _refined(x, tension, alpha):
    """Newton's method for the shortest chord near the parameters `alpha` (2,): ends (2, 2), tension there (2,)."""
    dx = fourier.derivative(x, axis=0)
    curve = jnp.concatenate([x, dx, fourier.derivative(dx, axis=0)], axis=1)

    def newton(alpha, _):
        (p, dp, ddp), (q, dq, ddq) = fourier.evaluate(curve, alpha).reshape(2, 3, 2)
        chord = p - q
        slope = jnp.stack([chord @ dp, -chord @ dq])
        across = -dp @ dq
        hessian = jnp.stack([jnp.stack([dp @ dp + chord @ ddp, across]), jnp.stack([across, dq @ dq - chord @ ddq])])
        return alpha - jnp.linalg.solve(hessian, slope), None

    alpha, _ = jax.lax.scan(newton, alpha, length=8)
    return fourier.evaluate(x, alpha), fourier.evaluate(tension, alpha)


def narrowest_chord(x, tension):
    """(width, mean tension at both ends, their mean place) of the chord that `extremes.self_gap` seeks.

    Where that takes the nearest nodes, which makes a flat minimum in time ragged, this goes on between them.
    """
    fine = np.asarray(fourier.resample(jnp.asarray(x), 2 * len(x), axis=0))
    K = len(fine)
    chord = np.linalg.norm(fine[:, None] - fine[None], axis=-1)
    steps = np.abs(np.arange(K)[:, None] - np.arange(K)[None])
    along = np.minimum(steps, K - steps) * float(geometry.length(Curve.from_nodes(jnp.asarray(fine)))) / K
    chord = np.where((along >= 2 * chord) & (steps > 0), chord, np.inf)
    nearest = np.array(np.unravel_index(np.argmin(chord), chord.shape))
    ends, tension = _refined(jnp.asarray(x), jnp.asarray(tension), 2 * np.pi * nearest / K)
    return float(np.linalg.norm(ends[0] - ends[1])), float(np.mean(tension)), np.mean(ends, axis=0)


def first_minimum(t, width):
    """(time, width) of the first interior local minimum, by the parabola through three saves; NaN if there is none."""
    inside = np.flatnonzero((width[1:-1] < width[:-2]) & (width[1:-1] <= width[2:])) + 1
    if not len(inside):
        return np.nan, np.nan
    i = inside[0]
    a, b, c = np.polyfit(t[i - 1 : i + 2] - t[i], width[i - 1 : i + 2], 2)
    return t[i] - b / (2 * a), c - b**2 / (4 * a)


def budding(beta, N, tolerance, window, every=1e-3, after=()):
    """Returns the neck of the vesicle with Δ = 0.5 in `window`, saved densely there, and the rows of the run."""
    before = np.arange(0.01, window[0] - 1e-9, 0.01)
    dense = np.arange(round(window[0] / every), round(window[1] / every) + 1) * every
    rows = history(pop(N, reduced_area=0.5, beta=beta), np.concatenate([before, dense, after]), tolerance)
    seen = (rows["t"] >= window[0] - 1e-9) & (rows["t"] <= window[1] + 1e-9)
    t = rows["t"][seen]
    membrane = zip(rows["x"][seen, 0], rows["tension"][seen, 0], strict=True)
    chords = [narrowest_chord(x, tension) for x, tension in membrane]
    width, tension = np.array([c[0] for c in chords]), np.array([c[1] for c in chords])
    time, least = first_minimum(t, width)
    at_minimum = {name: np.interp(time, rows["t"], rows[name][:, 0]) for name in _AT_MINIMUM}
    found = {"beta": beta, "N": N, "tolerance": tolerance, "t": t, "width": width, "neck_tension": tension}
    found |= {
        "time": time,
        "narrowest": least,
        "tension": np.interp(time, t, tension),
        "paper": PAPER.get(beta, np.nan),
    }
    found |= at_minimum | {name: rows[name] for name in ("steps", "rejected", "status")}
    return found, rows


def run(cases=CASES, windows=WINDOWS, N=64, t_end=1.0, saves=50, after=(0.275, 0.3)):
    """Returns histories of the POP run, of Λ = 10 and of the first budding case, and the necks of all cases."""
    times = t_end * np.arange(1, saves + 1) / saves
    found = {"POP": history(pop(N), times), "Λ = 10": history(pop(N, conductivity_ratio=10.0), times), "necks": []}
    for beta, nodes, tolerance in cases:
        first = not found["necks"]
        neck, rows = budding(beta, nodes, tolerance, windows[beta], after=after if first else ())
        found["necks"].append(neck)
        if first:
            found["budding"] = rows
    return found


def classes(found) -> dict[str, str]:
    """Returns the class of each of the two runs at Δ = 0.9, by `jaxves.class_names`."""
    deformation = {name: found[name]["deformation_along_field"][:, 0] for name in ("POP", "Λ = 10")}
    return {name: phases.class_names(D)[0] for name, D in deformation.items()}


@styled
def draw_necks(necks) -> Figure:
    """Draws the width of the neck and its tension against time; cases with at most 128 nodes are grey."""
    figure = Figure(figsize=(run_plots.PAGE, 2.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    colors = {beta: f"C{i}" for i, beta in enumerate(sorted(PAPER))}
    others = sorted({neck["beta"] for neck in necks if neck["N"] <= 128 and neck["beta"] not in PAPER})
    for neck in sorted(necks, key=lambda neck: neck["beta"]):
        coarse = neck["N"] <= 128
        color = "0.7" if coarse else colors[neck["beta"]]
        style = dict(color=color, lw=0.7 if coarse else 1.2, zorder=1 if coarse else 2)
        left.plot(neck["t"], neck["width"], label=None if coarse else rf"$\beta = {neck['beta']:g}$", **style)
        right.plot(neck["t"], neck["neck_tension"], **style)
        if not coarse:
            left.plot(neck["time"], neck["narrowest"], "o", color=color, ms=4)
            left.axvline(neck["paper"], color=color, ls="--", lw=0.7, zorder=0)
            right.plot(neck["time"], neck["tension"], "o", color=color, ms=4)
    left.plot(
        [], [], color="0.7", lw=0.7, label=rf"$\beta = {', '.join(f'{beta:g}' for beta in others)}$, $N \leq 128$"
    )
    left.plot([], [], "o", color="0.4", ms=4, label="narrowest")
    left.plot([], [], color="0.4", ls="--", lw=0.7, label="narrowest in the paper")
    left.set(xlabel=r"$t/t_\kappa$", ylabel="width of the neck / $a$", ylim=(0, None))
    right.axhline(0, color="0.6", lw=0.6)
    right.set(xlabel=r"$t/t_\kappa$", ylabel=r"tension $\lambda$ in the neck ($\kappa_B/a^2$)")
    for ax in (left, right):
        ax.xaxis.set_major_locator(MultipleLocator(0.05))
    figure.legend(loc="outside upper center", ncols=6, fontsize="small")
    return figure


def _record(rows, setting):
    """Returns a record for `plots.snapshots`, with the uncharged start before the saved rows."""
    x = np.asarray(setting.x)[None]
    first = {"t": np.zeros(1), "x": x, "V_m": np.zeros(x.shape[:3]), "tension": np.full(x.shape[:3], np.nan)}
    return SimpleNamespace(**{name: np.concatenate([value, rows[name]]) for name, value in first.items()})


def main():
    found = run()
    for name, word in classes(found).items():
        rows = found[name]
        D = rows["deformation_along_field"][:, 0]
        print(f"{name}: {word}, {rows['status']}, D from {D[0]:.3f} through {D.min():.3f} to {D[-1]:.3f}")
    print("   β    N  tolerance  time     paper  off by  narrowest  λ in neck  least λ  tails         steps")
    for neck in found["necks"]:
        off = neck["time"] / neck["paper"] - 1
        print(
            f"{neck['beta']:5.1f}  {neck['N']}  {neck['tolerance']:.0e}      {neck['time']:.5f}  {neck['paper']:.3f}  "
            f"{off:+6.1%}  {neck['narrowest']:.5f}    {neck['tension']:8.1f}  {neck['tension_min']:8.1f}  "
            f"{neck['spectral_tail']:.0e} {neck['tension_tail']:.0e}  "
            f"{neck['steps']}+{neck['rejected']}  {neck['status']}"
        )
    deformation = {name: found[name]["deformation_along_field"][:, 0] for name in ("POP", "Λ = 10")}
    store("pop_and_budding", {"classes": classes(found), "deformation": deformation, "necks": found["necks"]})

    neck, rows = found["necks"][0], found["budding"]
    save(run_plots.snapshots(_record(found["POP"], pop(64)), [0, 0.1, 0.2, 0.3, 0.5, 1.0]), "pop_snapshots")
    setting = pop(neck["N"], reduced_area=0.5, beta=neck["beta"])
    save(run_plots.snapshots(_record(rows, setting), [0, 0.05, 0.1, 0.15, neck["time"], 0.3]), "budding_snapshots")
    save(draw_necks(found["necks"]), "budding_necks")

    row = int(np.argmin(np.abs(rows["t"] - neck["time"])))
    y = Unknowns.of(jnp.asarray(rows["x"][row]), jnp.asarray(rows["V_m"][row]))
    equation = equation_for(setting)
    save(plots.streamlines(equation, rows["t"][row], y), "budding_streamlines")
    save(plots.field_lines(equation, rows["t"][row], y), "budding_field_lines")


if __name__ == "__main__":
    main()
