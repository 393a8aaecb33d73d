"""How does the viscosity of tank-treading vesicles depend on all numbers, and are the derivatives right?

    python -m experiments.sensitivity            # tables and a figure, about ten minutes
    python -m experiments.sensitivity --models   # scenes of all models, without the curves

G = 4, β = 6.4, Ca = 10, Δ = 0.9, Λ = 0.1, as in the paper's rheology. From the steady shape Newton's method follows Λ,
β and Δ. At every point ∂[μ]/∂Λ, ∂[μ]/∂β, ∂[μ]/∂Δ come from the implicit function theorem. They are compared with the
slopes of a spline through the computed curve. Then every number of several scenes is checked: one vesicle, in shear, a
close and a far pair, a symmetric shape along the field, a circle, and no field strength. Forward mode is compared with
reverse mode and with differences (`jaxves check-grad` does this for any scene), and second derivatives are computed.
With `--models` the scenes have another viscosity inside, charge that relaxes, fields and flows that change in time, a
pair near contact, and a periodic cell.

What to expect: the slopes of the curves agree with the derivatives within the error of a spline through so few points.
Forward and reverse mode agree to 1e-8, forward mode and differences to 1e-6.
"""

import argparse
import time

import equinox as eqx
import jax
import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

from jaxves.analysis import gradcheck, sensitivity
from jaxves.analysis.steady import steady_shape
from jaxves.equation.state import Unknowns
from jaxves.inputs.parameters import numbers
from jaxves.inputs.scene_files import parse
from jaxves.plots import run_plots
from jaxves.runs.build import scene_of
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

from ._common import save, store, styled

CENTRE = {"field.conductivity_ratio": 0.1, "field.beta": 6.4, "vesicle.reduced_area": 0.9}
SYMBOLS = dict(zip(CENTRE, "ΛβΔ", strict=True))
ALONG = {
    "field.conductivity_ratio": np.geomspace(0.02, 10.0, 13),
    "field.beta": np.linspace(1.6, 9.6, 11),
    "vesicle.reduced_area": np.linspace(0.82, 0.96, 11),
}
CLOSE = {"vesicle": [{"reduced_area": 0.9, "angle": 90.0}], "pair": {"separation": 1.75, "offset_angle": 10.0}}
ONE = {"vesicle": [{"reduced_area": 0.9, "angle": 80.0}]}
FIELD = {"field": {"beta": 3.2, "conductivity_ratio": 0.1, "membrane_conductance": 0.5}}
SHEAR = {"flow": {"kind": "shear", "capillary_number": 10.0}}
FAR = {"vesicle": [{"reduced_area": 0.9, "angle": 90.0}], "pair": {"separation": 8.0, "offset_angle": 10.0}}
SYMMETRIC = {"vesicle": [{"reduced_area": 0.9, "angle": 90.0}]}
CIRCLE = {"vesicle": [{"reduced_area": 1.0}]}
SCENES = {
    "single": ONE | FIELD,
    "sheared": ONE | FIELD | SHEAR,
    "close pair": CLOSE | FIELD,
    "far pair": FAR | FIELD,
    "symmetric": SYMMETRIC | FIELD,
    "circle in shear": CIRCLE | FIELD | SHEAR,
    "no field strength": ONE | {"field": FIELD["field"] | {"beta": 0.0}},
}
CHARGE = {"charge_relaxation": 0.01, "permittivity_ratio": 0.5}
CONTACT = {"vesicle": [{"reduced_area": 0.9, "angle": 90.0}], "pair": {"separation": 1.46, "offset_angle": 0.0}}
TWO = [{"reduced_area": 0.9, "angle": 80.0}, {"reduced_area": 0.8, "angle": 20.0, "center": [2.1, 1.5]}]
CELL = {"vesicle": TWO, "cell": {"lattice": [[4.0, 0.0], [0.0, 4.0]]}}
VISCOUS = {"fluid": {"viscosity_ratio": 5.0}}


def _field(**more) -> dict:
    return {"field": FIELD["field"] | more}


def _time(kind, **numbers) -> dict:
    return {"time": {"kind": kind} | numbers}


