"""What does a step cost beside other codes of the same model, on one machine?

    python -m experiments.beside_others                           # a table, about two minutes
    python -m experiments.beside_others --elecvesicle FOLDER      # with a clone of ElecVesicle too; needs Octave

The scene is one vesicle in a field (POP: Δ = 0.9, β = 3.2, Λ = 0.1, G = 0), with one thread on one core. The codes
take turns, so that other work on the machine slows all of them equally. Results are medians of the seconds per step.

- `_plain` is the paper's first-order scheme in plain NumPy, written for this comparison. Its velocity is compared with
  that of jaxves for the same nodes and V_m, which shows that both compute the same.
- ElecVesicle is the public code of the paper's authors (https://github.com/bobbielf2/ElecVesicle, GPL), with
  first-order steps. It was written for MATLAB, which is not measured. It runs in Octave, which has no compiler.
  Drawing and writing of files are switched off in a temporary copy. Its tolerance for GMRES is the 1e-13 of its
  source.
- jaxves is measured with its first-order scheme and with its default fourth-order step.

Every code also makes 40 steps of 1e-3 from the start. Its deformation is compared with a run of jaxves with tolerance
1e-8 and the same number of nodes.

What to expect: the velocities agree to 1e-6 with 64 nodes and 1e-9 with 128 and 256. A first-order step of jaxves
takes 0.6 to 0.9 of the time of plain NumPy, a fourth-order step 1.3 to 1.8 times that time. With the same step the
errors of the first-order schemes are 2e-4 to 8e-4, and that of the fourth-order scheme is 2e-10.
"""

import os
import platform
import shutil
import subprocess
import tempfile
from functools import partial
from pathlib import Path
from typing import Annotated

import jax
import jax.numpy as jnp
import numpy as np
import scipy
import typer

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry.curve import Curve, deformation
from jaxves.numerics import fourier
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.schemes import ARK4, SemiImplicitEuler

from . import _plain
from ._common import interleaved, march, medians, pop, store
from .throughput import compiled, keep_freed_memory, linear_solve, step

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")  # read when JAX starts, at its first array

NUMBERS = _plain.Numbers(beta=3.2, chi=0.08, conductivity_ratio=0.1)
H, STEPS = 1e-3, 40
SCHEMES = {"jaxves, first order": SemiImplicitEuler(), "jaxves, fourth order": ARK4()}
QUICK = dict(sizes=(32,), repeats=3, rounds=1)


def _deformation(x) -> float:
    return float(jax.jit(lambda x: deformation(Curve.from_nodes(x), jnp.array([0.0, 1.0])))(jnp.asarray(x)))


def same_computation(N: int) -> float:
    """Largest difference of the velocities that jaxves and plain NumPy find, over the largest velocity.

    Compared at t = 0.05 of a run with 64 nodes, interpolated to N: the membrane is charged, the shape is no ellipse.
    """
    state, _, _ = march(pop(64), Adaptive(1e-6), [0.05])
    y = Unknowns.of(fourier.resample(state.y.x, N, axis=1), fourier.resample(state.y.V_m, N, axis=1))
    ours = np.asarray(jax.jit(lambda equation, y: equation.rate(jnp.zeros(()), y).x[0])(equation_for(pop(N)), y))
    x, V_m = (np.asarray(leaf[0]) for leaf in (y.x, y.V_m))
    plain = _plain.step(_plain.Grid(N), NUMBERS, x, V_m, 1e-11)[2]
    return float(np.abs(plain - ours).max() / np.abs(ours).max())


def plainly(N: int, x) -> np.ndarray:
    """Returns the nodes after 40 steps of the plain code."""
    grid, V_m = _plain.Grid(N), np.zeros(N)
    for _ in range(STEPS):
        x, V_m, _ = _plain.step(grid, NUMBERS, x, V_m, H)
    return x


_SUBMIT = """
mu = 1; shear = 0; T = {steps}; M = 1; N = {N}; tol = 1e-13;
kb = {chi}; dt = {h} / kb; Gm = 0; conduct_rat = {ratio}; E_infty = sqrt({beta}) * 1i;
nodes = dlmread('{nodes}'); x{{1}} = nodes(:, 1); y{{1}} = nodes(:, 2);
"""  # a = mu = C_m = sigma_e = epsilon = 1, so that kb is our χ, E² our β, and the unit of time χ t_κ

# Octave's own refuses empty vectors, which MATLAB's accepts.
_MESHGRID = """
function [xx, yy] = meshgrid(x, y)
  xx = repmat(x(:).', numel(y), 1); yy = repmat(y(:), 1, numel(x));
end
"""


