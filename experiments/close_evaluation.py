"""How accurate are layer potentials at targets that nearly touch the curve, and what do they cost?

    python -m experiments.close_evaluation          # tables and a figure, about a minute

What to expect: if the density is resolved, 12 to 15 digits in values and 10 to 13 in gradients, at every distance and
on both sides. The trapezoidal rule has one or two. On the star at distance 1e-3 the two Green identities reach
round-off at 150 and 200 nodes. S of a given density needs more nodes, because they must resolve its product with |Z'|,
which has infinitely many modes. A Stokes matrix for 256 nodes and 256 targets costs about as much as the LU
factorisation of 512 unknowns. A single density costs a third of it.
"""

import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.geometry.curve import Curve
from jaxves.plots import run_plots
from jaxves.potentials import close_laplace, close_stokes, far, kernels
from jaxves.potentials.close_laplace import CloseGeometry

from ._common import save, styled

SHAPES = {
    "circle": (lambda t: np.exp(1j * t), 96),
    "ellipse": (lambda t: np.cos(t) + 0.25j * np.sin(t), 256),
    "star": (lambda t: (1 + 0.3 * np.cos(5 * t)) * np.exp(1j * t), 448),
}
DISTANCES = tuple(10.0**-k for k in range(1, 11))
QUICK = dict(shapes=("circle",), distances=(1e-2, 1e-6), sizes=(100,))
FORCE_AT, FORCE, VISCOSITY = np.array([1.5, 1.2]), np.array([0.6, 0.8]), 0.7


def real(z):
    return jnp.asarray(np.stack([z.real, z.imag], axis=-1))


def curve_and_targets(Z, N, distances, count):
    """The curve with N nodes, and its points at odd parameters moved by each distance in and out: (2, D, P, 2)."""
    t, fine = 2 * np.pi * np.arange(N) / N, 2 * np.pi * np.arange(2048) / 2048
    tau = 2 * np.pi * (np.arange(1, count + 1) - 0.5) / count + 0.0123
    coefficients = np.fft.fft(Z(fine)) * 1j * np.fft.fftfreq(2048, 1 / 2048)
    modes = np.abs(np.fft.fftfreq(2048, 1 / 2048)) < 16  # all of Z', none of the round-off
    dZ = np.exp(1j * np.outer(tau, np.fft.fftfreq(2048, 1 / 2048)[modes])) @ coefficients[modes] / 2048
    normal = -1j * dZ / np.abs(dZ)
    targets = np.stack([Z(tau) + np.multiply.outer(side * np.array(distances), normal) for side in (-1, 1)])
    return t, jax.jit(Curve.from_nodes)(real(Z(t))), real(targets)


def densities(t):
    scalar = np.exp(np.sin(3 * t)) - 0.7
    return jnp.asarray(scalar), jnp.asarray(np.stack([scalar, np.cos(2 * t) + 0.5 * np.sin(t)], axis=-1))


@jax.jit
def _close(curve, targets, q, f):
    close = CloseGeometry.of(curve, targets.reshape(-1, 2))
    values = (
        close_laplace.laplace_slp(close, q),
        close_laplace.laplace_slp_gradient(close, q),
        close_stokes.stokes_slp(close, f),
    )
    return [value.reshape(targets.shape[:3] + value.shape[1:]) for value in values]


@jax.jit
def _trapezoidal(curve, targets, q):
    one = jax.tree.map(lambda leaf: leaf[None], curve)
    return far.laplace_slp(one, q[None], targets.reshape(-1, 2)).reshape(targets.shape[:3])


def _relative(value, exact):
    """Returns the largest error over the targets, divided by the largest value: (2, D)."""
    axes = tuple(range(2, value.ndim))
    return np.max(np.abs(value - exact), axis=axes) / np.max(np.abs(exact))


def by_distance(name, distances=DISTANCES, count=60):
    """Relative errors (side, distance) of S, ∇S, Stokes S and the trapezoidal S; references with twice the nodes."""
    Z, N = SHAPES[name]
    t, curve, targets = curve_and_targets(Z, N, distances, count)
    t_fine, finer, _ = curve_and_targets(Z, 2 * N, distances, count)
    exact = _close(finer, targets, *densities(t_fine))
    q, f = densities(t)
    found = [*_close(curve, targets, q, f), _trapezoidal(curve, targets, q)]
    names = ("S", "∇S", "Stokes S", "trapezoidal S")
    return {
        n: _relative(np.asarray(a), np.asarray(b)) for n, a, b in zip(names, found, [*exact, exact[0]], strict=True)
    }


