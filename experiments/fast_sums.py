"""How much faster are sums over many nodes by a local part and an FFT than direct sums?

    python -m experiments.fast_sums                # table and figure, a few minutes
    python -m experiments.fast_sums --processes 200   # does any of 200 fresh processes hang? half an hour

The nodes are those of ellipses on a square lattice, turned at random. Fast sums take the sizes that `MatrixFree` uses.
`direct, jnp.log` is the direct sum with the logarithm of XLA, which version 0.1.0 used. Direct sums are timed for the
nodes of at most 16 vesicles and scaled to all of them. Times are processor times of calls in turns. The error is the
largest at these nodes, relative to the largest value. `build` makes lists, windows and the matrices of the local part,
once per geometry; `velocity` and `gradient` are one sum each. `double layer` is the sum of the Stokes double layer, on
the finer grid that it needs, and `build with it` makes what both layers need.

What to expect: an error below the tolerance, and a time that grows a little faster than the number of nodes.

The transforms of XLA use several threads, also within compiled loops. Each of the fresh processes has the default
options of XLA, and solves systems with fast sums by GMRES within a scan. None must hang.
"""

import argparse
import os
import statistics
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.ewald.lists import Excluded
from jaxves.ewald.plans import plan_for
from jaxves.ewald.stresslets import StressletSums
from jaxves.ewald.sums import EwaldSums
from jaxves.geometry.curve import Curve
from jaxves.geometry.domain import Free
from jaxves.numerics.linear import GMRES, LinearOperator
from jaxves.plots import run_plots
from jaxves.potentials import far

from ._common import save, store, styled

SIZES = (16, 64, 256)
TOLERANCES = (1e-6, 1e-12)
QUICK = {"sizes": (16,), "tolerances": (1e-6,), "N": 16, "repeats": 1}
_SOME = 16  # vesicles whose nodes are targets of direct sums


def scene(M: int, N: int, spacing=2.9, seed=0):
    """Returns curves, forces and charges of M ellipses."""
    rng = np.random.default_rng(seed)
    angle, side = 2 * np.pi * np.arange(N) / N, int(np.ceil(np.sqrt(M)))
    place = np.stack(np.divmod(np.arange(M), side), axis=-1) @ np.array([1, 1j]) * spacing
    z = np.exp(1j * rng.uniform(0, np.pi, M))[:, None] * (1.25 * np.cos(angle) + 0.68j * np.sin(angle))
    z = z + place[:, None]
    curves = jax.jit(jax.vmap(Curve.from_nodes))(jnp.asarray(np.stack([z.real, z.imag], axis=-1)))
    return curves, jnp.asarray(rng.normal(size=(M, N, 2))), jnp.asarray(rng.normal(size=(M, N)))


def _with_xla_logarithm(curves: Curve, f, targets):
    """The direct Stokes sum of version 0.1.0."""
    y = curves.x.reshape(-1, 2)
    rx, ry = targets[:, 0, None] - y[:, 0], targets[:, 1, None] - y[:, 1]
    r2 = rx**2 + ry**2
    inverse_r2 = 1 / jnp.where(r2 > 0, r2, 1.0)
    fx, fy = (f * curves.weights[..., None]).reshape(-1, 2).T
    log = 0.5 * jnp.log(inverse_r2)
    along = (rx * fx + ry * fy) * inverse_r2
    rows = jnp.sum(log * fx + rx * along, axis=1), jnp.sum(log * fy + ry * along, axis=1)
    return jnp.stack(rows, axis=-1) / (4 * np.pi)


def _directly(potential, curves: Curve, density, some):
    """Returns a direct sum at the nodes of `some` vesicles, over all others."""

    def at(target):
        left_out = (jnp.arange(density.shape[0]) == target).reshape(-1, *[1] * (density.ndim - 1))
        return potential(curves, jnp.where(left_out, 0.0, density), curves.x[target])

    return jax.lax.map(at, some)


