"""Dense factorisation or GMRES for the two linear systems of the equation of motion?

    python -m experiments.solvers          # table and a figure, about two minutes

Charge: (½ + η S') w = b, of the second kind. Tension: K σ = b, where -K σ is |x_α| times the stretch rate that σ
causes. On a circle K = |k|/4, so 4/|k| (1 at k = 0) is the natural circulant preconditioner. GMRES needs no matrices
except the kernels, which both methods need. The dense method also forms K (products of N × N matrices) and factorises
it.

What to expect: iterations do not grow with N, except without the preconditioner. Dense is faster at 64 nodes. GMRES is
faster for the charge from about 128 nodes on, by a growing factor, and for the tension from 256 on, by little. The
linear part A of a step needs the factors anyway, for N and 2N right-hand sides, and shares them with its first rate
and the projection.
"""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse.linalg
from matplotlib.figure import Figure

from jaxves.equation.inextensible import TensionBlock
from jaxves.equation.mobility import own_spread
from jaxves.geometry import shapes
from jaxves.numerics import fourier
from jaxves.numerics.linear import GMRES, Dense, LinearOperator
from jaxves.operators.surfaces import Surfaces
from jaxves.plots import run_plots

from ._common import interleaved, medians, save, store, styled

CONTRAST = (0.1 - 1) / (0.1 + 1)  # Λ = 0.1
TOLERANCE = 1e-9  # rounding in the action of K alone leaves 1e-10 at 512 nodes
QUICK = dict(sizes=(64,), shapes=("Δ = 0.9",), timed="Δ = 0.9", repeats=1)
_CUT = 1  # σ loses its Nyquist mode


def peanut(N, depth=0.8):
    """Returns a curve with radius 1 + `depth` cos 2θ, scaled: two bodies and a neck."""
    theta = fourier.grid(1024)
    radius = 1 + depth * jnp.cos(2 * theta)
    nodes = jnp.stack([radius * jnp.cos(theta), radius * jnp.sin(theta)], axis=-1)
    return shapes.scaled(shapes.equispaced(nodes, N), 1.0)


SHAPES = {
    "Δ = 0.9": lambda N: shapes.ellipse(N, 0.9),
    "Δ = 0.5": lambda N: shapes.ellipse(N, 0.5),
    "peanut": jax.jit(peanut, static_argnums=(0, 1)),
}


def surfaces_of(x):
    """Returns the kernels of one membrane, without the axis of vesicles."""
    return jax.tree.map(lambda leaf: leaf[0], Surfaces.of(x[None], electric=True))


def charge_operator(surfaces, *, dense: bool) -> LinearOperator:
    """Returns ½ + η S' with the mean, as matrix or action."""
    speed = surfaces.curves.speed
    N = speed.shape[0]
    mean = 1 / jnp.sum(speed)
    if dense:
        return LinearOperator((surfaces.laplace_slp_dn * CONTRAST + mean) * speed + 0.5 * np.eye(N))

    def action(w):
        weighted = speed * w
        return 0.5 * w + CONTRAST * (surfaces.laplace_slp_dn @ weighted) + mean * jnp.sum(weighted)

    return LinearOperator(action=action)


def tension_operator(surfaces, *, dense: bool, preconditioned: bool = True) -> LinearOperator:
    """K with the Nyquist mode pinned, as matrix or action.

    The action is preconditioned from the right, K M y = b with σ = M y: then GMRES watches the true residual, where
    a left preconditioner hides what is left of it at short waves.
    """
    curve = surfaces.curves
    N = curve.speed.shape[0]
    if dense:
        spread = own_spread(curve.tangent, surfaces.stokes_slp, surfaces.laplace_slp)
        return LinearOperator(TensionBlock.of(curve, spread, False, _CUT).stiffness, positive_definite=True)

    def action(sigma):
        low = fourier.low_pass(sigma, _CUT)
        velocity = surfaces.stokes_slp @ fourier.derivative(low[:, None] * curve.tangent, axis=0)
        stretch = -jnp.sum(curve.tangent * fourier.derivative(velocity, axis=0), axis=-1)
        return fourier.low_pass(stretch, _CUT) + sigma - low

    symbol = 4.0 / np.maximum(fourier.wavenumbers(N), 1)
    symbol[0] = symbol[-1] = 1.0
    inverse = fourier.circulant(symbol, N)
    return LinearOperator(action=(lambda y: action(inverse @ y)) if preconditioned else action)


OPERATORS = {
    "charge": lambda surfaces: charge_operator(surfaces, dense=False),
    "tension": lambda surfaces: tension_operator(surfaces, dense=False),
    "tension, plain": lambda surfaces: tension_operator(surfaces, dense=False, preconditioned=False),
}


def right_hand_sides(surfaces):
    """Returns smooth right-hand sides without symmetry, similar to those of a vertical field."""
    alpha = fourier.grid(surfaces.curves.speed.shape[0])
    charge = surfaces.curves.normal @ jnp.array([0.3, 1.0])
    return {"charge": charge, "tension": charge * jnp.exp(jnp.sin(2 * alpha + 0.4))}


