r"""Do time steps keep their order when charge relaxes fast, and what do charge and AC fields cost?

    python -m experiments.charge_steps      # tables and figure, about nine minutes

One vesicle, Δ = 0.9, β = 6.4, Λ = 0.3, χ = 0.08, tilted by 60 degrees. Runs to t = 0.04 with equal steps of ARK4 and 64
nodes are compared with one of 512 steps, at δ = 1e-1 … 1e-5. One start is uncharged, so that charge relaxes at once
within the first step. The other has the charge of V_m = 0 in equilibrium. Then steps are timed with charge relaxation,
without it, and with an averaged AC field. Last, adaptive runs to t = 2 in an AC field are made, averaged and resolved,
at ω = 1e3 and 1e4 with several tolerances. Their errors are those against a resolved run with tolerance 1e-6. At ω =
1e4 the resolved runs end at t = 0.2, and their steps are multiplied by ten. Seconds are those of the attempted steps,
whose cost is measured with averaged runs and stretches of resolved ones that take turns.

What to expect: order 4 for slowly relaxing charge and for charge in equilibrium. Where the first steps do not resolve
the relaxation of an uncharged start, its error remains.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxves
from jaxves.equation.equation import equation_for
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed

from ._common import interleaved, medians, save, shades, store, styled

CHI = 0.08
DELTAS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
STARTS = ("uncharged", "in equilibrium")
COUNTS, EXACT = (8, 16, 32, 64, 128), 512
TOLERANCES = dict(averaged=(1e-3, 1e-4), resolved=(1e-2, 1e-3, 1e-4), exact=1e-6)
FIELDS = (
    dict(omega=1e3, t_end=2.0, until=2.0, stretch=0.1) | TOLERANCES,
    dict(omega=1e4, t_end=2.0, until=0.2, stretch=0.01) | TOLERANCES,
)
TOY = dict(omega=200.0, t_end=0.02, until=0.01, stretch=0.01, averaged=(1e-2,), resolved=(1e-2,), exact=1e-3)
QUICK = dict(deltas=(1e-2,), counts=(2, 4), exact=8, nodes=16, timed=(16,), repeats=1, fields=(TOY,))


def scene(nodes, *, delta=None, history=None, V_m=None) -> jaxves.Scene:
    """Returns the scene, with another model of charge."""
    field = jaxves.dc_field(6.4, conductivity_ratio=0.3, chi=CHI, charge_relaxation=delta, history=history)
    found = jaxves.make_scene(jaxves.ellipse(nodes, 0.9, angle=np.deg2rad(60.0)), field=field)
    return eqx.tree_at(lambda s: s.V_m, found, V_m, is_leaf=lambda leaf: leaf is None)


@eqx.filter_jit
def _end(delta, count, nodes: int, relaxed: bool, t_end=0.04):
    """The nodes and the potential W after `count` equal steps."""
    given = scene(nodes, delta=delta, V_m=jnp.zeros((1, nodes)) if relaxed else None)
    equation, march, h = equation_for(given), Fixed(1), t_end / count
    y = jax.lax.fori_loop(0, count, lambda i, y: march.step(equation, i * h, y, (i + 1) * h), equation.start())
    return y.x, y.scalars["W"]


def orders(deltas, counts, exact, nodes) -> dict:
    """Returns the largest errors of nodes and W by start and δ, in the order of `counts`."""
    found = {}
    for start in STARTS:
        rows = {}
        for delta in deltas:

            def end(count, delta=delta, start=start):
                return _end(jnp.asarray(delta), jnp.asarray(count), nodes, start != STARTS[0])

            right = end(exact)
            rows[delta] = [
                float(max(jnp.max(jnp.abs(a - b)) for a, b in zip(end(count), right, strict=True))) for count in counts
            ]
        found[start] = rows
    return found


def slopes(errors, counts) -> list[float]:
    """Returns the observed orders between neighbouring numbers of steps."""
    return list(-np.diff(np.log(errors)) / np.diff(np.log(counts)))


def costs(timed, repeats) -> dict:
    """Returns the medians of the seconds of one step by number of nodes and model of charge."""
    found = {}
    for nodes in timed:
        kinds = {
            "without": scene(nodes),
            "relaxing": scene(nodes, delta=7e-3),
            "averaged": scene(nodes, history=jaxves.AC(100.0, averaged=True)),
            "averaged and relaxing": scene(nodes, delta=7e-3, history=jaxves.AC(100.0, averaged=True)),
        }
        calls = {}
        for name, given in kinds.items():
            equation, march = equation_for(given), Fixed(1)
            y = equation.start()
            step = eqx.filter_jit(lambda equation, y, march=march: march.step(equation, jnp.asarray(0.0), y, 1e-3))
            calls[name] = lambda step=step, equation=equation, y=y: step(equation, y).x
        found[nodes] = medians(interleaved(calls, repeats))
    return found


def beside(omega, nodes, t_end, until, stretch, averaged, resolved, exact, repeats) -> dict:
    """Returns steps, seconds and errors of averaged and resolved runs in an AC field by tolerance.

    The errors are the largest distances of nodes at the time `until` from a resolved run with the tolerance `exact`.
    "stated" is the estimate for all steps by the run itself. "pace" has the seconds of one attempted step: a whole
    averaged run and a resolved one to the time `stretch` take turns. The seconds of a run are its attempts at this
    pace. Resolved runs end at `until`, and their attempts are scaled to `t_end`. `ratios` has, for each averaged run,
    how many times as long the cheapest resolved run takes whose error is not larger, or None if there is no such run.
    """

    def ran(kind, tolerance, end):
        history = jaxves.AC(omega / (2 * np.pi), averaged=kind == "averaged")
        march = Adaptive(tolerance, recorded=None)
        return jaxves.simulate(scene(nodes, delta=7e-3, history=history), end, saves=1, march=march)

    def attempts(result) -> int:
        return int(result.state.steps + result.state.rejected)

    timed = {"averaged": (averaged[-1], t_end), "resolved": (averaged[-1], stretch)}
    calls = {kind: lambda kind=kind, how=how: ran(kind, *how).x for kind, how in timed.items()}
    seconds = medians(interleaved(calls, repeats))
    pace = {kind: seconds[kind] / attempts(ran(kind, *how)) for kind, how in timed.items()}
    reference = ran("resolved", exact, until)
    found = {
        "omega": omega,
        "t_end": t_end,
        "until": until,
        "reference steps": int(reference.state.steps),
        "pace": pace,
    }
    for kind, tolerances in (("averaged", averaged), ("resolved", resolved)):
        rows = []
        for tolerance in tolerances:
            result = ran(kind, tolerance, until)
            error = float(jnp.max(jnp.linalg.norm(result.x[-1] - reference.x[-1], axis=-1)))
            row = {"tolerance": tolerance, "error": error, "status": result.word}
            row["stated"] = float(result.state.time_error)
            if until < t_end and kind == "averaged":
                result = ran(kind, tolerance, t_end)
            scale = t_end / until if kind == "resolved" else 1.0
            row |= {"steps": scale * int(result.state.steps), "seconds": scale * attempts(result) * pace[kind]}
            rows.append(row)
        found[kind] = rows
    return found | {"ratios": ratios(found)}


def ratios(found) -> list[float | None]:
    """Returns the seconds of the cheapest resolved run with at most the error of an averaged one, over its seconds."""
    out = []
    for row in found["averaged"]:
        as_good = [other["seconds"] for other in found["resolved"] if other["error"] <= row["error"]]
        out.append(min(as_good) / row["seconds"] if as_good else None)
    return out


def run(deltas=DELTAS, counts=COUNTS, exact=EXACT, nodes=64, timed=(64,), repeats=9, fields=FIELDS) -> dict:
    """Returns errors by start and δ with their slopes, seconds of steps, and runs in an AC field."""
    errors = orders(deltas, counts, exact, nodes)
    return {
        "counts": counts,
        "errors": errors,
        "orders": {
            start: {delta: slopes(row, counts) for delta, row in rows.items()} for start, rows in errors.items()
        },
        "seconds": costs(timed, repeats),
        "AC": [beside(nodes=nodes, repeats=repeats, **field) for field in fields],
    }


@styled
def draw(found) -> Figure:
    """Draws the errors against the number of steps."""
    figure = Figure(figsize=(run_plots.PAGE, 2.6))
    axes = figure.subplots(1, len(STARTS), sharey=True)
    counts = np.array(found["counts"], dtype=float)
    for ax, (start, rows) in zip(axes, found["errors"].items(), strict=True):
        for (delta, errors), colour in zip(rows.items(), shades(len(rows)), strict=True):
            ax.loglog(counts, errors, ".-", color=colour, label=rf"$\delta = {delta:g}$")
        least = min(row[0] for row in rows.values())
        ax.loglog(counts, least * (counts / counts[0]) ** -4.0, "k:", lw=1, label="order 4")
        ax.set(title=start, xlabel="steps")
    axes[0].set_ylabel("largest error")
    axes[0].legend()
    return figure


def main():
    found = run()
    for start, rows in found["errors"].items():
        for delta, errors in rows.items():
            told = " ".join(f"{slope:5.2f}" for slope in found["orders"][start][delta])
            print(f"{start:15} δ {delta:g}: errors {' '.join(f'{e:.1e}' for e in errors)}  orders {told}")
    for nodes, row in found["seconds"].items():
        print(nodes, "nodes:", ", ".join(f"{name} {1e3 * of:.2f} ms" for name, of in row.items()))
    for field in found["AC"]:
        print(f"ω = {field['omega']:g}, seconds of resolved over averaged runs with the same error:", field["ratios"])
        for kind in ("averaged", "resolved"):
            for row in field[kind]:
                cost = f"{row['steps']:.0f} steps, {row['seconds']:.2f} s"
                told = f"error {row['error']:.1e}, stated {row['stated']:.1e}, {row['status']}"
                print(f"  {kind} {row['tolerance']:g}: {cost}, {told}")
    store("charge_steps", found)
    save(draw(found), "charge_steps")


if __name__ == "__main__":
    main()
