"""Which numbers can another code be compared with, to how many digits, and what does this accuracy cost?

    python -m experiments.benchmarks          # writes benchmarks/*.csv and benchmarks.h5, prints the table, six minutes

Six scenes are defined completely in the headers of their files. The data are time series of integrals over the
membrane, which do not depend on the positions of the nodes. Each scene is computed twice, with different nodes,
tolerances and methods. The stated digits are those in which the two agree at every saved time, relative to the largest
value of the column.

What to expect: eight digits and more in shear, POP and relaxation. Seven for the pair, which amplifies differences.
Four or five for the bud, because its elliptic start has modes that would need many more nodes.
"""

import csv
import functools
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
from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.observables.checks import Checks
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate
from jaxves.stepping.schemes import ARK4, ARK5

from ._common import interleaved, medians, pop, store, treading

FOLDER = Path(__file__).parents[1] / "benchmarks"
EACH = ("deformation", "inclination", "bending_energy", "tank_treading_speed", "dipole", "center")
RUN = ("effective_viscosity", "dissipation")
QUICK = dict(scenes=("relaxation",), share=0.1, tolerances=(1e-3,), repeats=1)


class Case(NamedTuple):
    """Nodes and tolerance of one run."""

    N: int
    tolerance: float


class Benchmark(NamedTuple):
    """A scene by its number of nodes, when it ends, how often it is saved; the two runs to agree, of orders 4 and 5."""

    make: Callable[[int], Scene]
    about: str
    t_end: float
    saves: int
    check: Case
    best: Case


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


_ELLIPSE = "ellipse of perimeter 2 pi"
_FIELD = "field along y, chi = 0.08"
BENCHMARKS = {
    "pop": Benchmark(
        pop, f"{_ELLIPSE}, Delta = 0.9, along the {_FIELD}, beta = 3.2, Lambda = 0.1, G = 0",
        1.0, 20, Case(112, 1e-9), Case(128, 1e-10),
    ),
    "budding": Benchmark(
        _budding, f"{_ELLIPSE}, Delta = 0.5, along the {_FIELD}, beta = 12.8, Lambda = 0.1, G = 0",
        0.22, 22, Case(160, 1e-6), Case(192, 1e-7),
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
}  # fmt: skip


@functools.cache
def _compiled(name: str, N: int, fifth: bool, saves: int):
    """Returns the compiled run of a scene as a function of tolerance and end."""
    setting = BENCHMARKS[name].make(N)
    # Judged by their agreement: an early end for a coarse tail would hide what it costs.
    checks = Checks(tail=np.inf)

    @eqx.filter_jit
    def run(tolerance, t_end):
        march = Adaptive(tolerance, ARK5() if fifth else ARK4())
        result = simulate(setting, t_end, saves=saves, march=march, checks=checks)
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
    t, kept, code, steps = _compiled(name, case.N, fifth, saves)(jnp.asarray(case.tolerance), jnp.asarray(end))
    if int(code) != status.COMPLETE:
        raise RuntimeError(f"benchmark {name}, {case}: {status.WORDS[int(code)]}")
    # The start is the ellipse itself, whose forces converge slowly at its tips; after the first save they are smooth.
    out = {"t": np.asarray(t)[1:]}
    for key, values in kept.items():
        values = np.asarray(values)[1:]
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
    return out, int(steps)


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


def cost(name: str, best, tolerances, repeats, share=1.0, N=None) -> list[dict[str, float]]:
    """Returns error, steps and run time, in LU factorisations of 192 unknowns, for each tolerance."""
    benchmark = BENCHMARKS[name]
    nodes = N or (128 if name == "budding" else 64)
    saves = max(1, round(share * benchmark.saves))
    end = jnp.asarray(benchmark.t_end * saves / benchmark.saves)
    run = _compiled(name, nodes, False, saves)
    matrix = np.random.default_rng(0).normal(size=(192, 192)) + 20 * np.eye(192)
    rows = []
    for tolerance in tolerances:
        found, steps = columns(name, Case(nodes, tolerance), fifth=False, share=share)
        calls = {
            "run": lambda tolerance=tolerance: run(jnp.asarray(tolerance), end),
            "LU": lambda: scipy.linalg.lu_factor(matrix, check_finite=False),
        }
        seconds = medians(interleaved(calls, repeats))
        error = max(differences(found, best).values())
        rows.append({
            "tolerance": tolerance, "nodes": nodes, "error": error, "steps": steps,
            "LUs": seconds["run"] / seconds["LU"], "seconds": seconds["run"],
        })  # fmt: skip
    return rows


def one(name: str, share=1.0, tolerances=(1e-4, 1e-6), repeats=3) -> dict:
    """Returns the best run of a scene, its agreement with the other run, and the cost of an error."""
    benchmark = BENCHMARKS[name]
    best, steps = columns(name, benchmark.best, fifth=True, share=share)
    check, _ = columns(name, benchmark.check, fifth=False, share=share)
    agreement = differences(check, best)
    jax.clear_caches()
    table = cost(name, best, tolerances, repeats, share)
    return {"columns": best, "agreement": agreement, "steps": steps, "cost": table}


def run(scenes=tuple(BENCHMARKS), share=1.0, tolerances=(1e-4, 1e-6), repeats=3) -> dict:
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
    found = run()
    (FOLDER / "benchmarks.h5").unlink(missing_ok=True)  # HDF5 does not give back what a group had
    for name, case in found.items():
        write(name, case)
        least = min(case["agreement"], key=lambda key: -case["agreement"][key])
        print(f"{name}: {case['steps']} steps; least agreement {case['agreement'][least]:.1e} in {least}")
        for row in case["cost"]:
            print(
                f"  N = {row['nodes']}, tolerance {row['tolerance']:.0e}: error {row['error']:.1e}, "
                f"{row['steps']} steps, {row['LUs']:.0f} LU"
            )
    store("benchmarks", {name: {k: case[k] for k in ("agreement", "steps", "cost")} for name, case in found.items()})


if __name__ == "__main__":
    main()
