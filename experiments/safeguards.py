"""What are projection, filter, finer kernels in necks, weighted modes and kept symmetries worth?

    python -m experiments.safeguards          # tables and a figure, about twelve minutes

After every step the nodes are filtered (N/16 modes of x, only Nyquist of σ and V_m) and projected back to uniform
metric and the given area. Here each safeguard is left out in turn. "Nyquist only" filters x as little as σ. A vesicle
buds with Kress's rule on the given nodes instead of on a finer grid in the neck. Steps are chosen by the unweighted
error, in which the highest modes count like all others. Two vesicles that start symmetric are not kept symmetric: one
that buds, and one that treads where treading is unstable.

What to expect: without the projection area and length drift, and the error of the shape is larger by a digit or more.
With the shallow filter a grid-scale stretching pattern, which σ cannot represent, halves the largest stable step and
increases the number of steps of a budding run. Neither changes accuracy or order. Without finer kernels the error of a
neck as wide as the node spacing is several per cent, and the neck closes in some runs. With unweighted modes round-off
in the highest modes grows to the size of the tolerance, and [μ] and tension are noise. Without kept symmetries the bud
has errors of several per cent after its neck has opened, and treading ends in a fold.
"""

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.base import status
from jaxves.equation.projection import Filter
from jaxves.geometry import shapes
from jaxves.observables.checks import Checks
from jaxves.physics.flow import Shear
from jaxves.physics.scene import make_scene
from jaxves.plots import run_plots
from jaxves.potentials.self_refined import Refinement
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.schemes import ARK4, ARK5

from ._common import march, pop, save, store, styled, treading
from ._distance import distances
from ._schemes import Even
from ._treading import Setting

SCENES = {"POP": (pop, 0.3), "tank-treading": (treading, 0.2)}
# projection on?, modes removed from x (None: the default)
VARIANTS = {
    "both": (True, None),
    "no projection": (False, None),
    "Nyquist only": (True, 1),
    "neither": (False, 1),
}
QUICK = dict(
    scenes=("tank-treading",), variants=("both", "no projection"), N=64, sizes=(20,), reference=80, pop_end=0.01,
    controlled=("POP",), necks=(), edge=(), symmetric=(),
)  # fmt: skip
_ALL = Checks(tail=np.inf, drift=np.inf)  # judged here by their error alone


def _filter(cut):
    return None if cut is None else Filter(x=cut)


def fixed(scene, t_end, variant, steps, stepper=None):
    """Returns final x and relative length error; None if the run breaks down."""
    projection, cut = VARIANTS[variant]
    method = Even(steps, stepper or ARK4(), projection)
    _, rows, equation = march(scene, method, [t_end], filter=_filter(cut), checks=_ALL)
    if not np.all(np.isfinite(rows["x"][-1])):
        return None
    return {
        "x": rows["x"][-1],
        "area": float(rows["area"][-1, 0] / equation.area[0] - 1),
        "length": float(rows["length"][-1, 0] / (2 * np.pi * equation.speed[0]) - 1),
    }


def with_fixed_steps(name, variants, N, sizes, reference):
    """{variant: {steps, error of x, area, length, largest stable step}}."""
    make, t_end = SCENES[name]
    scene = make(N)
    best = fixed(scene, t_end, "both", reference, ARK5())["x"]
    found = {}
    for variant in variants:
        table = {"steps": list(sizes), "x": [], "area": [], "length": []}
        for steps in sizes:
            last = fixed(scene, t_end, variant, steps)
            error = np.nan if last is None else float(np.max(np.abs(last["x"] - best)))
            # A run that ends anywhere near the reference is stable; a tenth of the radius is not near.
            sound = error < 0.1
            table["x"].append(error if sound else np.nan)
            for kept in ("area", "length"):
                table[kept].append(abs(last[kept]) if sound else np.nan)
        # stable from some number of steps on: the first that no larger one contradicts
        broken = [steps for steps, error in zip(sizes, table["x"], strict=True) if np.isnan(error)]
        stable = [steps for steps in sizes if steps > max(broken, default=0)]
        table["largest stable step"] = t_end / stable[0] if stable else np.nan
        found[variant] = table
    return found


