"""Which numbers can another code be compared with, to how many digits, and what does this accuracy cost?

    python -m experiments.benchmarks              # writes benchmarks/*.csv and benchmarks.h5, prints the table
    python -m experiments.benchmarks pop shear    # only these scenes

The scenes are defined completely in the headers of their files. The data are time series of integrals over the
membrane, which do not depend on the positions of the nodes. Each scene is computed twice, with different nodes,
tolerances and methods. The stated digits are those in which the two agree at every saved time, relative to the largest
value of the column. `benchmarks/check.py` compares the data of another code with them, and needs NumPy only.

What to expect: eight digits and more in shear, POP and relaxation. Seven for the pair, which amplifies differences.
Four or five for the bud, because its elliptic start has modes that would need many more nodes.
"""

import argparse
import csv
import functools
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import h5py
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg

import jaxves
from jaxves.base import compiling, status
from jaxves.geometry import shapes
from jaxves.geometry.domain import Cell
from jaxves.observables.checks import Checks
from jaxves.operators.sums import AbstractCoupling, accuracy_of_sums, coupling_in_cell, residual_of_systems
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.physics.waveform import AC
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate
from jaxves.stepping.schemes import ARK4, ARK5

from ._common import HERE, interleaved, medians, pop, store, treading

FOLDER = Path(__file__).parents[1] / "benchmarks"
EACH = ("deformation", "inclination", "bending_energy", "tank_treading_speed", "dipole", "center")
RUN = ("effective_viscosity", "dissipation", "relative_viscosity", "normal_stress_difference", "effective_conductivity")
_FEW = 4  # with more vesicles the columns are those of the whole run only
QUICK = dict(scenes=("relaxation",), share=0.1, tolerances=(1e-3,), repeats=1)


class Case(NamedTuple):
    """Nodes and tolerance of one run."""

    N: int
    tolerance: float


class Benchmark(NamedTuple):
    """A scene by its number of nodes, when it ends, how often it is saved; the two runs to agree, of orders 4 and 5.

    `nodes` and `tolerances` are those for which the table states error and cost. `cell` says that there is a periodic
    cell.
    """

    make: Callable[[int], Scene]
    about: str
    t_end: float
    saves: int
    check: Case
    best: Case
    nodes: int = 64
    tolerances: tuple[float, ...] = (1e-4, 1e-6)
    cell: bool = False


def _budding(N):
    return pop(N, reduced_area=0.5, beta=12.8)


def _shear(N):
    return make_scene(shapes.ellipse(N, 0.9), flow=Shear(10.0))


def _relaxation(N):
    return make_scene(shapes.ellipse(N, 0.7))


def _pair(N):
    half = 1.3 * np.array([np.cos(np.deg2rad(20)), np.sin(np.deg2rad(20))])
    x = shapes.ellipse(N, 0.9, angle=jnp.pi / 2)
    field = dc_field(3.2, conductivity_ratio=0.5, vesicles=2)
    return make_scene([x, x], centers=[half, -half], field=field)


def _tumbling(N):
    return make_scene(shapes.ellipse(N, 0.9), flow=Shear(10.0), viscosity_ratio=10.0)


def _charge(N):
    field = dc_field(3.2, conductivity_ratio=0.1, charge_relaxation=0.01, permittivity_ratio=0.5)
    return make_scene(shapes.ellipse(N, 0.9, angle=jnp.pi / 2), field=field)


def _alternating(N):
    field = dc_field(6.4, conductivity_ratio=0.3, history=AC(10.0))
    return make_scene(shapes.ellipse(N, 0.9, angle=jnp.pi / 2), field=field)


def _cell(N):
    x = shapes.ellipse(N, 0.9, angle=jnp.pi / 2)
    field = dc_field(3.2, conductivity_ratio=0.5)
    cell = Cell.of([[4.0, 0.0], [0.0, 4.0]])
    return make_scene([x, x], centers=[[0.0, 0.0], [2.1, 1.5]], field=field, flow=Shear(5.0), cell=cell)


def wrinkled(count: int) -> np.ndarray:
    """Returns points (count, 2) of an upright curve with fourteen small waves."""
    angle = 2 * np.pi * np.arange(count) / count
    radius = 1 - 0.2 * np.cos(2 * angle) + 1e-3 * np.cos(14 * angle)
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _wrinkles(N):
    field = dc_field(80.0, conductivity_ratio=0.1)
    return make_scene(shapes.scaled(shapes.equispaced(jnp.asarray(wrinkled(4 * N)), N), 1.0), field=field)


