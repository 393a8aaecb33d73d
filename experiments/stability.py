"""Where is the method right, where does it stop, and does it say so?

    python -m experiments.stability               # tables and a figure, about half an hour on busy cores
    python -m experiments.stability field pairs   # these groups again; the stored numbers of the others stay

Scenes at the limits of every parameter, alone and combined, are run with tolerance 1e-5 and the usual checks, to t_end
= min(1, 20/Ca, 50 χ/β). Each is run again with more nodes (fewer for 256) and a tenth of the tolerance. A cell is
"right" if the two agree to 1e-3 in shape and V_m at all saved times. It is "stopped", with its status word, if what it
had saved before is right to 1e-2. Otherwise it is "wrong".

A second table has the largest fixed step with which each scheme comes near the right answer.

What to expect: no "wrong". If the field compresses the membrane so strongly that the nodes do not resolve its wrinkles
(β/χ above 1000 at Λ < 1), the run stops as "unresolved".
"""

import json
import sys
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.observables.checks import Checks
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.schemes import ARK4, ARK5, SemiImplicitEuler

from ._common import HERE, march, pop, save, store, styled, treading
from ._distance import distances
from ._schemes import ARK2, ARK3, Even

TOLERANCE = 1e-5
_SAVES = 5
_BOUND = 3000  # steps: a run that needs more says so


class Cell(NamedTuple):
    """A vesicle in a field (β = 0: a field without effect) and, with Ca, in shear; with `gap`, two at this distance."""

    reduced_area: float = 0.9
    conductivity_ratio: float = 0.1
    G: float = 0.0
    chi: float = 0.08
    beta: float = 3.2
    Ca: float | None = None
    N: int = 64
    gap: float | None = None

    def scene(self, N: int) -> Scene:
        """Returns the scene with N nodes: along the field, or at 20 degrees in shear; pairs in line or side by side."""
        angle = jnp.pi / 2 if self.Ca is None else jnp.deg2rad(20.0)
        x = shapes.circle(N) if self.reduced_area == 1 else shapes.ellipse(N, self.reduced_area, angle=angle)
        flow = None if self.Ca is None else Shear(self.Ca)
        numbers = dict(conductivity_ratio=self.conductivity_ratio, membrane_conductance=self.G, chi=self.chi)
        if self.gap is None:
            return make_scene(x, field=dc_field(self.beta, **numbers), flow=flow)
        half = float(jnp.max(x[:, 1])) + self.gap / 2
        field = dc_field(self.beta, **numbers, vesicles=2)
        return make_scene([x, x], centers=[[0.0, half], [0.0, -half]], field=field, flow=flow)

    def t_end(self) -> float:
        """Returns min(1, 20/Ca, 50 χ/β)."""
        limits = [1.0, 20 / self.Ca if self.Ca else 1.0, 50 * self.chi / self.beta if self.beta else 1.0]
        return min(limits)

    def label(self) -> str:
        """Returns what differs from one vesicle with Δ = 0.9, Λ = 0.1, G = 0, χ = 0.08, β = 3.2 and 64 nodes."""
        symbols = ("Δ", "Λ", "G", "χ", "β", "Ca", "N", "gap")
        parts = zip(symbols, self, Cell(), strict=True)
        return " ".join(f"{symbol}={value:g}" for symbol, value, usual in parts if value != usual) or "usual"

    def finer(self) -> int:
        """Returns the number of nodes of the second run."""
        return {32: 64, 64: 96, 128: 192, 256: 192, 512: 640}[self.N]


def _each(name, values, **others):
    return [Cell(**{name: value}, **others) for value in values]