def with_adaptive_steps(scene, t_end, variants, tolerance=1e-4, calls=10):
    """{variant: {status, t, steps, rejected, area, length}} of a run with controlled steps."""
    found = {}
    for variant in variants:
        projection, cut = VARIANTS[variant]
        times = t_end * np.arange(1, calls + 1) / calls
        method = Adaptive(tolerance, projection=projection, max_steps=3000)
        state, rows, equation = march(scene, method, times, filter=_filter(cut), checks=_ALL)
        rows = {key: row[~np.isnan(rows["t"])] for key, row in rows.items()}
        area = rows["area"][:, 0] / equation.area[0] - 1
        length = rows["length"][:, 0] / (2 * np.pi * equation.speed[0]) - 1
        found[variant] = {
            "status": status.WORDS[max(int(state.status), status.COMPLETE)],
            "t": float(state.t),
            "steps": int(state.steps),
            "rejected": int(state.rejected),
            "area": float(np.max(np.abs(area))) if len(area) else np.nan,
            "length": float(np.max(np.abs(length))) if len(area) else np.nan,
        }
    return found


def ended(scene, tolerance, t_end, saves=6, **options):
    """Returns the status, and the rows until the end."""
    times = t_end * np.arange(1, saves + 1) / saves
    method = Adaptive(tolerance, max_steps=3000)
    state, rows, _ = march(scene, method, times, checks=_ALL, **options)
    kept = ~np.isnan(rows["t"])
    return status.WORDS[max(int(state.status), status.COMPLETE)], {name: row[kept] for name, row in rows.items()}


def errors(scene, t_end, best, without):
    """{with, without: {status, t, shape, V_m, tension}}: how far from the rows `best` at the last common instant.

    `without` holds the options of the equation by which the safeguard is left out.
    """
    found = {}
    for name, options in (("with", {}), ("without", without)):
        word, rows = ended(scene, 1e-5, t_end, **options)
        n = min(len(rows["t"]), len(best["t"]))
        apart = distances({key: row[:n] for key, row in rows.items()}, {key: row[:n] for key, row in best.items()})
        neck = float(rows["self_gap"][n - 1, 0] / (2 * np.pi / scene.x.shape[1]))
        found[name] = {"status": word, "t": float(rows["t"][n - 1]), "neck": neck}
        found[name] |= {key: float(error[-1]) for key, error in apart.items()}
    return found


def bud(N):
    """Returns a vesicle with Δ = 0.5 at β = 16."""
    return pop(N, reduced_area=0.5, beta=16.0)


def in_necks(sizes, reference=192, t_end=0.18):
    """Returns {nodes: errors} of a bud with and without finer kernels."""
    if not sizes:
        return {}
    _, best = ended(bud(reference), 1e-6, t_end)
    return {N: errors(bud(N), t_end, best, {"refinement": Refinement((1,))}) for N in sizes}


# scene, end, nodes, and those of the finer run
SYMMETRIC = {
    "budding at β = 16": (bud, 0.3, 256, 192),
    "treading at Δ = 0.6, Λ = 0.1": (Setting(0.6, 0.1, 6.4, 10.0).scene, 4.0, 96, 144),
}


def of_symmetric(names):
    """Returns {scene: errors} with and without kept symmetry."""
    found = {}
    for name in names:
        make, t_end, N, reference = SYMMETRIC[name]
        _, best = ended(make(reference), 1e-6, t_end)
        found[name] = errors(make(N), t_end, best, {"keep_symmetry": False})
    return found