def suspended() -> list[tuple[float, list[float]]]:
    """Returns the angles in degrees and the centres of 32 vesicles."""
    places = [(j // 8, j % 8) for j in range(32)]
    centers = [[2.8 * (column + 0.5 * (row % 2)), 2.8 * row] for row, column in places]
    return [(37.0 * j, center) for j, center in enumerate(centers)]


def _suspension(N):
    angles, centers = zip(*suspended(), strict=True)
    curves = [shapes.ellipse(N, 0.9, angle=np.deg2rad(angle)) for angle in angles]
    cell = Cell.of([[22.4, 0.0], [0.0, 11.2]])
    return make_scene(curves, centers=centers, flow=Shear(5.0), cell=cell)


_ELLIPSE = "ellipse of perimeter 2 pi"
_FIELD = "field along y, chi = 0.08"
BENCHMARKS = {
    "pop": Benchmark(
        pop, f"{_ELLIPSE}, Delta = 0.9, along the {_FIELD}, beta = 3.2, Lambda = 0.1, G = 0",
        1.0, 20, Case(112, 1e-9), Case(128, 1e-10),
    ),
    "budding": Benchmark(
        _budding, f"{_ELLIPSE}, Delta = 0.5, along the {_FIELD}, beta = 12.8, Lambda = 0.1, G = 0",
        0.22, 22, Case(160, 1e-6), Case(192, 1e-7), 128,
    ),
    "shear": Benchmark(
        _shear, f"{_ELLIPSE}, Delta = 0.9, along x in shear, Ca = 10, no field",
        1.0, 20, Case(80, 1e-7), Case(96, 1e-9),
    ),
    "sheared_field": Benchmark(
        treading, f"{_ELLIPSE}, Delta = 0.9, 20 degrees from x, shear, Ca = 10, {_FIELD}, beta = 6.4, "
        "Lambda = 0.1, G = 4",
        0.5, 20, Case(80, 1e-9), Case(96, 1e-10),
    ),
    "circulation": Benchmark(
        _pair, f"two: {_ELLIPSE}, Delta = 0.9, along y, centres 2.6 apart at 20 degrees from x, {_FIELD}, beta = 3.2, "
        "Lambda = 0.5, G = 0",
        1.0, 10, Case(80, 1e-8), Case(96, 1e-9),
    ),
    "relaxation": Benchmark(
        _relaxation, f"{_ELLIPSE}, Delta = 0.7, major axis along x, neither field nor flow",
        1.0, 20, Case(112, 1e-9), Case(128, 1e-10),
    ),
    "tumbling": Benchmark(
        _tumbling, f"{_ELLIPSE}, Delta = 0.9, along x in shear, Ca = 10, viscosity inside 10 times that outside",
        1.0, 20, Case(112, 1e-9), Case(128, 1e-10),
    ),
    "charge": Benchmark(
        _charge, f"{_ELLIPSE}, Delta = 0.9, along the {_FIELD}, beta = 3.2, Lambda = 0.1, G = 0, delta = 0.01, "
        "permittivity inside 0.5 times that outside, no charge at the start",
        1.0, 20, Case(112, 1e-8), Case(128, 1e-9),
    ),
    "alternating": Benchmark(
        _alternating, f"{_ELLIPSE}, Delta = 0.9, along the {_FIELD}, multiplied by cos(2 pi 10 t), beta = 6.4, "
        "Lambda = 0.3, G = 0",
        0.5, 40, Case(112, 1e-8), Case(128, 1e-9),
    ),
    "cell": Benchmark(
        _cell, f"two: {_ELLIPSE}, Delta = 0.9, along y, centres (0, 0) and (2.1, 1.5), in a square cell of side 4 that "
        f"shear carries along, Ca = 5, mean {_FIELD}, beta = 3.2, Lambda = 0.5, G = 0",
        0.5, 20, Case(80, 1e-7), Case(96, 1e-8), cell=True,
    ),
    "wrinkles": Benchmark(
        _wrinkles, f"r(phi) proportional to 1 - 0.2 cos 2 phi + 0.001 cos 14 phi, perimeter 2 pi, {_FIELD}, "
        "beta = 80, Lambda = 0.1, G = 0",
        0.006, 20, Case(224, 1e-9), Case(256, 1e-10), 192,
    ),
    "suspension": Benchmark(
        _suspension, f"32: {_ELLIPSE}, Delta = 0.9, number j = 0 ... 31 turned by 37 j degrees from x, centre at "
        "2.8 (c + (r mod 2)/2, r) with j = 8 r + c, in a cell of 22.4 by 11.2 that shear carries along, "
        "Ca = 5, no field",
        0.4, 16, Case(48, 1e-5), Case(64, 1e-6), 32, (1e-4,), cell=True,
    ),
}  # fmt: skip


def _coupling(name: str, tolerance: float) -> AbstractCoupling | None:
    """Returns the sums of a scene in a cell, as exact as a run with this tolerance has them; None for other scenes."""
    if not BENCHMARKS[name].cell:
        return None
    return coupling_in_cell(accuracy=accuracy_of_sums(tolerance), solved=residual_of_systems(tolerance))


@functools.cache
def _compiled(name: str, N: int, fifth: bool, saves: int, coupling: AbstractCoupling | None):
    """Returns the compiled run of a scene as a function of tolerance and end."""
    setting = BENCHMARKS[name].make(N)
    # Judged by their agreement: an early end for a coarse tail would hide what it costs.
    checks = Checks(tail=np.inf)

    @eqx.filter_jit
    def run(tolerance, t_end):
        march = Adaptive(tolerance, ARK5() if fifth else ARK4())
        result = simulate(setting, t_end, saves=saves, march=march, checks=checks, coupling=coupling)
        kept = {key: result.diagnostics[key] for key in (*EACH, *RUN) if key in result.diagnostics}
        return result.t, kept, result.status, result.state.steps

    return run


def columns(name: str, case: Case, *, fifth: bool, share=1.0) -> tuple[dict[str, np.ndarray], int]:
    """Returns time series by column name, over the first `share` of the saved times, and the steps.

    Raises:
        RuntimeError: the run is not complete.
    """
    benchmark = BENCHMARKS[name]
    saves = max(1, round(share * benchmark.saves))
    end = benchmark.t_end * saves / benchmark.saves
    run = _compiled(name, case.N, fifth, saves, _coupling(name, case.tolerance))
    t, kept, code, steps = run(jnp.asarray(case.tolerance), jnp.asarray(end))
    if int(code) != status.COMPLETE:
        raise RuntimeError(f"benchmark {name}, {case}: {status.WORDS[int(code)]}")
    return series(t, kept), int(steps)


def series(t, diagnostics) -> dict[str, np.ndarray]:
    """Returns the columns of a benchmark from the diagnostics of a run that starts at t = 0."""
    # The start is the ellipse itself, whose forces converge slowly at its tips; after the first save they are smooth.
    out = {"t": np.asarray(t)[1:]}
    for key in sorted((*EACH, *RUN)):
        if key not in diagnostics:
            continue
        values = np.asarray(diagnostics[key])[1:]
        if key in EACH and values.shape[1] > _FEW:
            continue
        if key == "inclination":
            values = np.unwrap(values, period=np.pi, axis=0)
        # A vesicle along an axis has an inclination and a speed of round-off only: no digits to agree in.
        if np.max(np.abs(values)) < 1e-6 or (key == "inclination" and np.ptp(np.sin(2 * values)) < 1e-6):
            continue
        flat = values.reshape(len(values), -1)
        last = "xy" if key in ("dipole", "center") else ("",)
        vesicles = flat.shape[1] // len(last)
        labels = [
            "_".join(part for part in (key, str(m + 1) if vesicles > 1 else "", axis) if part)
            for m in range(vesicles)
            for axis in last
        ]
        kept_columns = np.max(np.abs(flat), axis=0) > 1e-6
        out |= {label: flat[:, i] for i, label in enumerate(labels) if kept_columns[i]}
    return out


def differences(found, best) -> dict[str, float]:
    """Returns, by column, the largest difference in time divided by the largest value of both."""
    return {
        key: float(np.max(np.abs(found[key] - best[key])) / np.max(np.abs(best[key])))
        for key in best
        if key in found and key != "t"
    }


def digits(difference: float) -> int:
    """Returns the number of decimal digits in which two runs agree."""
    return int(np.floor(-np.log10(max(difference, 1e-16))))


def cost(name: str, best, tolerances, repeats, share=1.0) -> list[dict[str, float]]:
    """Returns error, steps and run time, in LU factorisations of 192 unknowns, for each tolerance."""
    benchmark = BENCHMARKS[name]
    nodes = benchmark.nodes
    saves = max(1, round(share * benchmark.saves))
    end = jnp.asarray(benchmark.t_end * saves / benchmark.saves)
    matrix = np.random.default_rng(0).normal(size=(192, 192)) + 20 * np.eye(192)
    rows = []
    for tolerance in tolerances:
        found, steps = columns(name, Case(nodes, tolerance), fifth=False, share=share)
        run = _compiled(name, nodes, False, saves, _coupling(name, tolerance))
        calls = {
            "run": lambda run=run, tolerance=tolerance: run(jnp.asarray(tolerance), end),
            "LU": lambda: scipy.linalg.lu_factor(matrix, check_finite=False),
        }
        seconds = medians(interleaved(calls, repeats))
        error = max(differences(found, best).values())
        rows.append({
            "tolerance": tolerance, "nodes": nodes, "error": error, "steps": steps,
            "LUs": seconds["run"] / seconds["LU"], "seconds": seconds["run"],
        })  # fmt: skip
    return rows


def one(name: str, share=1.0, tolerances=None, repeats=3) -> dict:
    """Returns the best run of a scene, its agreement with the other run, and the cost of an error."""
    benchmark = BENCHMARKS[name]
    best, steps = columns(name, benchmark.best, fifth=True, share=share)
    check, _ = columns(name, benchmark.check, fifth=False, share=share)
    agreement = differences(check, best)
    jax.clear_caches()
    table = cost(name, best, tolerances or benchmark.tolerances, repeats, share)
    return {"columns": best, "agreement": agreement, "steps": steps, "cost": table}


def run(scenes=tuple(BENCHMARKS), share=1.0, tolerances=None, repeats=3) -> dict:
    """Returns the results by scene."""
    return {name: one(name, share, tolerances, repeats) for name in scenes}


def write(name: str, found: dict) -> None:
    """Writes benchmarks/NAME.csv, and the same data as a group of benchmarks.h5."""
    benchmark, best = BENCHMARKS[name], found["columns"]
    kept = ["t", *found["agreement"]]
    stated = {key: digits(value) for key, value in found["agreement"].items()}
    about = f"{name}: {benchmark.about}"
    how = f"jaxves {jaxves.__version__}; N = {benchmark.best.N}, ARK5, tolerance {benchmark.best.tolerance:.0e}"
    against = f"agreement with N = {benchmark.check.N}, ARK4, tolerance {benchmark.check.tolerance:.0e}, in digits"
    FOLDER.mkdir(exist_ok=True)
    with (FOLDER / f"{name}.csv").open("w", newline="") as file:
        file.write(f"# {about}\n# {how}\n# {against}: " + ", ".join(f"{k} {v}" for k, v in stated.items()) + "\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(kept)
        writer.writerows([f"{best[key][i]:.12g}" for key in kept] for i in range(len(best["t"])))
    with h5py.File(FOLDER / "benchmarks.h5", "a") as file:
        if name in file:
            del file[name]
        group = file.create_group(name)
        group.attrs["about"], group.attrs["computed"], group.attrs["checked"] = about, how, against
        for key in kept:
            group[key] = best[key]
            if key in stated:
                group[key].attrs["digits"] = stated[key]


def read(name: str) -> tuple[dict[str, np.ndarray], dict[str, int]]:
    """Returns the columns of benchmarks/NAME.csv, and the digits of each."""
    lines = (FOLDER / f"{name}.csv").read_text().splitlines()
    stated = lines[2].partition(": ")[2].split(", ")
    rows = list(csv.reader(lines[3:]))
    table = np.array(rows[1:], dtype=float)
    return dict(zip(rows[0], table.T, strict=True)), {k: int(v) for k, v in (item.split() for item in stated)}


def main():
    compiling.fast_start()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", help=f"names among {', '.join(BENCHMARKS)}; all by default")
    names = parser.parse_args().scenes or list(BENCHMARKS)
    if unknown := set(names) - set(BENCHMARKS):
        parser.error(f"scenes {sorted(unknown)}, expected names among {', '.join(BENCHMARKS)}")
    data = HERE / "data" / "benchmarks.json"
    kept = json.loads(data.read_text())["data"] if data.exists() else {}
    for name in names:
        case = one(name)
        write(name, case)
        least = max(case["agreement"], key=case["agreement"].get)
        print(f"{name}: {case['steps']} steps; least agreement {case['agreement'][least]:.1e} in {least}")
        for row in case["cost"]:
            print(
                f"  N = {row['nodes']}, tolerance {row['tolerance']:.0e}: error {row['error']:.1e}, "
                f"{row['steps']} steps, {row['LUs']:.0f} LU",
                flush=True,
            )
        kept[name] = {key: case[key] for key in ("agreement", "steps", "cost")}
        store("benchmarks", kept)
    _pack()


def _pack() -> None:
    """Writes benchmarks.h5 once more, because HDF5 does not give back the room of groups that were replaced."""
    path = FOLDER / "benchmarks.h5"
    with tempfile.TemporaryDirectory(dir=FOLDER) as folder:
        part = Path(folder) / path.name
        with h5py.File(path) as file, h5py.File(part, "w") as packed:
            for name in BENCHMARKS:
                file.copy(name, packed)
        os.replace(part, path)


if __name__ == "__main__":
    main()