_FLOW = dict(beta=0.0)
_BOTH = dict(beta=6.4, G=4.0)
_HARD = dict(reduced_area=0.99, beta=12.8, G=4.0)
GROUPS = {
    "field": [
        Cell(),
        *_each("conductivity_ratio", (0.0, 0.01, 1.0, 10.0, np.inf)),
        *_each("G", (1.0, 10.0, 100.0, 1e4)),
        *_each("chi", (1e-4, 1e-3, 1e-2, 1.0, 10.0)),
        *_each("reduced_area", (0.5, 0.6, 0.7, 0.8, 0.99, 0.999, 1.0)),
        *_each("beta", (0.1, 12.8, 30.0, 100.0)),
        Cell(conductivity_ratio=np.inf, beta=100.0),
        Cell(conductivity_ratio=0.0, chi=1e-4, beta=100.0),
        Cell(conductivity_ratio=np.inf, G=1e4, chi=10.0, beta=100.0),
        Cell(reduced_area=0.99, chi=10.0, beta=100.0),
        Cell(reduced_area=0.6, conductivity_ratio=0.0, beta=30.0),
        Cell(reduced_area=0.7, conductivity_ratio=10.0, G=10.0, beta=100.0, chi=1e-3),
    ],
    "shear": [
        *_each("Ca", (0.1, 1.0, 10.0, 100.0, 1000.0), **_FLOW),
        *_each("reduced_area", (0.5, 0.7, 0.99, 1.0), Ca=10.0, **_FLOW),
        *_each("reduced_area", (0.5, 0.99), Ca=1000.0, **_FLOW),
        *_each("Ca", (10.0, 50.0, 1000.0), **_BOTH),
        *_each("Ca", (10.0, 50.0), **_HARD),
        Cell(reduced_area=1.0, Ca=10.0, **_BOTH),
        Cell(reduced_area=0.7, Ca=10.0, **_BOTH),
        Cell(reduced_area=0.5, Ca=50.0, beta=12.8),
        Cell(conductivity_ratio=0.0, Ca=10.0),
        Cell(conductivity_ratio=np.inf, Ca=10.0, beta=30.0),
        Cell(chi=1e-4, Ca=1000.0),
        Cell(chi=10.0, beta=100.0, Ca=10.0),
        Cell(conductivity_ratio=np.inf, G=1e4, beta=100.0, Ca=1000.0),
        Cell(conductivity_ratio=0.0, chi=10.0, beta=100.0, Ca=1000.0),
    ],
    "pairs": [
        *_each("gap", (0.5, 0.05, 1e-3)),
        Cell(gap=0.05, conductivity_ratio=np.inf),
        Cell(gap=0.05, conductivity_ratio=0.0, chi=1e-3),
        Cell(gap=0.2, G=10.0, beta=30.0),
    ],
    "few nodes": [Cell(N=32), Cell(N=32, beta=100.0), Cell(N=32, reduced_area=0.5, beta=12.8)],
    "many nodes": [
        *_each("reduced_area", (0.2, 0.3, 0.4), N=128),
        Cell(N=128, reduced_area=0.5, beta=12.8),
        Cell(N=256, reduced_area=0.5, beta=16.0),
        Cell(N=512, reduced_area=0.5, beta=100.0, chi=0.01),
    ],
}
STEPPED = {"POP": (pop, 0.3, 64), "tank-treading": (treading, 0.2, 64)}
SCHEMES = {
    "Euler, unprojected": (SemiImplicitEuler(), False),
    "Euler": (SemiImplicitEuler(), True),
    "ARK2": (ARK2(), True),
    "ARK3": (ARK3(), True),
    "ARK4": (ARK4(), True),
    "ARK5": (ARK5(), True),
}
COUNTS = (10, 15, 20, 25, 30, 40, 50, 60, 80, 120, 160, 240, 320, 480, 640)
QUICK = dict(groups={"field": [Cell(N=32), Cell(N=32, chi=1e-4)]}, stepped=())


def solve(cell: Cell, N: int, tolerance: float):
    """The word of the end, the rows saved until then, the numbers of steps taken and rejected, and the last instant."""
    times = cell.t_end() * np.arange(1, _SAVES + 1) / _SAVES
    method = Adaptive(tolerance, max_steps=_BOUND)
    state, rows, _ = march(cell.scene(N), method, times)
    kept = ~np.isnan(rows["t"])
    word = status.WORDS[max(int(state.status), status.COMPLETE)]
    counts = int(state.steps), int(state.rejected)
    return word, {key: row[kept] for key, row in rows.items()}, counts, float(state.t)


def judge(cell: Cell) -> dict:
    """{verdict, word, error, ...}: error is the largest of shape and V_m over the instants that both runs saved."""
    word, rows, (steps, rejected), t = solve(cell, cell.N, TOLERANCE)
    finer_word, finer, *_ = solve(cell, cell.finer(), 0.1 * TOLERANCE)
    n = min(len(rows["t"]), len(finer["t"]))
    if word not in status.SUCCESS and n and rows["t"][-1] == t:
        n = min(n, len(rows["t"]) - 1)  # the last instant is the one that was found wanting
    apart = distances(*({key: row[:n] for key, row in side.items()} for side in (rows, finer))) if n else {}
    # Potentials are measured in units of the largest, where that exceeds 1.
    scale = max(1.0, np.max(np.abs(finer["V_m"][:n]))) if n else 1.0
    error = max(np.max(apart["shape"]), np.max(apart["V_m"]) / scale) if n else np.nan
    numbers = [row for key, row in rows.items() if key != "self_gap"]  # infinite where nothing is narrow
    finite = all(np.all(np.isfinite(row)) for row in numbers)
    if word in status.SUCCESS:
        sound = finite and finer_word in status.SUCCESS and error <= 1e-3
        verdict = "right" if sound else "wrong"
    else:
        verdict = "stopped" if finite and not error > 1e-2 else "wrong"
    found = {"verdict": verdict, "word": word, "error": float(error)}
    found["tension"] = float(np.max(apart["tension"])) if n else np.nan
    tail = float(np.max(rows["spectral_tail"])) if n else np.nan
    return found | {
        "finer": finer_word, "finite": bool(finite), "steps": steps, "rejected": rejected, "tail": tail,
        "t_end": cell.t_end(),
    }  # fmt: skip


