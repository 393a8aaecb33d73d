"""Functions that several experiments use: scenes, compiled time stepping, timing in turns, stored numbers.

Importing this module limits BLAS to one thread, because small LAPACK calls, which JAX takes from SciPy, are slower on
two.
"""

import json
import os
import platform
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from matplotlib import rc_context
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

import jaxves
from jaxves.equation.equation import Equation, equation_for
from jaxves.geometry import shapes
from jaxves.observables.checks import Checks
from jaxves.observables.rows import Row
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.march import AbstractMarch
from jaxves.stepping.marching import Result, simulate
from jaxves.stepping.state import State

threadpool_limits(1, user_api="blas")

HERE = Path(__file__).parent
_equation_for = eqx.filter_jit(equation_for)


def pop(N: int, *, reduced_area=0.9, beta=3.2, conductivity_ratio=0.1) -> Scene:
    """Returns an ellipse along a field, with reduced area 0.9 by default."""
    x = shapes.ellipse(N, reduced_area, angle=jnp.pi / 2)
    return make_scene(x, field=dc_field(beta, conductivity_ratio=conductivity_ratio))


def treading(N: int) -> Scene:
    """Tank-treading in shear and a field, from 20 degrees."""
    field = dc_field(6.4, conductivity_ratio=0.1, membrane_conductance=4.0)
    return make_scene(shapes.ellipse(N, 0.9, angle=jnp.deg2rad(20.0)), field=field, flow=Shear(10.0))


def by_name(rows: Row | Result) -> dict[str, np.ndarray]:
    """The arrays of rows, or of a result, by name: t, x, tension, V_m where there is a field, and all diagnostics."""
    found = {"t": rows.t, "x": rows.x, "tension": rows.tension, "V_m": rows.V_m} | rows.diagnostics
    return {name: np.asarray(value) for name, value in found.items() if value is not None}


def march(
    setting: Scene, method: AbstractMarch, times, *, checks: Checks | None = None, **options
) -> tuple[State, dict[str, np.ndarray], Equation]:
    """From t = 0 through `times`: the last state, the rows saved at `times` by name, and the equation.

    Rows after an early end are NaN. `options` are those of `equation_for`.
    """
    times = jnp.asarray(times, dtype=float)
    result = simulate(setting, times=times, march=method, checks=checks, **options)
    rows = {name: value[1:] for name, value in by_name(result).items()}
    return result.state, rows, _equation_for(setting, **options)


def interleaved(calls: dict[str, Callable], repeats: int) -> dict[str, list[float]]:
    """Returns the seconds of each call, `repeats` times.

    The calls take turns, so that a busy machine slows all of them equally. Each turn is the second of two calls,
    because calls follow one another in a run, with threads and caches warm.
    """
    for call in calls.values():
        jax.block_until_ready(call())  # compiles
    seconds = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            jax.block_until_ready(call())
            start = time.perf_counter()
            jax.block_until_ready(call())
            seconds[name].append(time.perf_counter() - start)
    return seconds


def medians(seconds: dict[str, list[float]]) -> dict[str, float]:
    """Returns the median of each list."""
    return {name: statistics.median(found) for name, found in seconds.items()}


def _plain(value):
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        return _plain(np.asarray(value).tolist())
    return float(f"{value:.9g}") if isinstance(value, float) else value


def _pace() -> float:
    """Returns the least of several times of a fixed task, with which times of different machines are compared."""
    matrix = np.random.default_rng(0).normal(size=(192, 192))
    return 1e3 * min(interleaved({"LU": lambda: scipy.linalg.lu_factor(matrix)}, 50)["LU"])


def store(name: str, data, variant: str = "") -> None:
    """Writes numbers with their origin to data/NAME.json, or data/NAME_VARIANT.json for a variant of the command."""
    provenance = {
        "command": f"python -m experiments.{name}" + (variant and f" --{variant}"),
        "jaxves": jaxves.__version__,
        "jax": jax.__version__,
        "python": platform.python_version(),
        "machine": f"{os.cpu_count()} {platform.machine()} cores, {jax.default_backend()}",
        "ms of an LU of 192 unknowns": _pace(),
    }
    folder = HERE / "data"
    folder.mkdir(exist_ok=True)
    text = json.dumps({"provenance": provenance, "data": _plain(data)}, indent=1, ensure_ascii=False)
    (folder / f"{name}{variant and f'_{variant}'}.json").write_text(text + "\n")


def styled(draw: Callable) -> Callable:
    """Wraps a drawing function so that it has the style of `jaxves.plots`."""
    return rc_context(run_plots.STYLE)(draw)


def shades(count: int) -> np.ndarray:
    """Returns a colour (count, 4) for each of `count` curves in order, dark to light, as in `jaxves.plots`."""
    order = np.arange(count)
    return run_plots.scale(order).to_rgba(order)


def save(figure: Figure, name: str) -> None:
    """Writes figures/NAME.png."""
    folder = HERE / "figures"
    folder.mkdir(exist_ok=True)
    with rc_context(run_plots.STYLE):  # colours "C0", "C1", … are looked up as late as this
        figure.savefig(folder / f"{name}.png", dpi=140)
