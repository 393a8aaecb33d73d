"""When do the nodes no longer resolve the film between two membranes?

    python -m experiments.film          # two minutes: table, figures/film.png, data/film.json

Shapes and potentials of a draining chain (Λ = 0.1, G = 0) are saved with 64 nodes while the gap decreases. Each is
interpolated to 48 to 256 nodes, and the rate of change of the gap is compared with that for 256.

What to expect: the error follows τ/(2d)², from 1e-8 up to errors of the size of the rate itself. τ is the top of the
spectrum of the tension divided by its largest mode, and d is the gap. This is the diagnostic `film_error`; above 0.1
the status is `unresolved`. The ratio of gap and node spacing alone is a worse measure: at a gap of one spacing the
error is 7e-2, 2e-3, 3e-4 with 64, 96, 128 nodes.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from experiments import _common, _pairs
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import extremes
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.observables import diagnostics
from jaxves.observables.checks import Checks
from jaxves.plots import run_plots

GAPS = (0.4, 0.2, 0.1, 0.07, 0.05, 0.035, 0.025, 0.015)
QUICK = dict(gaps=(1.0,), sizes=(32, 48), t_end=0.1, saves=2, start=32)


@eqx.filter_jit
def gap_rate(setting, x, V_m):
    """d/dt of the gap, and the diagnostics, of nodes `x` with `V_m`, both interpolated to the nodes of `setting`."""
    N = setting.x.shape[1]
    equation = equation_for(setting)
    y = Unknowns.of(fourier.resample(x, N, axis=1), fourier.resample(V_m, N, axis=1))
    motion = equation.motion(jnp.zeros(()), y)
    _, rate = jax.jvp(lambda x: extremes.gap(*(Curve.from_nodes(x) for x in x)), (y.x,), (motion.velocity,))
    return rate, diagnostics.diagnose(equation, jnp.zeros(()), y, motion)


def run(gaps=GAPS, sizes=(48, 64, 96, 128, 192, 256), t_end=6.5, saves=130, start=64):
    """Returns {gap: {N: rate, relative error, estimate, gap in node spacings}}; the last N is the reference."""
    setting = _pairs.scene(0.1, N=start)
    chain = _pairs.history(setting, t_end, saves, thinnest=min(gaps), checks=Checks(film=np.inf))
    found = {}
    for gap in gaps:
        row = int(np.argmin(np.abs(chain["min_gap"] - gap)))
        x, V_m = jnp.asarray(chain["x"][row]), jnp.asarray(chain["V_m"][row])
        gap = float(chain["min_gap"][row])
        found[gap] = {}
        for N in reversed(sizes):
            rate, diagnosed = gap_rate(_pairs.scene(0.1, N=N), x, V_m)
            rate = float(rate)
            exact = rate if sizes[-1] == N else found[gap][sizes[-1]]["rate"]
            found[gap][N] = {
                "rate": rate,
                "error": abs(rate / exact - 1),
                "estimate": float(diagnosed["film_error"]),
                "spacings": gap * N / (2 * np.pi),
            }
    return found


def draw(found) -> Figure:
    """Draws the error against the estimate, and against the gap in node spacings."""
    figure = Figure(figsize=(run_plots.PAGE, 2.8), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    sizes = sorted(next(iter(found.values())))[:-1]
    for N in sizes:
        cases = [found[gap][N] for gap in found]
        errors = [max(case["error"], 1e-12) for case in cases]
        left.loglog([case["estimate"] for case in cases], errors, "o", ms=3, label=f"N = {N}")
        right.loglog([case["spacings"] for case in cases], errors, "o-", ms=3, lw=0.7)
    ends = np.array([1e-9, 10.0])
    left.plot(ends, ends, color="0.6", lw=0.7, zorder=0)
    left.axvline(0.1, color="0.6", lw=0.7, ls="--", zorder=0)
    left.set(xlabel=r"estimate $\tau/(2d)^2$", ylabel="relative error of the rate of drainage")
    right.set(xlabel="gap in node spacings")
    left.legend()
    return figure


def main():
    found = run()
    for gap, sizes in found.items():
        for N, case in sorted(sizes.items())[:-1]:
            print(
                f"gap {gap:.4f}, N = {N:3d}: {case['spacings']:5.2f} spacings, rate {case['rate']:+.5f}, "
                f"error {case['error']:.1e}, estimate {case['estimate']:.1e}"
            )
    _common.store("film", {str(gap): sizes for gap, sizes in found.items()})
    _common.save(_common.styled(draw)(found), "film")


if __name__ == "__main__":
    main()