MODELS = {
    "contrast": ONE | FIELD | SHEAR | VISCOUS,
    "thin inside": ONE | FIELD | SHEAR | {"fluid": {"viscosity_ratio": 1e-3}},
    "relaxing charge": ONE | _field(**CHARGE),
    "relaxing charge and contrast": ONE | _field(**CHARGE) | SHEAR | VISCOUS,
    "resolved AC": ONE | _field(**_time("ac", frequency=100.0, offset=0.3, phase=20.0)),
    "averaged AC": ONE | _field(**_time("ac", frequency=100.0, averaged=True, offset=0.3, phase=20.0)),
    "averaged AC, relaxing charge": ONE | _field(**CHARGE, **_time("ac", frequency=100.0, averaged=True)),
    "pulse": ONE | _field(**_time("pulse", start=0.002, duration=0.005, rise=0.001)),
    "oscillating Poiseuille": ONE
    | {"flow": {"kind": "poiseuille", "capillary_number": 10.0, "half_width": 2.0}
       | _time("sine", frequency=30.0, offset=0.5)},
    "near contact, contrast, relaxing charge": CONTACT | _field(**CHARGE) | VISCOUS,
    "sheared cell": CELL | FIELD | SHEAR,
    "sheared cell, contrast": CELL | SHEAR | VISCOUS,
}  # fmt: skip
QUICK = dict(along={"field.beta": np.linspace(5.6, 7.2, 3)}, N=32, t_end=0.5, scenes={})


def treading(N):
    """Returns the paper's vesicle in shear and field."""
    field = {"beta": 6.4, "conductivity_ratio": 0.1, "membrane_conductance": 4.0}
    vesicle = {"reduced_area": 0.9, "angle": 10.0}
    return parse({"t_end": 1.0, "vesicle": [vesicle], "field": field, **SHEAR, "numerics": {"nodes": N}})


@eqx.filter_jit
def _start(scene, t_end):
    result = simulate(scene, t_end, saves=1, march=Adaptive(1e-6))
    return Unknowns.of(result.state.y.x, result.state.y.V_m)


@eqx.filter_jit
def _next(file, values, start):
    return steady_shape(scene_of(file, values), start)


def followed(file, y, before, values, longest=0.1):
    """The steady shape at `values`, from that at `before`: in their logarithms no step is longer than `longest`."""
    away = {name: np.log(values[name] / before[name]) for name in values}
    steps = max(1, int(np.ceil(max(map(abs, away.values())) / longest)))
    for i in range(1, steps + 1):
        found = _next(file, {name: np.float64(before[name] * np.exp(away[name] * i / steps)) for name in values}, y)
        y = found.y
    return found


def curve(file, start, name, places):
    """[μ], inclination and ∂[μ] in all numbers of `CENTRE` along `name`, from its central value outward."""
    quantities = ("effective_viscosity", "inclination")
    middle = int(np.argmin(np.abs(places - CENTRE[name])))
    rows = {}
    for order in (range(middle, len(places)), range(middle - 1, -1, -1)):
        y, before = start, CENTRE
        for i in order:
            values = {key: np.float64(value) for key, value in (CENTRE | {name: places[i]}).items()}
            found = followed(file, y, before, values)
            y, before = found.y, values
            outputs, slopes = sensitivity.jacobian(sensitivity.AtRest(file, quantities, y), values)
            rows[i] = {
                "value": float(places[i]),
                "viscosity": float(outputs["effective_viscosity"]),
                "inclination": float(outputs["inclination"][0]),
                "slopes": {key: float(slope) for key, slope in slopes["effective_viscosity"].items()},
                "last step": float(found.last_step),
            }
    return [rows[i] for i in sorted(rows)]


def spline_slopes(rows, name):
    """d[μ]/d`name` of the cubic spline through the curve; in log Λ for Λ, where it is smooth."""
    x = np.array([row["value"] for row in rows])
    y = np.array([row["viscosity"] for row in rows])
    if name == "field.conductivity_ratio":
        return CubicSpline(np.log(x), y).derivative()(np.log(x)) / x
    return CubicSpline(x, y).derivative()(x)


def checked(tables, N=32, t_end=0.01, steps=10):
    """Returns the largest deviations over all numbers and diagnostics of a scene."""
    jax.clear_caches()  # the programs of all scenes together take more pieces of memory than Linux grants
    file = parse({"t_end": 1.0, "numerics": {"nodes": N}, **tables})
    rows = list(gradcheck.check_gradients(file, t_end, steps))
    outcome = sensitivity.AtEnd(file, gradcheck.quantities_of(file), t_end, march=Fixed(2))
    # Δ has no derivative at a circle.
    values = {n: np.float64(v) for n, v in numbers(file).items() if not (n.endswith("reduced_area") and v == 1)}
    # Forward over reverse of close evaluation and of sums over images takes minutes to compile.
    few = {"pair.offset_angle", "field.beta", "cell.lattice[0][0]", "flow.capillary_number"}
    if file.pair is None and file.cell is None:
        weights = jax.tree.map(lambda leaf: np.ones(leaf.shape), eqx.filter_eval_shape(outcome, values))
        curved = sensitivity.hessian_product(outcome, values, weights, {name: np.float64(1.0) for name in values})
    else:
        curved = sensitivity.second_order(outcome, {name: values[name] for name in few & set(values)})
    return {
        "second derivatives finite": all(np.all(np.isfinite(value)) for value in jax.tree.leaves(curved)),
        "numbers": len({row.number for row in rows}),
        "diagnostics": len({row.quantity for row in rows}),
        "forward - reverse": float(np.nanmax([row.modes for row in rows])),
        "forward - differences": float(np.nanmax([row.deviation for row in rows])),
        "verdicts": {verdict: sum(row.verdict == verdict for row in rows) for verdict in {r.verdict for r in rows}},
    }


