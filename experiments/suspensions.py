"""What do suspensions of vesicles do in shear and in a field?

    python -m experiments.suspensions            # shear, and a field: tables and a figure, 17 minutes
    python -m experiments.suspensions --dense    # a denser one in shear and a field at once, 10 minutes
    python -m experiments.suspensions --contrast # viscosity and iterations for inner viscosities, 6 minutes

All vesicles have Δ = 0.9 and are put at random places and angles in a periodic square cell. In shear without a field
(Ca = 10), the viscosity of the suspension is averaged over the strain after the first third. Its statistical error is
that of the means of four equal parts. It is compared with the dilute value, 1 + φ [μ], where [μ] is that of one vesicle
in the plane. In a constant field without shear, chains and the effective conductivity are followed for the membrane
conductances G = 0 and G = 1.

What to expect: the viscosity exceeds the dilute value by more the larger φ is. Membranes charge, which lowers the
conductivity. With G = 0 vesicles then become prolate along the field and form chains, so that the conductivity rises.
With G = 1 they become oblate, and it hardly changes.

With another viscosity inside (`--contrast`), the viscosity of the suspension is compared with the dilute value of the
same viscosity ratio ν. F has one linear system for all velocities and tensions, which the factors of the single
vesicles precondition. Its iterations of GMRES are counted for random suspensions.
"""

import argparse
import tempfile
import time
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import jaxves
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell
from jaxves.geometry.placement import random_suspension
from jaxves.observables.certificate import certificate
from jaxves.observables.chains import chains
from jaxves.operators.sums import accuracy_of_sums, coupling_in_cell, residual_of_systems
from jaxves.physics.flow import Shear
from jaxves.physics.scene import make_scene
from jaxves.plots import run_plots
from jaxves.plots.cell_plots import suspension

from ._common import save, store, styled
from .shear import steady

REDUCED_AREA = 0.9
CAPILLARY_NUMBER = 10.0
FIELD = {"beta": 6.4, "conductivity_ratio": 0.1}
REACH = 2.2  # distance of centres of bound vesicles; two that touch side by side or end to end are 1.4 and 2.5 apart
PARTS = 4
INTRINSIC = {0.1: 1.922, 1.0: 1.779, 10.0: 1.814, 100.0: 1.986}  # [μ] of one vesicle by ν (`viscosity_contrast`)
QUICK_CONTRAST = dict(ratios=(5.0,), sizes=(2,), count=2, N=32, strain=0.2, saves=6, tolerance=1e-2)
QUICK = dict(fractions=((0.1, 2),), conductances=(1.0,), M=2, N=32, strain=0.3, t_end=0.02, saves=6, tolerance=1e-2)


def scene(fraction: float, count: int, N: int, t_end: float, saves: int, tolerance: float, **tables) -> dict:
    """Returns the tables of a scene file for a suspension, a random one by default; `tables` are added or replaced."""
    side = float(np.sqrt(REDUCED_AREA * np.pi * count / fraction))
    return {
        "t_end": t_end,
        "saves": saves,
        "vesicle": [{"reduced_area": REDUCED_AREA}],
        "cell": {"lattice": [[side, 0.0], [0.0, side]]},
        "suspension": {"count": count, "seed": 1},
        "numerics": {"nodes": N, "tolerance": tolerance, "certify": False},
    } | tables