@jax.jit
def _four(curve, inner, outer, q, f):
    """Values of the four cases: two Green identities less their field, S inside and outside, Stokes S likewise."""
    close = CloseGeometry.of(curve, inner)
    x, normal = curve.x, curve.normal
    grow = jnp.exp(x[:, 0])
    slope = grow * (jnp.cos(x[:, 1]) * normal[:, 0] - jnp.sin(x[:, 1]) * normal[:, 1])
    harmonic = close_laplace.laplace_slp(close, slope) - close_laplace.laplace_dlp(close, grow * jnp.cos(x[:, 1]))

    def stokeslet(points):
        return kernels.stokeslet(points - FORCE_AT) @ FORCE / VISCOSITY

    r = x - FORCE_AT
    r2 = jnp.sum(r**2, axis=-1)
    traction = -r * ((r @ FORCE) * jnp.sum(r * normal, axis=-1) / (jnp.pi * r2**2))[:, None]
    flow = close_stokes.stokes_slp(close, traction) / VISCOSITY - close_stokes.stokes_dlp(close, stokeslet(x))
    sides = [close, CloseGeometry.of(curve, outer)]
    return (
        harmonic - jnp.exp(inner[:, 0]) * jnp.cos(inner[:, 1]),
        jnp.stack([close_laplace.laplace_slp(side, q) for side in sides]),
        flow - stokeslet(inner),
        jnp.stack([close_stokes.stokes_slp(side, f) for side in sides]),
    )


def four_cases(sizes=(100, 150, 200, 300), distance=1e-3, reference=960):
    """{N: largest errors of (L-GRF, L-S, S-GRF, S-S)} on the star, over 200 targets a side."""

    def values(N):
        t, curve, targets = curve_and_targets(SHAPES["star"][0], N, [distance], 200)
        return _four(curve, targets[0, 0], targets[1, 0], *densities(t))

    _, S, _, S_stokes = values(reference)
    zeros = 0.0, S, 0.0, S_stokes
    return {N: [float(jnp.max(jnp.abs(a - b))) for a, b in zip(values(N), zeros, strict=True)] for N in sizes}


def timings(N=256, repeats=41):
    """{what: median seconds}, geometry included, for N nodes and N close targets, beside an LU factorisation of 2N."""
    from scipy.linalg import lu_factor

    t, curve, targets = curve_and_targets(SHAPES["star"][0], N, [1e-3], N)
    q, f = densities(t)

    def potential(function, *density):
        run = jax.jit(lambda x, y: function(CloseGeometry.of(Curve.from_nodes(x), y), *density))
        return lambda: jax.block_until_ready(run(curve.x, targets[1, 0]))

    matrix = np.random.default_rng(0).standard_normal((2 * N, 2 * N))
    cases = {
        "Stokes S, one density": potential(close_stokes.stokes_slp, f),
        "Stokes S matrix": potential(close_stokes.stokes_slp_matrix),
        "Laplace S, one density": potential(close_laplace.laplace_slp, q),
        "Laplace S matrix": potential(close_laplace.laplace_slp_matrix),
        "LU factorisation": lambda: lu_factor(matrix, check_finite=False),
    }

    def seconds(call):
        start = time.perf_counter()
        call()
        return time.perf_counter() - start

    for call in cases.values():
        call()  # compiles
    return {name: statistics.median(seconds(call) for _ in range(repeats)) for name, call in cases.items()}


def run(shapes=tuple(SHAPES), distances=DISTANCES, sizes=(100, 150, 200, 300)):
    """Errors by shape and distance, and those of the four cases by number of nodes."""
    return {"by_distance": {name: by_distance(name, distances) for name in shapes}, "four_cases": four_cases(sizes)}


@styled
def draw(errors, distances=DISTANCES) -> Figure:
    """Draws the errors of each shape against the distance, the larger one of both sides."""
    figure = Figure(figsize=(run_plots.PAGE, 2.8), layout="constrained")
    panels = figure.subplots(1, len(errors), sharey=True)
    for axes, (name, shape) in zip(panels, errors.items(), strict=True):
        for color, (kind, error) in zip(("C0", "C1", "C2", "0.6"), shape.items(), strict=True):
            axes.loglog(distances, np.max(error, axis=0) + 1e-17, ".-", color=color, lw=1, label=kind)
        axes.set(title=f"{name}, $N = {SHAPES[name][1]}$", xlabel="distance / $a$", ylim=(1e-16, 10))
    panels[0].set_ylabel("largest relative error")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    return figure


def main():
    found = run()
    for name, shape in found["by_distance"].items():
        print(f"{name}, N = {SHAPES[name][1]}: largest relative error, inside / outside")
        for kind, error in shape.items():
            print(f"  {kind:14}" + "".join(f" {a:.0e}/{b:.0e}" for a, b in error.T))
    print("star, distance 1e-3:   N     L-GRF    L-S      S-GRF    S-S")
    for N, errors in found["four_cases"].items():
        print(f"{N:24d}   " + "  ".join(f"{error:.1e}" for error in errors))
    for name, seconds in timings().items():
        print(f"{name:24} {1e3 * seconds:7.2f} ms")
    save(draw(found["by_distance"]), "close_evaluation")


if __name__ == "__main__":
    main()