def _fast(sums: EwaldSums, curves: Curve, f, q, some):
    """Returns velocity and gradient at the nodes of `some` vesicles, over all others."""

    def own(m):
        r = curves.x[m][:, None] - curves.x[m]
        A, B = (part * curves.weights[m] for part in sums.smooth(jnp.sum(r**2, axis=-1)))
        along = B * jnp.einsum("ijk,jk->ij", r, f[m])
        return A @ f[m] + jnp.einsum("ij,ijk->ik", along, r), jnp.einsum("ij,j,ijk->ik", -2 * B, q[m], r)

    velocity, gradient = jax.lax.map(own, some)
    return sums.stokes(f)[some] - velocity, sums.slp_gradient(q)[some] - gradient


def _fast_double_layer(sums: StressletSums, curves: Curve, u, some):
    """Returns the double layer at the nodes of `some` vesicles, over all others."""

    def own(m):
        matrix = sums.smooth_matrix(curves.x[m], curves.x[m], curves.normal[m], curves.weights[m])
        return (matrix @ u[m].T.reshape(-1)).reshape(2, -1).T

    return sums(u)[some] - jax.lax.map(own, some)


def _in_turns(calls: dict, repeats: int) -> dict[str, float]:
    """Returns the median processor time of each call."""
    for call in calls.values():
        jax.block_until_ready(call())
    seconds = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.process_time()
            jax.block_until_ready(call())
            seconds[name].append(time.process_time() - start)
    return {name: statistics.median(found) for name, found in seconds.items()}


def row(M: int, N: int, tolerance: float, repeats: int) -> dict:
    """Returns times and errors for M vesicles."""
    curves, f, q = scene(M, N)
    some = jnp.asarray(np.random.default_rng(1).choice(M, min(M, _SOME), replace=False))
    plan = plan_for(M, N, tolerance)
    nothing = Excluded(jnp.zeros(1, int), jnp.zeros(1, int), None, jnp.zeros(1, bool))
    build = jax.jit(lambda curves: EwaldSums.of(curves.x, curves.weights, plan, Free(), nothing))
    sums = build(curves)
    finer = plan_for(M, N, tolerance, contrast=True)

    @jax.jit
    def build_both(curves):
        both = EwaldSums.of(curves.x, curves.weights, finer, Free(), nothing)
        return StressletSums.of(both, curves.normal, Free())

    stresslets = build_both(curves)
    sums_of = EwaldSums.stokes, EwaldSums.slp_gradient, StressletSums.__call__
    velocity, gradient, double = (jax.jit(function) for function in sums_of)
    old, new, charges, doubled = (
        jax.jit(lambda curves, density, some, potential=potential: _directly(potential, curves, density, some))
        for potential in (_with_xla_logarithm, far.stokes_slp, far.laplace_slp_gradient, far.stokes_dlp)
    )
    exact = new(curves, f, some), charges(curves, q, some), doubled(curves, f, some)
    found = *jax.jit(_fast)(sums, curves, f, q, some), jax.jit(_fast_double_layer)(stresslets, curves, f, some)
    errors = [float(jnp.max(jnp.abs(a - b)) / jnp.max(jnp.abs(b))) for a, b in zip(found, exact, strict=True)]
    calls = {
        "direct, jnp.log": lambda: old(curves, f, some),
        "direct": lambda: new(curves, f, some),
        "direct gradient": lambda: charges(curves, q, some),
        "direct double layer": lambda: doubled(curves, f, some),
        "build": lambda: build(curves),
        "velocity": lambda: velocity(sums, f),
        "gradient": lambda: gradient(sums, q),
        "build with it": lambda: build_both(curves),
        "double layer": lambda: double(stresslets, f),
    }
    seconds = _in_turns(calls, repeats)
    scaled = {name: value * (M / len(some) if "direct" in name else 1) for name, value in seconds.items()}
    return {
        "vesicles": M,
        "nodes": M * N,
        "tolerance": tolerance,
        "seconds": scaled,
        "error of velocity": errors[0],
        "error of gradient": errors[1],
        "error of double layer": errors[2],
        "lists too short": bool(sums.overflow | stresslets.sums.overflow),
    }