def elecvesicle(folder: Path, x, steps: int) -> tuple[list[float], np.ndarray]:
    """Returns the seconds of each step of ElecVesicle except the first, and the nodes at the end."""
    with tempfile.TemporaryDirectory() as temporary:
        here = Path(temporary)
        for file in folder.glob("*.m"):
            shutil.copy(file, here)
        main = (folder / "Main.m").read_text()
        for old, new in (("function Main(", "function [Time, X, Y] = Main("), ("usePlot = 1", "usePlot = 0")):
            if old not in main:
                raise ValueError(f"{folder / 'Main.m'} has no {old!r}: expected the Main.m of ElecVesicle.")
            main = main.replace(old, new)
        (here / "Main.m").write_text(main)
        (here / "meshgrid.m").write_text(_MESHGRID)
        np.savetxt(here / "nodes.txt", np.vstack([x, x[:1]]), fmt="%.17g")
        numbers = dict(chi=NUMBERS.chi, beta=NUMBERS.beta, ratio=NUMBERS.conductivity_ratio, h=H)
        (here / "Ours.m").write_text(_SUBMIT.format(N=len(x), steps=steps, nodes=here / "nodes.txt", **numbers))
        script = (
            "[Time, X, Y] = Main('Ours.m'); dlmwrite('times.txt', Time, 'precision', 17);"
            "dlmwrite('end.txt', [X{2}{1}(1:end-1), Y{2}{1}(1:end-1)], 'precision', 17);"
        )
        command = ["octave-cli", "--no-gui", "--quiet", "--eval", script]
        subprocess.run(command, cwd=here, check=True, capture_output=True)
        return np.loadtxt(here / "times.txt")[1:].tolist(), np.loadtxt(here / "end.txt", delimiter=",")


def _ours(setting):
    """{scheme: call of one step}, {scheme: deformation after 40}, and the deformation of a run with tolerance 1e-8."""
    state, _, equation = march(setting, Adaptive(1e-8), [STEPS * H])
    y = jax.jit(lambda equation: equation.start())(equation)
    calls = {
        name: compiled(partial(step, stepper=stepper), equation, y, jnp.asarray(H))[0]
        for name, stepper in SCHEMES.items()
    }
    ends = {name: march(setting, Fixed(STEPS, stepper), [STEPS * H])[0].y.x[0] for name, stepper in SCHEMES.items()}
    return calls, {name: _deformation(x) for name, x in ends.items()}, _deformation(state.y.x[0]), np.asarray(y.x[0])


def one_size(N: int, repeats: int, rounds: int, folder: Path | None) -> dict:
    """Returns, for one number of nodes, seconds per step, ratios to plain NumPy, and errors of the deformation."""
    calls, ends, exact, x = _ours(pop(N))
    grid = _plain.Grid(N)
    calls = {"LU": linear_solve(N), "plain NumPy": lambda: _plain.step(grid, NUMBERS, x, np.zeros(N), H)} | calls
    ends["plain NumPy"] = _deformation(plainly(N, x))
    samples = {name: [] for name in calls}
    for _ in range(rounds):
        for name, found in interleaved(calls, repeats).items():
            samples[name] += found
        if folder is not None:
            found, end = elecvesicle(folder, x, STEPS)
            samples["ElecVesicle"] = samples.get("ElecVesicle", []) + found
            ends["ElecVesicle"] = _deformation(end)
    seconds = medians(samples)
    return {
        "seconds": seconds,
        "over plain NumPy": {name: s / seconds["plain NumPy"] for name, s in seconds.items()},
        "error of the deformation": {name: abs(D - exact) for name, D in ends.items()},
        "difference of the velocities": same_computation(N),
    }


def run(sizes=(64, 128, 256), repeats=15, rounds=3, folder: Path | None = None) -> dict:
    """{"by size": {N: see `one_size`}, "made with": versions}."""
    versions = {"NumPy": np.__version__, "SciPy": scipy.__version__, "CPU": _cpu()}
    if folder is not None:
        octave = subprocess.run(["octave-cli", "--version"], check=True, capture_output=True, text=True).stdout
        commit = subprocess.run(["git", "-C", folder, "rev-parse", "HEAD"], check=True, capture_output=True, text=True)
        versions |= {"Octave": octave.splitlines()[0], "ElecVesicle": commit.stdout.strip()}
    return {"by size": {N: one_size(N, repeats, rounds, folder) for N in sizes}, "made with": versions}


def _cpu() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    fields = dict(reversed([[part.strip() for part in line.split(":", 1)] for line in lines if ":" in line]))
    names = [fields[key] for key in ("model name", "cpu family", "model") if key in fields]
    return f"{names[0]}, family {names[1]}, model {names[2]}" if len(names) == 3 else platform.processor()


def main(
    elecvesicle: Annotated[Path | None, typer.Option(help="A clone of ElecVesicle.", exists=True)] = None,
) -> None:
    """Measures and prints the table."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    os.environ["OPENBLAS_NUM_THREADS"] = os.environ["OMP_NUM_THREADS"] = "1"  # those of Octave
    keep_freed_memory()
    found = run(folder=elecvesicle)
    print(found["made with"])
    for N, row in found["by size"].items():
        print(f"N = {N}: velocities of jaxves and plain NumPy differ by {row['difference of the velocities']:.0e}")
        for name, seconds in row["seconds"].items():
            error = row["error of the deformation"].get(name)
            error = "" if error is None else f", deformation off by {error:.1e}"
            print(f"  {name:22} {1e3 * seconds:8.2f} ms, {row['over plain NumPy'][name]:7.3f} of plain NumPy{error}")
    store("beside_others", found)


if __name__ == "__main__":
    typer.run(main)