def run(along=ALONG, N=64, t_end=1.5, scenes=SCENES):
    """Curves with derivatives; what is left of the run's end by Newton's method; the checks of derivatives."""
    file = treading(N)
    start = _start(scene_of(file, {}), t_end)
    curves = {name: curve(file, start, name, np.asarray(places)) for name, places in along.items()}
    values = {name: np.float64(value) for name, value in CENTRE.items()}
    outcomes = {
        "implicit": sensitivity.AtRest(file, ("effective_viscosity",), start),
        "through the run": sensitivity.AtEnd(file, ("effective_viscosity",), t_end, march=Adaptive(1e-6)),
    }
    return {"curves": curves, "cost": cost(outcomes, values), "checks": {k: checked(v) for k, v in scenes.items()}}


def cost(outcomes, values, repeats=3):
    """Returns the seconds of one tangent, measured in turns, and its derivative in β."""
    seconds = {name: [] for name in outcomes}
    slopes = {}
    tangent = {name: np.float64(name == "field.beta") for name in values}
    for turn in range(repeats + 1):
        for name, outcome in outcomes.items():
            began = time.perf_counter()
            _, found = jax.block_until_ready(sensitivity.pushed(outcome, values, tangent))
            if turn:  # the first one compiles
                seconds[name].append(time.perf_counter() - began)
            slopes[name] = float(found["effective_viscosity"])
    return {name: {"seconds": float(np.median(seconds[name])), "d[μ]/dβ": slopes[name]} for name in outcomes}


@styled
def draw(found) -> Figure:
    """Draws [μ] along each number, and its derivative with the slope of the curve."""
    figure = Figure(figsize=(run_plots.PAGE, 3.6))
    axes = figure.subplots(2, len(found["curves"]), sharex="col", squeeze=False)
    for column, (name, rows) in zip(axes.T, found["curves"].items(), strict=True):
        x = [row["value"] for row in rows]
        column[0].plot(x, [row["viscosity"] for row in rows], "o-", ms=2.5)
        column[1].plot(x, [row["slopes"][name] for row in rows], "o", ms=3, label="implicit derivative")
        column[1].plot(x, spline_slopes(rows, name), color="C1", lw=1, label="slope of the curve")
        symbol = SYMBOLS[name]
        column[1].set(xlabel=symbol, ylabel=rf"$\partial[\mu]/\partial${symbol}")
        if name == "field.conductivity_ratio":
            column[1].set(xscale="log")
    axes[0, 0].set(ylabel=r"$[\mu]$")
    axes[1, -1].legend()
    return figure


def models(names=tuple(MODELS), keep=lambda found: None, **how) -> dict:
    """Returns the checks of scenes of all models by name; `keep` stores what is known so far."""
    found = {}
    for name in names:
        found[name] = checked(MODELS[name], **how)
        print(name, found[name], flush=True)
        keep(found)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", action="store_true", help="check scenes of all models")
    if parser.parse_args().models:
        models(keep=lambda found: store("sensitivity", found, "models"))
        return
    found = run()
    for name, rows in found["curves"].items():
        print(f"{SYMBOLS[name]}        [μ]        inclination/π  ∂[μ]/∂Λ    ∂[μ]/∂β    ∂[μ]/∂Δ    slope of the curve")
        for row, slope in zip(rows, spline_slopes(rows, name), strict=True):
            slopes = "  ".join(f"{value:9.5f}" for value in row["slopes"].values())
            angle = row["inclination"] / np.pi
            print(f"{row['value']:<8.4g} {row['viscosity']:.6f}   {angle:.5f}   {slopes}  {slope:.5f}")
    for name, row in found["cost"].items():
        print(f"{name}: {row['seconds']:.3f} s a tangent, ∂[μ]/∂β = {row['d[μ]/dβ']:.6f}")
    for name, row in found["checks"].items():
        print(name, row)
    store("sensitivity", found)
    save(draw(found), "sensitivity")


if __name__ == "__main__":
    main()