def solved_in_a_scan(M=16, N=64, systems=20) -> float:
    """Solves f + S[f] = b for several b by GMRES in a scan; returns the largest residual."""
    curves, f, _ = scene(M, N)
    nothing = Excluded(jnp.zeros(1, int), jnp.zeros(1, int), None, jnp.zeros(1, bool))

    @jax.jit
    def residuals(curves, f):
        sums = EwaldSums.of(curves.x, curves.weights, plan_for(M, N, 1e-6), Free(), nothing)

        def one(b, _):
            operator = LinearOperator(action=lambda v: v + 0.1 * sums.stokes(v.reshape(b.shape)).reshape(-1))
            found = GMRES(1e-7).factor(operator).solve(b.reshape(-1)).reshaped(*b.shape)
            return found.value, found.residual

        return jax.lax.scan(one, f, length=systems)[1]

    return float(jnp.max(residuals(curves, f)))


def fresh_processes(count: int, limit=300.0) -> dict:
    """Returns how many of `count` fresh processes ended within `limit` seconds, and the longest time of these."""
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}
    seconds, hung = [], 0
    for _ in range(count):
        start = time.perf_counter()
        command = [sys.executable, "-m", "experiments.fast_sums", "--one"]
        try:
            subprocess.run(command, check=True, capture_output=True, timeout=limit, env=environment)
        except subprocess.TimeoutExpired:
            hung += 1
        else:
            seconds.append(time.perf_counter() - start)
    return {"processes": count, "ended": len(seconds), "hung": hung, "longest": max(seconds, default=None)}


def run(sizes=SIZES, tolerances=TOLERANCES, N=64, repeats=5) -> list[dict]:
    """Returns one row for each number of vesicles and tolerance."""
    return [row(M, N, tolerance, repeats) for tolerance in tolerances for M in sizes]


@styled
def draw(rows) -> Figure:
    """Draws seconds against nodes."""
    figure = Figure(figsize=(0.55 * run_plots.PAGE, 2.6))
    axes = figure.subplots()
    tightest = min(row["tolerance"] for row in rows)
    some = [row for row in rows if row["tolerance"] == tightest]
    nodes = [row["nodes"] for row in some]
    for name, style in {"direct, jnp.log": "s:", "direct": "s-"}.items():
        axes.loglog(nodes, [row["seconds"][name] for row in some], style, ms=3, color="0.5", label=name)
    for k, tolerance in enumerate(sorted({row["tolerance"] for row in rows})):
        found = [row for row in rows if row["tolerance"] == tolerance]
        label = f"fast, tolerance {tolerance:.0e}"
        seconds = [row["seconds"]["velocity"] for row in found]
        axes.loglog([row["nodes"] for row in found], seconds, "o-", ms=3, color=f"C{k}", label=label)
    axes.set(xlabel="nodes", ylabel="processor time, s", title="one sum of the Stokes single layer")
    axes.legend(fontsize=6)
    return figure


def report(rows) -> None:
    """Prints the table."""
    names = list(rows[0]["seconds"])
    heads = "  ".join(f"{name:>19}" for name in names)
    print(f"  nodes  tolerance  {heads}  error: velocity  gradient  double layer")
    for row in rows:
        seconds = "  ".join(f"{row['seconds'][name]:19.4f}" for name in names)
        errors = f"{row['error of velocity']:16.1e}{row['error of gradient']:10.1e}"
        errors += f"{row['error of double layer']:14.1e}"
        print(f"{row['nodes']:7d} {row['tolerance']:10.0e}  {seconds} {errors}")


def main():
    parser = argparse.ArgumentParser(prog="python -m experiments.fast_sums", description=__doc__.splitlines()[0])
    parser.add_argument("--processes", type=int, help="count fresh processes that hang")
    parser.add_argument("--one", action="store_true", help="what each of these does")
    wanted = parser.parse_args()
    if wanted.one:
        print(solved_in_a_scan())
        return
    if wanted.processes is not None:
        found = fresh_processes(wanted.processes)
        print(found)
        store("fast_sums", found, "processes")
        return
    rows = run()
    report(rows)
    store("fast_sums", rows)
    save(draw(rows), "fast_sums")


if __name__ == "__main__":
    main()
