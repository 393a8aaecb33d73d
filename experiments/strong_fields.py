"""Are the wrinkles of a strong field computed to the accuracy that the rule for the nodes promises?

    python -m experiments.strong_fields          # table and figure, about five minutes

A deflated giant vesicle (Δ = 0.9, Λ = 0.1, χ = 1e-4) with thermal undulations is put into a field of β/χ = 1e4. Times
are in t_E = χ/β, in which the field deforms the vesicle. The field compresses the membrane (λ down to -1.2e4), which
wrinkles, becomes oblate, and the wrinkles coarsen. The rule 3 √|λ_min| asks for 323 nodes. Wrinkles are the modes
k ≥ 8 of the curvature κ over arc length: their rms is that of κ, their number the mean of k with the weight |κ_k|².

What to expect: runs with 384 to 768 nodes agree to 2e-6 in D and, after the start, to 3e-4 in the wrinkles. The number
of wrinkles falls about like t^{-1/4} until 2 t_E.
"""

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullLocator

from jaxves.geometry import shapes
from jaxves.numerics import fourier
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

from ._common import save, store, styled

CASES = ((768, 1e-4, 12), (512, 1e-4, 12), (384, 1e-4, 12), (512, 1e-5, 12))  # nodes, tolerance, saved times
QUICK = {"cases": ((32, 1e-3, 1),), "strength": 100.0, "modes": 10, "coarsest": 3}
SPACING = 0.25  # of the saved times, in t_E
CHI = 1e-4
_COMPARED = ("deformation", "rms curvature", "wrinkles")
_COARSEST = 8  # the least mode that counts as a wrinkle


def scene(N: int, strength: float, modes: int) -> Scene:
    """Returns a vesicle with thermal undulations along a field of β/χ = `strength`."""
    smooth = shapes.ellipse(N, 0.9, angle=jnp.pi / 2)
    x = shapes.undulated(smooth, temperature=0.04, modes=modes, tension=10.0, seed=1)
    return make_scene(x, field=dc_field(strength * CHI, chi=CHI, conductivity_ratio=0.1))


def wrinkles(x: np.ndarray, coarsest: int) -> tuple[float, float]:
    """Returns the rms of the curvature of wrinkles, and their mean number, of equispaced nodes (N, 2)."""
    N = len(x)
    d1 = np.asarray(fourier.derivative(jnp.asarray(x), axis=0))
    d2 = np.asarray(fourier.derivative(jnp.asarray(d1), axis=0))
    kappa = (d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]) / np.sum(d1**2, axis=1) ** 1.5
    power = 2 * np.abs(np.fft.rfft(kappa)[coarsest:] / N) ** 2
    return float(np.sqrt(np.sum(power))), float(np.sum(np.arange(coarsest, N // 2 + 1) * power) / np.sum(power))


def one(N: int, tolerance: float, saves: int, strength: float, modes: int, coarsest: int) -> dict:
    """Returns the history of one run."""
    march = Adaptive(tolerance, per_growth=2.0, first=1e-2 / strength, recorded=None)
    result = simulate(scene(N, strength, modes), SPACING * saves / strength, saves=saves, march=march)
    found = [wrinkles(x[0], coarsest) for x in np.asarray(result.x)]
    return {
        "word": result.word,
        "steps": int(result.state.steps),
        "rejected": int(result.state.rejected),
        "t": np.asarray(result.t) * strength,
        "deformation": np.asarray(result.diagnostics["deformation_along_field"])[:, 0],
        "rms curvature": [rms for rms, _ in found],
        "wrinkles": [number for _, number in found],
        "tension_min": np.asarray(result.diagnostics["tension_min"])[:, 0],
        "spectral_tail": np.asarray(result.diagnostics["spectral_tail"])[:, 0],
        "tension_tail": np.asarray(result.diagnostics["tension_tail"])[:, 0],
    }


def run(cases=CASES, strength=1e4, modes=120, coarsest=_COARSEST) -> dict:
    """Returns {"N = 384, tolerance 1e-04": history, …}."""
    names = {f"N = {case[0]}, tolerance {case[1]:.0e}": case for case in cases}
    return {name: one(*case, strength, modes, coarsest) for name, case in names.items()}


def differences(found: dict) -> dict[str, dict[str, float]]:
    """Returns the largest differences of each run from the first, while both run: of D, and relative, of wrinkles."""
    (_, first), *others = found.items()
    out = {}
    for name, other in others:
        saved = min(len(first["t"]), len(other["t"]))
        a, b = ({key: np.asarray(one[key][:saved]) for key in _COMPARED} for one in (first, other))
        out[name] = {key: float(np.max(np.abs(b[key] - a[key]))) for key in _COMPARED[:1]}
        out[name] |= {key: float(np.max(np.abs(b[key] / a[key] - 1))) for key in _COMPARED[1:]}
    return out


@styled
def draw(found: dict) -> Figure:
    """Draws deformation, rms curvature and number of wrinkles against time."""
    figure = Figure(figsize=(run_plots.PAGE, 2.5), layout="constrained")
    labels = {"deformation": "$D$", "rms curvature": r"rms curvature of wrinkles ($1/a$)", "wrinkles": "wrinkles"}
    for axes, (key, label) in zip(figure.subplots(1, 3), labels.items(), strict=True):
        for style, (name, history) in zip(("-", "--", ":", "-."), found.items(), strict=False):
            axes.plot(history["t"], history[key], style, label=name)
        axes.set(xlabel=r"$t/t_E$", ylabel=label)
        if key == "wrinkles":
            t = np.array([0.5, 3.0])
            level = np.interp(1.0, history["t"], history[key])
            axes.loglog(t, level * t**-0.25, color="0.5", lw=0.7, label=r"$\propto t^{-1/4}$")
            for axis, ticks in ((axes.xaxis, [0.25, 0.5, 1, 2, 3]), (axes.yaxis, [20, 30, 40, 50, 60])):
                axis.set_minor_locator(NullLocator())
                axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
            axes.set(xlim=(0.2, 3.2), ylim=(22, 60))
            axes.legend(fontsize=6, loc="lower left")
    return figure


def report(found: dict) -> None:
    """Prints one row for each saved time, and the differences from the first run."""
    for name, history in found.items():
        print(f"{name}: {history['word']}, {history['steps']} steps, {history['rejected']} rejected")
        for i in range(len(history["t"])):
            row = (history[key][i] for key in ("t", "deformation", "rms curvature", "wrinkles", "tension_min"))
            print("  t = {:5.3f}  D = {:+.6f}  rms = {:9.5f}  wrinkles = {:6.2f}  λ_min = {:9.1f}".format(*row))
    for name, row in differences(found).items():
        print(f"{name}: " + ", ".join(f"{key} {value:.1e}" for key, value in row.items()))


def main():
    found = run()
    report(found)
    store("strong_fields", {"histories": found, "differences from the first": differences(found)})
    save(draw(found), "strong_fields")


if __name__ == "__main__":
    main()
