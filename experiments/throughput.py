"""What do an evaluation of F, a step and a run cost, in units of a well-known linear solve?

    python -m experiments.throughput          # tables and a figure, about two minutes

One vesicle in a field; LAPACK and the products of XLA have one thread each. The unit is SciPy's `lu_factor` and
`lu_solve` for 3N unknowns. A method that solves for shape and tension together would need it once per step. Everything
takes turns in one process on one core. Results are medians, and the ratio of the least times, which other work on the
machine disturbs less. Freed memory stays with the process. Otherwise glibc returns memory from the threads of JAX to
the system after every call. Getting it again costs a single call of F with 128 nodes as much time as F itself. Within
a compiled run F allocates no memory.

What to expect: F near one unit with 64 and 128 nodes, and half a unit with 256. A fourth-order step (six F, one linear
part with its factorisation, one projection) below eight. Parts that a scene leaves out cost nothing.
"""

import ctypes
import os
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from matplotlib.figure import Figure

from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.schemes import ARK4

from ._common import interleaved, march, medians, pop, save, store, styled

os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")  # read when JAX starts, at its first array

PRESENT = {"nothing imposed": (0, 0), "flow": (0, 1), "field": (1, 0), "field and flow": (1, 1)}
QUICK = dict(sizes=(32,), repeats=3, N=32, t_end=0.01, present=("flow",))


def keep_freed_memory():
    """Tells glibc to keep freed memory instead of returning it; call it before JAX allocates."""
    if sys.platform == "linux" and hasattr(libc := ctypes.CDLL(None), "mallopt"):
        top_pad, mmap_threshold = -2, -3  # of malloc.h
        libc.mallopt(top_pad, 2**26)
        libc.mallopt(mmap_threshold, 2**25)


def rate(equation, y):
    return equation.rate(jnp.zeros(()), y)


def step(equation, y, h, stepper=ARK4()):  # noqa: B008, a stepper has no state
    """Makes one step as in a run: freeze, stages, filter and projection."""
    t = jnp.zeros(())
    frozen = equation.freeze(t, y)
    return equation.project(stepper.step(equation, frozen, t, y, h).y, frozen.constraint)


def compiled(function, *arguments):
    """Returns the compiled function as a call without arguments, and the seconds for tracing and compiling."""
    start = time.perf_counter()
    program = jax.jit(function).lower(*arguments).compile()
    return lambda: program(*arguments), time.perf_counter() - start


def linear_solve(N):
    """Solves 3N equations by SciPy's LU factorisation."""
    random = np.random.default_rng(0)
    matrix, b = random.normal(size=(3 * N, 3 * N)), random.normal(size=3 * N)
    return lambda: scipy.linalg.lu_solve(scipy.linalg.lu_factor(matrix, check_finite=False), b, check_finite=False)


def calls_of(setting):
    """Returns {name: call} and {name: seconds to compile}."""
    equation = equation_for(setting)
    y = jax.jit(lambda equation: equation.start())(equation)
    cases = {"rate": (rate, equation, y), "step": (step, equation, y, jnp.asarray(1e-3))}
    made = {name: compiled(*case) for name, case in cases.items()}
    return {name: call for name, (call, _) in made.items()}, {name: seconds for name, (_, seconds) in made.items()}


def by_size(sizes, repeats):
    found = {}
    for N in sizes:
        calls, compiling = calls_of(pop(N))
        samples = interleaved({"LU": linear_solve(N)} | calls, repeats)
        seconds, least = medians(samples), {name: min(found) for name, found in samples.items()}
        ratios = {f"{name} / LU": seconds[name] / seconds["LU"] for name in calls}
        ratios |= {f"{name} / LU, least": least[name] / least["LU"] for name in calls}
        found[N] = seconds | ratios | {f"compile {name}": s for name, s in compiling.items()}
    return found


