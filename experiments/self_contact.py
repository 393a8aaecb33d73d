"""How accurate is the self-interaction of a membrane in a narrow neck?

    python -m experiments.self_contact          # table and a figure, about a minute

The neck of a dumbbell narrows from 1 to 0.02 with a fixed number of nodes. S, S' and Stokes S of smooth densities are
computed with Kress's rule alone, and with kernels on a finer grid as in `jaxves/potentials/self_refined.py`. The
reference is Kress's rule on a grid with eight or more nodes across the neck.

What to expect: the error of the rule alone is about e^{-2πd} at a neck of d node spacings, so that no digits are left
below one. On the finer grid the error stays at the level to which the nodes resolve shape and densities (1e-11 for S
and Stokes S, 1e-9 for S' with 128 nodes, 1e-6 and worse with 64), down to half a spacing. Below a quarter a run ends
as `unresolved`.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.plots import run_plots
from jaxves.potentials.chords import Chords
from jaxves.potentials.self_refined import Refinement, SelfKernels, self_kernels

from ._common import save, store, styled

WIDTHS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.06, 0.04, 0.03, 0.02)
POTENTIALS = ("S", "S'", "Stokes S")
QUICK = dict(sizes=(64,), widths=(1.0, 0.1), fine=1024)


def dumbbell(N, width):
    """Returns two bulbs, joined by a neck along x of this width."""
    alpha = fourier.grid(N)
    return jnp.stack([1.5 * jnp.cos(alpha), jnp.sin(alpha) * (width / 2 + 0.8 * jnp.cos(alpha) ** 2)], axis=-1)


@functools.partial(jax.jit, static_argnames="corrected")
def potentials(x, *, corrected):
    """Returns the three potentials of e^{sin α}, and of (e^{sin α}, cos 2α) as a force."""
    curve = Curve.from_nodes(x)
    if corrected:
        kernels = jax.tree.map(lambda leaf: leaf[0], self_kernels(x[None], electric=True)[1])
    else:
        kernels = SelfKernels.of(curve, Chords.of(curve), electric=True)
    alpha = fourier.grid(x.shape[0])
    q = jnp.exp(jnp.sin(alpha)) * curve.speed
    f = jnp.stack([q, jnp.cos(2 * alpha) * curve.speed], axis=-1)
    values = kernels.laplace_slp @ q, kernels.laplace_slp_dn @ q, kernels.stokes_slp @ f
    return dict(zip(POTENTIALS, values, strict=True))


def run(sizes=(64, 128), widths=WIDTHS, fine=2048):
    """Returns a row for each N and width: spacings across the neck, refinement, errors with and without it."""
    rows = []
    for width in widths:
        exact = potentials(dumbbell(fine, width), corrected=False)
        for N in sizes:
            x = dumbbell(N, width)
            curve = Curve.from_nodes(x)
            row = {"N": N, "width": width, "spacings": width / float(jnp.max(curve.weights))}
            grids = Refinement()
            row["factor"] = grids.factors[int(grids.level(curve))]
            for kind, corrected in (("plain", False), ("corrected", True)):
                found = potentials(x, corrected=corrected)
                for name, value in found.items():
                    reference = exact[name][:: fine // N]
                    error = jnp.max(jnp.abs(value - reference)) / jnp.max(jnp.abs(reference))
                    row[f"{kind} {name}"] = float(error)
            rows.append(row)
    return sorted(rows, key=lambda row: (row["N"], -row["width"]))


@styled
def draw(rows) -> Figure:
    """Draws the shapes, and the errors against the width of the neck for each number of nodes."""
    sizes = sorted({row["N"] for row in rows})
    figure = Figure(figsize=(run_plots.PAGE, 2.5))
    panels = figure.subplots(1, 1 + len(sizes))
    for width in (1.0, 0.25, 0.02):
        outline = np.asarray(dumbbell(512, width))
        panels[0].plot(*np.concatenate([outline, outline[:1]]).T, lw=0.9)
    panels[0].set(aspect="equal", xlabel="$x/a$", ylabel="$y/a$", title="necks of 1, 0.25, 0.02")
    for axes, N in zip(panels[1:], sizes, strict=True):
        mine = [row for row in rows if row["N"] == N]
        widths = [row["width"] for row in mine]
        for i, name in enumerate(POTENTIALS):
            axes.loglog(widths, [row[f"plain {name}"] for row in mine], "--", color=f"C{i}", lw=0.8)
            axes.loglog(widths, [row[f"corrected {name}"] for row in mine], "o-", color=f"C{i}", ms=3, label=name)
        axes.axvline(mine[0]["width"] / mine[0]["spacings"], color="0.6", lw=0.7)
        axes.set(xlabel="width of the neck / $a$", title=f"{N} nodes; grey: one spacing", ylim=(1e-15, 10))
    panels[1].set_ylabel("relative error (dashed: one grid)")
    panels[1].legend()
    return figure


def main():
    rows = run()
    print("   N  width  spacings  p   S: one grid, refined   S'                   Stokes S")
    for row in rows:
        errors = "  ".join(f"{row[f'plain {name}']:.1e}  {row[f'corrected {name}']:.1e}  " for name in POTENTIALS)
        print(f"{row['N']:4d}  {row['width']:.2f}   {row['spacings']:6.2f}  {row['factor']}   {errors}")
    store("self_contact", rows)
    save(draw(rows), "self_contact")


if __name__ == "__main__":
    main()