def iterations(operator, b) -> int:
    """Returns how many applications GMRES needs to TOLERANCE, without restarts (SciPy's)."""
    N = len(b)
    mv = jax.jit(operator.mv)
    residuals = []
    A = scipy.sparse.linalg.LinearOperator((N, N), lambda v: np.array(mv(jnp.asarray(v).reshape(-1))), dtype=float)
    scipy.sparse.linalg.gmres(
        A, np.asarray(b), rtol=TOLERANCE, restart=N, maxiter=1, callback=residuals.append, callback_type="pr_norm"
    )
    return len(residuals)


def counts(shape, N):
    """Returns {system: applications}."""
    surfaces = jax.jit(surfaces_of)(SHAPES[shape](N))
    b = right_hand_sides(surfaces)
    return {name: iterations(make(surfaces), b[name.split(",")[0]]) for name, make in OPERATORS.items()}


def timings(shape, N, repeats):
    """Returns {method: (seconds, true residual)} of forming, factorising and solving once."""
    surfaces = jax.jit(surfaces_of)(SHAPES[shape](N))
    b = right_hand_sides(surfaces)
    cases = {
        "charge, dense": (Dense(), lambda s: charge_operator(s, dense=True)),
        "charge, GMRES": (GMRES(TOLERANCE, restart=15), OPERATORS["charge"]),
        "tension, dense": (Dense(), lambda s: tension_operator(s, dense=True)),
        "tension, GMRES": (GMRES(TOLERANCE, restart=15), OPERATORS["tension"]),
        "tension, GMRES plain": (GMRES(TOLERANCE, restart=60), OPERATORS["tension, plain"]),
    }

    def solving(solver, make):
        return jax.jit(lambda surfaces, b: solver.factor(make(surfaces)).solve(b))

    programs = {name: solving(*case) for name, case in cases.items()}
    calls = {name: (lambda p=p, n=name: p(surfaces, b[n.split(",")[0]])) for name, p in programs.items()}
    kernels = jax.jit(surfaces_of)
    x = surfaces.curves.x
    seconds = medians(interleaved(calls | {"kernels": lambda: kernels(x)}, repeats))
    return {"seconds": seconds, "residuals": {name: float(call().residual) for name, call in calls.items()}}


def run(sizes=(64, 128, 256, 512), shapes=tuple(SHAPES), timed="peanut", repeats=61):
    """Returns counts by shape and size, times and residuals by size."""
    return {
        "counts": {shape: {N: counts(shape, N) for N in sizes} for shape in shapes},
        "timings": {N: timings(timed, N, repeats) for N in sizes},
    }


_COUNTED = ("-", "-", ":")


@styled
def draw(found) -> Figure:
    """Draws the time of each method against N, and the counts."""
    figure = Figure(figsize=(run_plots.PAGE, 2.6))
    left, right = figure.subplots(1, 2)
    sizes = list(found["timings"])
    styles = ("-o", "--o", "-s", "--s", ":s", "-")
    colors = ("C0", "C0", "C1", "C1", "C1", "0.6")
    seconds = {N: row["seconds"] for N, row in found["timings"].items()}
    for name, style, color in zip(seconds[sizes[0]], styles, colors, strict=True):
        left.loglog(sizes, [1e3 * seconds[N][name] for N in sizes], style, color=color, ms=3, label=name)
    left.set(xlabel="N", ylabel="ms", title="forming, factoring and solving once (peanut)")
    left.legend(fontsize=6)
    for marker, table in zip("ov^", found["counts"].values(), strict=False):
        for i, name in enumerate(OPERATORS):
            label = name if marker == "o" else None
            right.semilogx(
                sizes,
                [table[N][name] for N in sizes],
                _COUNTED[i] + marker,
                color=("C0", "C1", "C1")[i],
                ms=3.5,
                label=label,
            )
    right.set(xlabel="N", ylabel=f"applications to {TOLERANCE:.0e}", ylim=(0, None))
    marked = ", ".join(f"{mark} {shape}" for mark, shape in zip("○▽△", found["counts"], strict=False))
    right.set_title(marked)
    right.legend(fontsize=6)
    for axes in (left, right):
        axes.set_xticks(sizes, [str(N) for N in sizes])
        axes.minorticks_off()
    return figure


def main():
    found = run()
    print(f"applications to {TOLERANCE:.0e}: charge, tension, tension without preconditioner")
    for shape, table in found["counts"].items():
        print(f"  {shape:8}" + "".join(f"  N = {N}: " + ", ".join(map(str, row.values())) for N, row in table.items()))
    print("ms to form, factor and solve once (true residual)")
    for N, row in found["timings"].items():
        parts = [f"{name} {1e3 * s:.2f}" for name, s in row["seconds"].items()]
        print(f"  N = {N:3d}: " + "; ".join(parts))
        print("           " + "; ".join(f"{name} {r:.0e}" for name, r in row["residuals"].items()))
    store("solvers", found)
    save(draw(found), "solvers")


if __name__ == "__main__":
    main()