def largest_steps(name, counts, schemes=tuple(SCHEMES)):
    """{scheme: the largest step from which on all smaller ones arrive within 0.1 of the right shape and V_m}."""
    make, t_end, N = STEPPED[name]
    everything = Checks(tail=np.inf, drift=np.inf)

    def final(method):
        _, rows, _ = march(make(N), method, [t_end], checks=everything)
        return rows

    best = final(Adaptive(1e-6, ARK5()))
    found = {}
    for scheme in schemes:
        stepper, projection = SCHEMES[scheme]
        arrived = []
        for steps in counts:
            rows = final(Even(steps, stepper, projection))
            near = np.all(np.isfinite(rows["x"])) and np.all(np.isfinite(rows["V_m"]))
            apart = distances(rows, best) if near else {"shape": np.inf, "V_m": np.inf}
            arrived.append(max(np.max(apart["shape"]), np.max(apart["V_m"])) < 0.1)
        broken = max((steps for steps, good in zip(counts, arrived, strict=True) if not good), default=0)
        stable = [steps for steps in counts if steps > broken]
        found[scheme] = t_end / stable[0] if stable else np.nan
    return found


def run(groups=None, stepped=tuple(STEPPED), counts=COUNTS):
    """{group: {label: judgement}} and, as "largest step", {scene: {scheme: step}}."""
    groups = GROUPS if groups is None else groups
    found = {group: {cell.label(): judge(cell) for cell in cells} for group, cells in groups.items()}
    return found | ({"largest step": {name: largest_steps(name, counts) for name in stepped}} if stepped else {})


_MEANINGS = {
    "right": "complete, with its error",
    "stopped": "stopped, with its status",
    "wrong": "complete, and the error exceeds 1e-3",
}
_COLORS = {"right": "#b7e1c0", "stopped": "#fbdc9c", "wrong": "#f2a3a3"}


@styled
def draw(found, columns=7) -> Figure:
    """Draws a tile for each scene, with its unusual numbers and the error or the status."""
    groups = {group: cells for group, cells in found.items() if group != "largest step"}
    rows = sum(-(-len(cells) // columns) for cells in groups.values())
    figure = Figure(figsize=(run_plots.PAGE, 0.42 * rows + 0.22 * len(groups) + 0.1))
    axes = figure.subplots()
    y = 0.0
    for group, cells in groups.items():
        axes.text(0, y + 0.3, group, fontsize=7, weight="bold", va="center")
        y += 0.5
        for i, (label, cell) in enumerate(cells.items()):
            x, row = i % columns, y + i // columns
            axes.add_patch(Rectangle((x + 0.02, row + 0.03), 0.96, 0.94, color=_COLORS[cell["verdict"]], lw=0))
            words = label.split(" ")
            half = -(-len(words) // 2)
            text = label if len(label) < 19 else " ".join(words[:half]) + "\n" + " ".join(words[half:])
            said = cell["word"] if cell["verdict"] == "stopped" else f"{cell['error']:.0e}"
            axes.text(x + 0.5, row + 0.38, text, fontsize=5, ha="center", va="center")
            axes.text(x + 0.5, row + 0.78, said, fontsize=5, ha="center", va="center", weight="bold")
        y += -(-len(cells) // columns)
    axes.set(xlim=(0, columns), ylim=(y, 0))
    axes.set_axis_off()
    shown = {cell["verdict"] for cells in groups.values() for cell in cells.values()}
    key = [Rectangle((0, 0), 1, 1, color=_COLORS[word], label=_MEANINGS[word]) for word in _COLORS if word in shown]
    axes.legend(handles=key, loc="upper left", bbox_to_anchor=(0, 0), ncols=2, fontsize=7)
    return figure


def report(found) -> None:
    """Prints the results of `run`."""
    counts = {}
    for group, cells in found.items():
        if group == "largest step":
            continue
        for label, cell in cells.items():
            counts[cell["verdict"]] = counts.get(cell["verdict"], 0) + 1
            print(
                f"{group:10} {label:44} {cell['verdict']:8} {cell['word']:14} error {cell['error']:.1e} "
                f"λ {cell['tension']:.1e} tail {cell['tail']:.0e} {cell['steps']}+{cell['rejected']} steps "
                f"to {cell['t_end']:.3g}, finer {cell['finer']}"
            )
    print(", ".join(f"{n} {verdict}" for verdict, n in counts.items()))
    for name, steps in found.get("largest step", {}).items():
        print(f"largest fixed step, {name}: " + ", ".join(f"{scheme} {h:.2g}" for scheme, h in steps.items()))


def main(names):
    path = HERE / "data" / "stability.json"
    found = json.loads(path.read_text())["data"] if names and path.exists() else {}
    for name in names or (*GROUPS, "largest step"):
        found |= run({}) if name == "largest step" else run({name: GROUPS[name]}, stepped=())
        store("stability", found)
    report(found)
    save(draw(found), "stability")


if __name__ == "__main__":
    main(sys.argv[1:])