def by_what_is_present(N, repeats, present):
    """Returns the seconds of a step for each combination of field and flow."""
    calls = {}
    for name in present:
        field, flow = PRESENT[name]
        setting = make_scene(
            shapes.ellipse(N, 0.9, angle=jnp.pi / 2),
            field=dc_field(3.2, conductivity_ratio=0.1) if field else None,
            flow=Shear(10.0) if flow else None,
        )
        calls[name] = calls_of(setting)[0]["step"]
    return medians(interleaved(calls, repeats))


def whole_run(N, t_end=1.0, tolerance=1e-4, saves=20):
    """Returns the seconds of a compiled run, and its numbers of steps."""
    setting, times = pop(N), t_end * np.arange(1, saves + 1) / saves

    def once():
        start = time.perf_counter()
        state, _, _ = march(setting, Adaptive(tolerance), times)
        return time.perf_counter() - start, state

    first = once()[0]
    warm = [once() for _ in range(3)]
    state = warm[0][1]
    seconds = float(np.median([s for s, _ in warm]))
    return {"seconds": seconds, "first": first, "steps": int(state.steps), "rejected": int(state.rejected)}


def run(sizes=(64, 128, 256), repeats=101, N=64, t_end=1.0, present=tuple(PRESENT)):
    """Returns the seconds by size, by combination of field and flow, and of a whole run."""
    return {
        "by size": by_size(sizes, repeats),
        "by what is present": by_what_is_present(N, repeats, present),
        "POP run": whole_run(N, t_end),
    }


@styled
def draw(found) -> Figure:
    """Draws the cost in LU units by size, and the step time of the four combinations."""
    figure = Figure(figsize=(run_plots.PAGE, 2.4))
    left, middle, right = figure.subplots(1, 3)
    sizes = list(found["by size"])
    place = np.arange(len(sizes))
    titles = {"rate": "one right-hand side", "step": "one step"}
    for axes, (name, title), target in zip((left, middle), titles.items(), (1.0, 8.0), strict=True):
        bars = axes.bar(place, [found["by size"][N][f"{name} / LU"] for N in sizes], width=0.6)
        axes.bar_label(bars, fmt="%.2f", fontsize=7, label_type="center", color="white")
        least = [found["by size"][N][f"{name} / LU, least"] for N in sizes]
        axes.plot(place, least, "D", color="C1", ms=4, label="least time")
        axes.axhline(target, color="0.4", ls="--", lw=0.8, label="target")
        axes.set(title=title, ylabel="time / time of one LU of 3N unknowns", xlabel="nodes $N$")
        axes.set_ylim(0, 1.35 * target)
        axes.legend(loc="upper left", ncols=2, handlelength=1.2, columnspacing=0.8, fontsize=6)
        axes.set_xticks(place, [str(N) for N in sizes])
    times = found["by what is present"]
    bars = right.barh(range(len(times)), [1e3 * s for s in times.values()], height=0.6, color="C2")
    right.bar_label(bars, fmt="%.2f", fontsize=7, padding=2)
    right.set_yticks(range(len(times)), list(times))
    right.set(title="what is imposed, N = 64", xlabel="time of one step (ms)")
    right.margins(x=0.2)
    return figure


def main():
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    keep_freed_memory()
    found = run()
    for N, row in found["by size"].items():
        print(
            f"N = {N:3d}: LU {1e3 * row['LU']:.2f} ms, rate {1e3 * row['rate']:.2f} ms = {row['rate / LU']:.2f} LU "
            f"(least by least {row['rate / LU, least']:.2f}), "
            f"step {1e3 * row['step']:.2f} ms = {row['step / LU']:.2f} LU ({row['step / LU, least']:.2f}), "
            f"compiling {row['compile rate']:.1f} and {row['compile step']:.1f} s"
        )
    for name, seconds in found["by what is present"].items():
        print(f"{name:16} {1e3 * seconds:.2f} ms a step")
    whole = found["POP run"]
    print(
        f"POP to t = 1, tolerance 1e-4, 20 saves: {whole['seconds']:.3f} s ({whole['steps']} steps, "
        f"{whole['rejected']} rejected); {whole['first']:.1f} s with compiling"
    )
    store("throughput", found)
    save(draw(found), "throughput")


if __name__ == "__main__":
    main()