def at_the_edge(tolerances, N=96, t_end=20.0, saves=100):
    """{tolerance: {watched, plain: steps, and of the second half of steady treading in shear the noise}}."""
    scene = make_scene(shapes.ellipse(N, 0.7, angle=jnp.deg2rad(20.0)), flow=Shear(10.0))
    times = t_end * np.arange(1, saves + 1) / saves
    found = {}
    for tolerance in tolerances:
        found[tolerance] = {}
        for name, method in (("watched", Adaptive(tolerance)), ("plain", Adaptive(tolerance, edge_weight=0.0))):
            state, rows, _ = march(scene, method, times, checks=_ALL)
            late = {key: row[saves // 2 :, 0] for key, row in rows.items() if row.ndim > 1}
            found[tolerance][name] = {
                "steps": int(state.steps) + int(state.rejected),
                "viscosity": float(np.ptp(rows["effective_viscosity"][saves // 2 :])),
                "inclination": float(np.ptp(late["inclination"])),
                "spacing": float(np.max(late["metric_error"])),
                "tail": float(np.max(late["spectral_tail"])),
            }
    return found


def run(
    scenes=tuple(SCENES),
    variants=tuple(VARIANTS),
    N=64,
    sizes=(10, 15, 20, 25, 30, 40, 50, 60, 80, 120, 240),
    reference=640,
    pop_end=1.0,
    bud_end=0.15,
    bud_nodes=128,
    controlled=("POP", "budding"),
    necks=(64, 96, 128),
    edge=(1e-3, 1e-4, 1e-5, 1e-6),
    symmetric=tuple(SYMMETRIC),
):
    """Returns the tables: fixed steps, adaptive steps, finer kernels, weighted modes, symmetries."""
    runs = {"POP": (pop(N), pop_end), "budding": (pop(bud_nodes, reduced_area=0.5, beta=12.8), bud_end)}
    return {
        "fixed": {name: with_fixed_steps(name, variants, N, sizes, reference) for name in scenes},
        "adaptive": {name: with_adaptive_steps(*runs[name], variants) for name in controlled},
        "necks": in_necks(necks),
        "edge": at_the_edge(edge),
        "symmetric": of_symmetric(symmetric),
    }


@styled
def draw(found) -> Figure:
    """Draws errors in x and in length against the number of steps, one row per scene."""
    figure = Figure(figsize=(run_plots.PAGE, 2.2 * len(found["fixed"])))
    panels = np.atleast_2d(figure.subplots(len(found["fixed"]), 2))
    for row, (name, variants) in zip(panels, found["fixed"].items(), strict=True):
        for (variant, table), style in zip(variants.items(), ("-o", "-s", "--^", "--v"), strict=False):
            row[0].loglog(table["steps"], table["x"], style, ms=3, label=variant)
            row[1].loglog(table["steps"], np.maximum(table["length"], 1e-16), style, ms=3)
        for axes in row:
            axes.set_xticks((10, 20, 40, 80, 160), ["10", "20", "40", "80", "160"])
            axes.minorticks_off()
        row[0].set(title=name, xlabel="steps", ylabel="largest error in $x$")
        row[1].set(title=name, xlabel="steps", ylabel="relative error of the length")
    panels[0, 0].legend()
    return figure


def main():
    found = run()
    for name, variants in found["fixed"].items():
        print(f"{name}: error of x (area, length) by number of steps; -- broke down")
        for variant, table in variants.items():
            print(f"  {variant:14} largest stable step {table['largest stable step']:.2e}")
            for steps, x, area, length in zip(*(table[k] for k in ("steps", "x", "area", "length")), strict=True):
                print(f"    {steps:4d}  " + ("--" if np.isnan(x) else f"{x:.1e}  ({area:.0e}, {length:.0e})"))
    for name, variants in found["adaptive"].items():
        print(f"{name}, tolerance 1e-4")
        for variant, row in variants.items():
            print(
                f"  {variant:14} {row['status']:15} t = {row['t']:.3f}  {row['steps']}+{row['rejected']} steps"
                f"  area {row['area']:.0e}  length {row['length']:.0e}"
            )
    compared = {f"budding at β = 16 with {N} nodes, finer kernels": row for N, row in found["necks"].items()}
    compared |= {f"{name}, its symmetry": row for name, row in found["symmetric"].items()}
    for name, variants in compared.items():
        print(name)
        for variant, row in variants.items():
            print(
                f"  {variant:8} {row['status']:12} at t = {row['t']:.3f}, neck {row['neck']:.2f} h,"
                f" errors: shape {row['shape']:.1e}, V_m {row['V_m']:.1e}, tension {row['tension']:.1e}"
            )
    for tolerance, variants in found["edge"].items():
        print(f"treading in shear at tolerance {tolerance:g}")
        for variant, row in variants.items():
            print(
                f"  {variant:8} {row['steps']} steps, once settled [μ] moves by {row['viscosity']:.1e}, the inclination"
                f" by {row['inclination']:.1e}, nodes are spaced to {row['spacing']:.1e}, tail {row['tail']:.1e}"
            )
    store("safeguards", found)
    save(draw(found), "safeguards")


if __name__ == "__main__":
    main()
