"""What does a derivative cost, in time and in memory?

    python -m experiments.derivative_cost          # table and a figure

A vesicle in a field, N = 64, is differentiated with respect to β, Λ, G, χ and the permittivity ratio: along one
direction (jvp) and with respect to all of them (grad). Times are relative to the run itself. Calls take turns. The
least CPU time of each is used, all threads together, because a busy machine disturbs it least. Memory is measured
twice: as what the compiled program allocates, and as the growth of a process during one call after compilation
(Linux).

What to expect: less than 2 for a direction, 2.8 if steps are recorded for reverse mode, below 4 for the gradient, for
any number of steps. Memory grows only by the stored states. `jaxves.jacobian` and `jaxves.fit` do not record steps in
forward mode.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from jaxves.geometry import shapes
from jaxves.physics.scene import dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.march import AbstractMarch
from jaxves.stepping.marching import simulate

from ._common import save, store, styled

NUMBERS = (3.2, 0.1, 0.0, 0.08, 1.0)
STEP = 1e-3
KINDS = ("fixed", "adaptive", "adaptive, not recorded")
QUICK = dict(kinds=("fixed",), steps=(4,), N=16, repeats=1, processes=False)


def march_of(kind: str, steps: int) -> AbstractMarch:
    """Returns steps of `STEP`; adaptive steps begin smaller, so there are a few more of them."""
    if kind == "fixed":
        return Fixed(steps)
    return Adaptive(1e-3, largest=STEP, recorded=steps + 50 if kind == "adaptive" else None)


def calls_of(kind: str, steps: int, N: int) -> dict:
    """Returns the run, its jvp and its gradient, as functions of `NUMBERS`."""
    ellipse, march = shapes.ellipse(N, 0.9, angle=jnp.pi / 2), march_of(kind, steps)

    def run(numbers):
        beta, ratio, conductance, chi, permittivity = numbers
        field = dc_field(
            beta,
            conductivity_ratio=ratio,
            membrane_conductance=conductance,
            chi=chi,
            permittivity_ratio=permittivity,
        )
        result = simulate(make_scene(ellipse, field=field), steps * STEP, saves=1, march=march)
        return result.diagnostics["deformation"][-1, 0], (result.state.steps, result.status)

    def jvp(numbers):
        return jax.jvp(run, (numbers,), (jnp.ones(5),), has_aux=True)

    found = {"run": jax.jit(run), "jvp": jax.jit(jvp)}
    if kind != "adaptive, not recorded":
        found["grad"] = jax.jit(jax.value_and_grad(run, has_aux=True))
    return found


def run(kinds=KINDS, steps=(250, 2000), N=64, repeats=3, processes=True):
    """{kind: {steps: {steps made, {call: seconds, ratio, MB allocated, MB grown}}}}."""
    return {kind: {count: _costs(kind, count, N, repeats, processes) for count in steps} for kind in kinds}


def _costs(kind, steps, N, repeats, processes):
    numbers = jnp.array(NUMBERS)
    compiled = {name: call.lower(numbers).compile() for name, call in calls_of(kind, steps, N).items()}
    made, code = compiled["run"](numbers)[1]
    seconds = dict.fromkeys(compiled, np.inf)
    for _ in range(repeats):
        for name, call in compiled.items():
            start = time.process_time()
            jax.block_until_ready(call(numbers))
            seconds[name] = min(seconds[name], time.process_time() - start)
    table = {"steps": int(made), "status": int(code), "calls": {}}
    for name, call in compiled.items():
        memory = call.memory_analysis()
        table["calls"][name] = {
            "seconds": seconds[name],
            "ratio": seconds[name] / seconds["run"],
            "MB allocated": (memory.temp_size_in_bytes + memory.output_size_in_bytes) / 1e6,
            "MB grown": _grown(kind, steps, N, name) if processes else np.nan,
        }
    return table


def _grown(kind, steps, N, name) -> float:
    """Returns by how many MB a process grows in one call; NaN if the system does not report it."""
    command = [sys.executable, "-m", __spec__.name, json.dumps([kind, steps, N, name])]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def _alone(kind, steps, N, name):
    numbers = jnp.array(NUMBERS)
    call = calls_of(kind, steps, N)[name].lower(numbers).compile()
    forget = Path("/proc/self/clear_refs")
    if not forget.exists():
        print(np.nan)
        return
    before = _kilobytes("VmRSS")
    forget.write_text("5")  # the greatest size is counted from here
    jax.block_until_ready(call(numbers))
    print((_kilobytes("VmHWM") - before) / 1e3)


def _kilobytes(what: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(what)).split()[1])


@styled
def draw(found) -> Figure:
    """Draws ratios and allocated memory against the number of steps."""
    figure = Figure(figsize=(run_plots.PAGE, 2.7))
    time, memory = figure.subplots(1, 2)
    for i, (kind, tables) in enumerate(found.items()):
        steps = [table["steps"] for table in tables.values()]
        for name, style in (("jvp", "--s"), ("grad", "-o")):
            if name in next(iter(tables.values()))["calls"]:
                rows = [table["calls"][name] for table in tables.values()]
                time.semilogx(
                    steps, [row["ratio"] for row in rows], style, color=f"C{i}", ms=3, label=f"{name}, {kind}"
                )
                memory.semilogx(steps, [row["MB allocated"] for row in rows], style, color=f"C{i}", ms=3)
    time.set(xlabel="steps", ylabel="time / that of the run", ylim=(0, None))
    memory.set(xlabel="steps", ylabel="memory allocated (MB)", ylim=(0, None))
    ticks = sorted({int(asked) for tables in found.values() for asked in tables})
    for axes in (time, memory):
        axes.set_xticks(ticks, [str(tick) for tick in ticks])
        axes.minorticks_off()
    figure.legend(*time.get_legend_handles_labels(), loc="outside lower center", ncols=5, columnspacing=1.2)
    return figure


def main():
    if len(sys.argv) > 1:
        _alone(*json.loads(sys.argv[1]))
        return
    found = run()
    print(f"{'':24}{'steps':>6} {'call':5}{'seconds':>9}{'ratio':>7}{'MB allocated':>14}{'MB grown':>13}")
    for kind, tables in found.items():
        for table in tables.values():
            for name, row in table["calls"].items():
                print(
                    f"{kind:24}{table['steps']:6} {name:5}{row['seconds']:9.2f}{row['ratio']:7.2f}"
                    f"{row['MB allocated']:14.1f}{row['MB grown']:13.0f}"
                )
    store("derivative_cost", found)
    save(draw(found), "derivative_cost")


if __name__ == "__main__":
    main()