def record_of(tables: dict):
    """Runs a scene; returns its record, and the seconds of processor time with compilation."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5"
        start = time.process_time()
        jaxves.run(tables, path)
        return jaxves.load(path), time.process_time() - start


def quality(record) -> dict:
    """Returns how a run ended, its steps, and the least gap and the largest errors of what is conserved."""
    rows = record.diagnostics
    links = certificate(rows)
    return {
        "status": record.status,
        "steps": int(record.steps[-1]),
        "least gap": float(np.min(rows["min_gap"])),
        "area": links["area"].value,
        "length": links["length"].value,
        "energy": links["energy"].value,
        "force": links["force"].value,
        "residual": links["solves"].value,
    }


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Returns the mean after the first third, and its standard error from the means of equal parts."""
    late = values[len(values) // 3 :]
    means = [np.mean(part) for part in np.array_split(late, PARTS)]
    return float(np.mean(late)), float(np.std(means, ddof=1) / np.sqrt(PARTS))


def sheared(
    fraction: float, count: int, intrinsic: float, *, N: int, strain: float, saves: int, tolerance: float, **tables
):
    """Returns the viscosity of a suspension in shear and its last shapes; `tables` are added to its scene."""
    tables = tables | {"flow": {"kind": "shear", "capillary_number": CAPILLARY_NUMBER}}
    tables = scene(fraction, count, N, strain / CAPILLARY_NUMBER, saves, tolerance, **tables)
    record, seconds = record_of(tables)
    viscosity = record.diagnostics["relative_viscosity"]
    mean, error = mean_and_error(viscosity)
    row = {
        "fraction": fraction,
        "vesicles": count,
        "viscosity": mean,
        "error": error,
        "dilute": 1 + fraction * intrinsic,
        "seconds": seconds,
        "strain": CAPILLARY_NUMBER * record.t,
        "series": viscosity,
    }
    return row | quality(record), picture_of(record, tables, CAPILLARY_NUMBER)


def in_field(conductance: float, count: int, *, N: int, t_end: float, saves: int, tolerance: float):
    """Returns conductivity and chains of a suspension in a field, and its last shapes."""
    tables = scene(0.3, count, N, t_end, saves, tolerance, field=FIELD | {"membrane_conductance": conductance})
    record, seconds = record_of(tables)
    lattice = np.array(tables["cell"]["lattice"])
    lengths = [
        chains(centers, lattice, min(REACH, lattice[0, 0]), direction=(0, 1)).mean_length()
        for centers in record.diagnostics["center"]
    ]
    row = {
        "conductance": conductance,
        "vesicles": count,
        "seconds": seconds,
        "t": record.t,
        "conductivity": record.diagnostics["effective_conductivity"],
        "chain": lengths,
    }
    return row | quality(record), picture_of(record, tables, 0.0)


def picture_of(record, tables: dict, rate: float) -> dict:
    """Returns the shapes at the end and the vectors of the cell at that time."""
    lattice = np.array(tables["cell"]["lattice"])
    lean = rate * record.t[-1] * lattice[1, 1]
    lattice[1, 0] = lean - np.round(lean / lattice[0, 0]) * lattice[0, 0]
    return {"x": record.x[-1], "lattice": lattice}


@eqx.filter_jit
def _solved(scene, coupling):
    motion = equation_for(scene, coupling=coupling).motion(jnp.zeros(()), Unknowns.of(scene.x))
    return motion.iterations, motion.residual


def iterations(M: int, ratios, N: int, fraction=0.3) -> dict:
    """Returns the iterations of F for M vesicles in shear at a tolerance of 1e-4, by viscosity ratio; None: equal."""
    lattice = np.sqrt(REDUCED_AREA * np.pi * M / fraction) * np.eye(2)
    x = random_suspension(np.asarray(shapes.ellipse(N, REDUCED_AREA)), lattice, count=M, seed=0)
    coupling = coupling_in_cell(accuracy=accuracy_of_sums(1e-4), solved=residual_of_systems(1e-4))
    found = {}
    for ratio in (None, *ratios):
        cell = Cell.of(lattice)
        at = make_scene(list(x), flow=Shear(CAPILLARY_NUMBER), viscosity_ratio=ratio, cell=cell)
        found["equal" if ratio is None else str(ratio)] = int(_solved(at, coupling)[0])
    return found


def contrast(
    ratios=tuple(INTRINSIC), sizes=(2, 16, 64), fraction=0.2, count=6, N=48, strain=6.0, saves=60, tolerance=1e-3
) -> dict:
    """Returns the viscosity of a suspension by viscosity ratio, and iterations by number of vesicles and ratio."""
    how = dict(N=N, strain=strain, saves=saves, tolerance=tolerance)
    rows = []
    for ratio in ratios:
        row, _ = sheared(fraction, count, INTRINSIC.get(ratio, np.nan), fluid={"viscosity_ratio": ratio}, **how)
        rows.append({"ratio": ratio} | row)
    return {"rows": rows, "iterations": {M: iterations(M, ratios, N) for M in sizes}}


def dense(count=36, N=64, t_end=0.25, saves=50, tolerance=1e-3) -> dict:
    """Returns how a suspension with φ = 0.4 in shear and a field ends, and what it conserves.

    It starts on a lattice, with sizes that differ by 5 %. Random places leave films that 64 nodes do not resolve.
    """
    flow = {"kind": "shear", "capillary_number": CAPILLARY_NUMBER}
    field = FIELD | {"membrane_conductance": 1.0}
    start = {
        "vesicle": [{"reduced_area": REDUCED_AREA, "angle": 45.0}],
        "suspension": {"count": count, "seed": 1, "arrangement": "lattice", "size_spread": 0.05},
    }
    record, _ = record_of(scene(0.4, count, N, t_end, saves, tolerance, flow=flow, field=field, **start))
    return {"vesicles": count, "viscosity": record.diagnostics["relative_viscosity"]} | quality(record)


def run(
    fractions=((0.1, 12), (0.3, 12)),
    conductances=(0.0, 1.0),
    M=12,
    N=64,
    strain=6.0,
    t_end=1.0,
    saves=60,
    tolerance=1e-3,
) -> dict:
    """Returns the rows for shear and for a field, [μ] of one vesicle, and the last shapes of all suspensions."""
    how = dict(N=N, saves=saves, tolerance=tolerance)
    intrinsic = steady(REDUCED_AREA, max(N, 32), 1e-4, CAPILLARY_NUMBER, t_end=2.0)["viscosity"]
    in_shear = [sheared(*pair, intrinsic, strain=strain, **how) for pair in fractions]
    fields = [in_field(conductance, M, t_end=t_end, **how) for conductance in conductances]
    return {
        "intrinsic": intrinsic,
        "shear": [row for row, _ in in_shear],
        "field": [row for row, _ in fields],
        "pictures": [picture for _, picture in (*in_shear[-1:], *fields)],
    }


@styled
def draw(found) -> Figure:
    """Draws the suspensions at the end, and viscosity, conductivity and chains against time."""
    figure = Figure(figsize=(run_plots.PAGE, 4.8))
    above, below = figure.subplots(2, 3, height_ratios=(1.25, 1))
    titles = [f"shear, φ = {found['shear'][-1]['fraction']}"]
    titles += [f"field, φ = 0.3, G = {row['conductance']:g}" for row in found["field"]]
    for axes, title, picture in zip(above, titles, found["pictures"], strict=False):
        suspension(picture["x"], picture["lattice"], ax=axes)
        axes.set_title(title)
    for axes in above[len(titles) :]:
        axes.set_axis_off()
    for k, row in enumerate(found["shear"]):
        below[0].plot(row["strain"], row["series"], color=f"C{k}", label=f"φ = {row['fraction']}")
        below[0].axhline(row["dilute"], color=f"C{k}", ls=":", lw=0.8)
    below[0].set(xlabel="strain", title="viscosity; dotted: dilute")
    for k, row in enumerate(found["field"]):
        label = f"G = {row['conductance']:g}"
        below[1].plot(row["t"], row["conductivity"], color=f"C{k}", label=label)
        below[2].plot(row["t"], row["chain"], color=f"C{k}", label=label)
    below[1].set(xlabel="t", title=r"conductivity / $\sigma_e$")
    below[2].set(xlabel="t", title="vesicles in the chain of a vesicle")
    for axes in below:
        axes.legend(fontsize=6)
    return figure


def report(found) -> None:
    """Prints the tables."""
    print(f"[μ] of one vesicle: {found['intrinsic']:.4f}")
    for row in found["shear"]:
        print(
            f"φ = {row['fraction']}, {row['vesicles']} vesicles: viscosity {row['viscosity']:.4f} ± {row['error']:.4f},"
            f" dilute {row['dilute']:.4f}"
        )
    for row in found["field"]:
        print(
            f"G = {row['conductance']:g}: conductivity {row['conductivity'][0]:.4f} to {row['conductivity'][-1]:.4f},"
            f" chains {row['chain'][0]:.2f} to {row['chain'][-1]:.2f}"
        )
    for row in (*found["shear"], *found["field"]):
        print(quality_line(row))


def quality_line(row: dict) -> str:
    """Returns one line on how a run ended."""
    names = "least gap", "area", "length", "force", "energy", "residual"
    errors = ", ".join(f"{name} {row[name]:.1e}" for name in names)
    return f"{row['status']} after {row['steps']} steps: {errors}"


def main():
    parser = argparse.ArgumentParser(prog="python -m experiments.suspensions", description=__doc__.splitlines()[0])
    parser.add_argument("--dense", action="store_true", help="the denser suspension alone")
    parser.add_argument("--contrast", action="store_true", help="viscosities inside that differ")
    wanted = parser.parse_args()
    if wanted.contrast:
        found = contrast()
        for row in found["rows"]:
            print(f"ν = {row['ratio']:g}: {row['viscosity']:.4f} ± {row['error']:.4f}, dilute {row['dilute']:.4f}")
            print(f"{quality_line(row)}, {row['seconds']:.0f} s")
        for M, counts in found["iterations"].items():
            print(f"iterations of {M}: {counts}")
        store("suspensions", found, "contrast")
        return
    if wanted.dense:
        row = dense()
        print(quality_line(row))
        store("suspensions", row, "dense")
        return
    found = run()
    report(found)
    save(draw(found), "suspensions")
    store("suspensions", {name: found[name] for name in ("intrinsic", "shear", "field")})


if __name__ == "__main__":
    main()
