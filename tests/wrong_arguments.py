"""Wrong input from Python, each call with what its complaint must say, for `test_arguments`.

Run as a program, in a process without the type checks of the test suite, which users do not have either: prints what
every call raised, as JSON.
"""

import json

import jax.numpy as jnp
import numpy as np
import optax

import jaxves
from jaxves.analysis import critical_field, fit, gradcheck, sensitivity
from jaxves.analysis.observations import Observations
from jaxves.inputs.scene_files import parse
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed

E = jaxves.ellipse(64, 0.9, angle=np.pi / 2)
SCENE = jaxves.make_scene(E, field=jaxves.dc_field(3.2, conductivity_ratio=0.1))
NAN, INF = float("nan"), float("inf")
T = np.linspace(0, 2 * np.pi, 64, endpoint=False)
EIGHT = np.stack([np.sin(T), np.sin(2 * T)], axis=-1)
FOLDED = np.where(np.arange(64)[:, None] == 5, E[0], E)


def field(**changed):
    return jaxves.dc_field(**({"beta": 3.2, "conductivity_ratio": 0.1} | changed))


def pair(**changed):
    return jaxves.make_scene(**({"shapes": [E, E], "centers": [[0, 0], [3, 0]]} | changed))


SINE = {"beta": 3.2, "conductivity_ratio": 0.1, "time": {"kind": "sine", "frequency": 2.0}}


def case(**tables):
    return parse(
        {"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}], "field": {"beta": 3.2, "conductivity_ratio": 0.1}} | tables
    )


def observed(**changed):
    values = {"t_end": 0.1, "seen": {"deformation": np.zeros((2, 1))}, "deviation": {"deformation": 0.1}}
    return Observations(**(values | changed))


def swept(**conditions):
    return observed(
        seen={"deformation": np.zeros((2, 1, 1))}, conditions={f"field.{name}": c for name, c in conditions.items()}
    )


def fitted(bounds, **changed):
    return fit.fit(changed.pop("scene", case()), bounds, changed.pop("observations", observed()), **changed)


WRONG = {
    # the starting curves
    "nodes of one column": (lambda: jaxves.make_scene(E[:, :1]), "shapes .*64, 1"),
    "nodes of three columns": (lambda: jaxves.make_scene(np.zeros((64, 3))), "shapes .*64, 3"),
    "an odd number of nodes": (lambda: jaxves.make_scene(E[:-1]), "shapes .*63, 2"),
    "few nodes": (lambda: jaxves.make_scene(E[::16]), "shapes .*4, 2"),
    "no nodes": (lambda: jaxves.make_scene(np.zeros((0, 2))), "shapes .*0, 2"),
    "no curve": (lambda: jaxves.make_scene([]), "shapes"),
    "curves of different nodes": (lambda: jaxves.make_scene([E, E[::2]]), "shapes .*64, 2.*32, 2"),
    "a word for nodes": (lambda: jaxves.make_scene("ellipse"), "shapes"),
    "None for nodes": (lambda: jaxves.make_scene(None), "shapes"),
    "a flat list of numbers": (lambda: jaxves.make_scene(list(range(64))), "shapes .*64"),
    "four dimensions": (lambda: jaxves.make_scene(np.zeros((1, 1, 64, 2))), "shapes"),
    "a node that is NaN": (lambda: jaxves.make_scene(E.at[3, 1].set(NAN)), r"shapes\[3\]"),
    "an infinite node": (lambda: jaxves.make_scene(E.at[7, 0].set(INF)), r"shapes\[7\]"),
    "a figure of eight": (lambda: jaxves.make_scene(EIGHT), "shapes.*crosses itself"),
    "nodes that are all the same": (lambda: jaxves.make_scene(np.ones((64, 2))), "shapes.*coincide"),
    "two neighbours that coincide": (lambda: jaxves.make_scene(np.repeat(E[::2], 2, axis=0)), "shapes.*coincide"),
    "a node out of order": (lambda: jaxves.make_scene(FOLDED), "shapes.*crosses itself"),
    "the second curve crosses itself": (lambda: jaxves.make_scene([E, EIGHT + 9]), r"shapes\[1\].*crosses itself"),
    "two curves in one place": (lambda: jaxves.make_scene([E, E]), "curves of which 0 and 1 overlap"),
    "two curves that overlap": (lambda: pair(centers=[[0, 0], [1, 0]]), "0 and 1 overlap"),
    "one curve inside of another": (lambda: jaxves.make_scene([E, 0.3 * E]), "0 and 1 overlap"),
    "the last two of three overlap": (lambda: jaxves.make_scene([E, E + 5, E + 5.1]), "1 and 2 overlap"),
    "one center for two": (lambda: pair(centers=[0.0, 0.0]), r"centers .*\(2, 2\).*\(2,\)"),
    "three centers for two": (lambda: pair(centers=np.zeros((3, 2))), r"centers .*\(2, 2\).*\(3, 2\)"),
    "a center that is NaN": (lambda: pair(centers=[[0, 0], [NAN, 3]]), r"centers\[1, 0\] = nan"),
    "a center in words": (lambda: pair(centers="left"), "centers = left"),
    "bending that is negative": (lambda: jaxves.make_scene(E, bending=-1.0), "bending.* = -1.0"),
    "bending that is zero": (lambda: jaxves.make_scene(E, bending=0), "bending.* = 0"),
    "bending that is NaN": (lambda: jaxves.make_scene(E, bending=NAN), "bending.* = nan"),
    "bending of three for two": (lambda: pair(bending=[1.0, 1.0, 1.0]), r"bending .*\(2,\).*\(3,\)"),
    "a number for the field": (lambda: jaxves.make_scene(E, field=3.2), "field = 3.2"),
    "a word for the flow": (lambda: jaxves.make_scene(E, flow="shear"), "flow = shear"),
    "a field for three with two": (lambda: pair(field=field(vesicles=3)), "3 vesicles.*2"),
    "Scene with clockwise nodes": (lambda: jaxves.Scene(E[None, ::-1], [1.0]), "clockwise"),
    "Scene with one curve of two axes": (lambda: jaxves.Scene(E, [1.0]), "Scene.x .*64, 2"),
    "Scene with bending of two": (lambda: jaxves.Scene(E[None], [1.0, 1.0]), "Scene.bending"),
    "a viscosity ratio of zero": (lambda: jaxves.make_scene(E, viscosity_ratio=0.0), "viscosity_ratio.* = 0"),
    "viscosity ratios of two for one": (
        lambda: jaxves.make_scene(E, viscosity_ratio=[1.0, 2.0]), r"viscosity_ratio .*\(1,\).*\(2,\)",
    ),
    "Scene with V_m but no field": (lambda: jaxves.Scene(E[None], [1.0], V_m=jnp.zeros((1, 64))), "Scene.V_m"),
    "Scene with V_m of another size": (
        lambda: jaxves.Scene(E[None], [1.0], field(), V_m=jnp.zeros((1, 32))), "Scene.V_m .*1, 64.*1, 32",
    ),
    "Scene with V_m that is NaN": (
        lambda: jaxves.Scene(E[None], [1.0], field(), V_m=jnp.full((1, 64), NAN)), "Scene.V_m.*nan",
    ),
    # shapes
    "an ellipse of area 1.2": (lambda: jaxves.ellipse(64, 1.2), "reduced_area = 1.2"),
    "an ellipse of area 0": (lambda: jaxves.ellipse(64, 0.0), "reduced_area = 0"),
    "an ellipse that is too flat": (lambda: jaxves.ellipse(64, 1e-3), "reduced_area = 0.001"),
    "an ellipse of negative area": (lambda: jaxves.ellipse(64, -0.9), "reduced_area = -0.9"),
    "an ellipse of odd nodes": (lambda: jaxves.ellipse(65, 0.9), "N = 65"),
    "an ellipse of 64.0 nodes": (lambda: jaxves.ellipse(64.0, 0.9), "N = 64.0"),
    "an ellipse of two nodes": (lambda: jaxves.ellipse(2, 0.9), "N = 2"),
    "an ellipse of no length": (lambda: jaxves.ellipse(64, 0.9, length=0.0), "length = 0"),
    "an ellipse of infinite angle": (lambda: jaxves.ellipse(64, 0.9, angle=INF), "angle = inf"),
    "an ellipse in words": (lambda: jaxves.ellipse(64, "flat"), "reduced_area = flat"),
    "a circle of negative length": (lambda: jaxves.circle(64, length=-1.0), "length = -1"),
    "a circle of no nodes": (lambda: jaxves.circle(0), "N = 0"),
    "an excess of 2": (lambda: jaxves.ellipse_of_excess(64, 2.0), "excess = 2"),
    "a disturbance that is NaN": (lambda: jaxves.disturbed(E, NAN), "amplitude = nan"),
    "a disturbance of no curve": (lambda: jaxves.disturbed(E[:, 0], 1e-6), r"x must .*\(64,\)"),
    # the field and its time
    "beta that is negative": (lambda: field(beta=-1.0), "beta = -1"),
    "beta that is infinite": (lambda: field(beta=INF), "beta = inf"),
    "beta in words": (lambda: field(beta="strong"), "beta = strong"),
    "beta that is missing": (lambda: field(beta=None), "beta = None"),
    "beta that is True": (lambda: field(beta=True), "beta = True"),
    "beta of two": (lambda: field(beta=[1.0, 2.0]), "beta"),
    "a conductivity ratio that is negative": (lambda: field(conductivity_ratio=-0.1), "conductivity_ratio = -0.1"),
    "a conductivity ratio that is NaN": (lambda: field(conductivity_ratio=NAN), "conductivity_ratio = nan"),
    "two ratios for one vesicle": (lambda: field(conductivity_ratio=[0.1, 0.2]), "conductivity_ratio = .*vesicles"),
    "a conductance that is negative": (lambda: field(membrane_conductance=-1.0), "membrane_conductance = -1"),
    "chi that is negative": (lambda: field(chi=-0.08), "chi = -0.08"),
    "chi that is zero": (lambda: field(chi=0.0), "chi = 0"),
    "a permittivity ratio of zero": (lambda: field(permittivity_ratio=0.0), "permittivity_ratio = 0"),
    "no direction": (lambda: field(direction=(0.0, 0.0)), "direction = .*not both zero"),
    "a direction in space": (lambda: field(direction=(0.0, 0.0, 1.0)), "direction"),
    "a direction that is NaN": (lambda: field(direction=(NAN, 1.0)), r"direction\[0\] = nan"),
    "no vesicles": (lambda: field(vesicles=0), "vesicles = 0"),
    "one vesicle and a half": (lambda: field(vesicles=1.5), "vesicles = 1.5"),
    "a number for the history": (lambda: field(history=0.5), "history = 0.5"),
    "a pulse that ends before it begins": (lambda: jaxves.Pulse(0.0, -1.0, 1e-3), "Pulse.duration = -1"),
    "a pulse without flanks": (lambda: jaxves.Pulse(0.0, 1.0, 0.0), "Pulse.rise = 0"),
    "a sine that does not turn": (lambda: jaxves.Sine(0.0), "Sine.frequency = 0"),
    "a table that goes back": (
        lambda: jaxves.PiecewiseLinear([0.0, 2.0, 1.0], [1.0, 1.0, 1.0]),
        "PiecewiseLinear.times",
    ),
    "a table of one instant": (lambda: jaxves.PiecewiseLinear([0.0], [1.0]), "PiecewiseLinear.times"),
    "a table with a value too few": (lambda: jaxves.PiecewiseLinear([0.0, 1.0], [1.0]), "PiecewiseLinear.values"),
    "a table with a value that is NaN": (
        lambda: jaxves.PiecewiseLinear([0.0, 1.0], [1.0, NAN]),
        r"PiecewiseLinear.values\[1\] = nan",
    ),
    # flows
    "a shear of no strength": (lambda: jaxves.Shear(0.0), "Shear.capillary_number = 0"),
    "a shear that is NaN": (lambda: jaxves.Shear(NAN), "Shear.capillary_number = nan"),
    "a shear of two strengths": (lambda: jaxves.Shear([1.0, 2.0]), "Shear.capillary_number"),
    "an extension of no strength": (lambda: jaxves.Extension(0), "Extension.capillary_number = 0"),
    "a flow with a source": (
        lambda: jaxves.LinearFlow([[1.0, 0.0], [0.0, 1.0]]),
        "LinearFlow.velocity_gradient.*trace-free",
    ),
    "a gradient of one number": (lambda: jaxves.LinearFlow(1.0), "LinearFlow.velocity_gradient"),
    "a gradient that is NaN": (
        lambda: jaxves.LinearFlow([[0.0, NAN], [0.0, 0.0]]),
        r"LinearFlow.velocity_gradient\[0, 1\]",
    ),
    # runs
    "an end before the start": (lambda: jaxves.simulate(SCENE, -1.0), "t_end = -1"),
    "an end at the start": (lambda: jaxves.simulate(SCENE, 0.0), "t_end = 0"),
    "an end that is NaN": (lambda: jaxves.simulate(SCENE, NAN), "t_end = nan"),
    "two ends": (lambda: jaxves.simulate(SCENE, [1.0, 2.0]), "t_end"),
    "an end in words": (lambda: jaxves.simulate(SCENE, "late"), "t_end = late"),
    "no saves": (lambda: jaxves.simulate(SCENE, 1.0, saves=0), "saves = 0"),
    "half a save": (lambda: jaxves.simulate(SCENE, 1.0, saves=0.5), "saves = 0.5"),
    "negative saves": (lambda: jaxves.simulate(SCENE, 1.0, saves=-3), "saves = -3"),
    "saves that are True": (lambda: jaxves.simulate(SCENE, 1.0, saves=True), "saves = True"),
    "an average beyond the end": (lambda: jaxves.simulate(SCENE, 1.0, average=(0.5, 2.0)), "average = .*t_end"),
    "an average that goes back": (lambda: jaxves.simulate(SCENE, 1.0, average=(0.5, 0.2)), "average ="),
    "an average of one time": (lambda: jaxves.simulate(SCENE, 1.0, average=0.5), "average = 0.5"),
    "neither end nor times": (lambda: jaxves.simulate(SCENE), "t_end = None, expected the end of the run"),
    "times and an end": (lambda: jaxves.simulate(SCENE, 1.0, times=[0.5, 1.0]), "t_end = 1.0, expected no such"),
    "times and saves": (lambda: jaxves.simulate(SCENE, saves=2, times=[0.5, 1.0]), "saves = 2, expected no such"),
    "times that go back": (lambda: jaxves.simulate(SCENE, times=[0.5, 0.2]), r"times\[1\] = 0.2, expected a flat list"),
    "a time twice": (lambda: jaxves.simulate(SCENE, times=[0.5, 0.5]), r"times\[1\] = 0.5"),
    "times from the start": (lambda: jaxves.simulate(SCENE, times=[0.0, 0.5]), r"times\[0\] = 0.0"),
    "a time that is NaN": (lambda: jaxves.simulate(SCENE, times=[0.1, NAN]), r"times\[1\] = nan"),
    "a time without end": (lambda: jaxves.simulate(SCENE, times=[0.1, INF]), r"times\[1\] = inf"),
    "no times": (lambda: jaxves.simulate(SCENE, times=[]), r"times = \[\]"),
    "one time for times": (lambda: jaxves.simulate(SCENE, times=0.5), "times = 0.5"),
    "a table of times": (lambda: jaxves.simulate(SCENE, times=[[0.1, 0.2]]), r"times = \[\[0.1, 0.2\]\]"),
    "a ragged table of times": (lambda: jaxves.simulate(SCENE, times=[[0.1], [0.1, 0.2]]), "times ="),
    "words for times": (lambda: jaxves.simulate(SCENE, times=["soon", "late"]), "times ="),
    "an average beyond all times": (
        lambda: jaxves.simulate(SCENE, times=[0.5, 1.0], average=(0.5, 2.0)), "average = .*the last of times",
    ),
    "nodes for a scene": (lambda: jaxves.simulate(E, 1.0), "scene = .*a Scene"),
    "a tolerance for a march": (lambda: jaxves.simulate(SCENE, 1.0, march=1e-4), "march = 0.0001"),
    "a tolerance of zero": (lambda: Adaptive(0.0), "Adaptive.tolerance = 0"),
    "a tolerance of one": (lambda: Adaptive(1.0), "Adaptive.tolerance = 1"),
    "a tolerance that is NaN": (lambda: Adaptive(NAN), "Adaptive.tolerance = nan"),
    "adaptive steps without an estimate": (lambda: Adaptive(1e-4, jaxves.SemiImplicitEuler()), "Adaptive.stepper"),
    "a word for a scheme": (lambda: Adaptive(1e-4, "ark4"), "Adaptive.stepper = ark4"),
    "no steps": (lambda: Fixed(0), "Fixed.steps_per_save = 0"),
    "half a step": (lambda: Fixed(0.5), "Fixed.steps_per_save = 0.5"),
    "a scheme in words": (lambda: Fixed(3, "euler"), "Fixed.stepper = euler"),
    "no recorded steps": (lambda: Adaptive(1e-4, recorded=0), "Adaptive.recorded = 0"),
    # scene files, sweeps, sensitivities, fits, critical fields
    "a scene file that is a number": (lambda: sensitivity.AtEnd(1.0, ("deformation",)), "scene_file"),
    "a scene file changed by hand": (
        lambda: sensitivity.AtEnd(case().model_copy(update={"t_end": -1.0}), ("deformation",)), "t_end = -1.0",
    ),
    "one word of quantities": (lambda: sensitivity.AtEnd(case(), "deformation"), "quantities = 'deformation'"),
    "no quantities": (lambda: sensitivity.AtEnd(case(), ()), r"quantities = \(\)"),
    "an unknown quantity": (lambda: sensitivity.AtEnd(case(), ("size",), 0.01, march=Fixed(1))({}), "'size'"),
    "a sensitivity before the start": (lambda: sensitivity.AtEnd(case(), ("deformation",), -0.1), "t_end = -0.1"),
    "averages without a window": (lambda: sensitivity.AtEnd(case(), ("stress",), averaged=True), "averaged"),
    "a number that the scene has not": (
        lambda: sensitivity.AtEnd(case(), ("deformation",))({"field.betta": 1.0}), "field.betta",
    ),
    "adaptive nodes in a sensitivity": (
        lambda: sensitivity.AtEnd(case(numerics={"nodes": "auto"}), ("deformation",)), 'numerics.nodes = "auto"',
    ),
    "an early end in a sensitivity": (lambda: sensitivity.AtEnd(case(stop={"steady": 1e-3}), ("area",)), "stop"),
    "a gradient check with adaptive nodes": (
        lambda: list(gradcheck.check_gradients(case(numerics={"nodes": "auto"}), 0.1, 3)), 'numerics.nodes = "auto"',
    ),
    "no bounds": (lambda: fitted({}), "bounds"),
    "bounds of an unknown number": (lambda: fitted({"field.betta": (1.0, 2.0)}), "field.betta"),
    "bounds that go back": (lambda: fitted({"field.beta": (4.0, 2.0)}), "field.beta"),
    "bounds that no scene may have": (lambda: fitted({"field.beta": (-4.0, 2.0)}), "field.beta"),
    "a method in words": (lambda: fitted({"field.beta": (1.0, 4.0)}, method="adam"), "method = adam"),
    "a method with a line search": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, method=optax.lbfgs()), "method = an optimiser whose update",
    ),
    "one bound": (lambda: fitted({"field.beta": 3.0}), "field.beta"),
    "nothing seen": (lambda: fitted({"field.beta": (1.0, 4.0)}, observations=observed(seen={})), "observations.seen"),
    "seen without deviation": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, observations=observed(deviation={})), "observations.deviation",
    ),
    "seen in the past": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, observations=observed(t_end=-0.1)), "observations.t_end = -0.1",
    ),
    "seen as NaN": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, observations=observed(seen={"deformation": np.full((2, 1), NAN)})),
        "observations.seen.*deformation",
    ),
    "conditions of two lengths": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, observations=swept(chi=[0.1, 0.2], beta=[1.0])),
        "observations.conditions: shapes",
    ),
    "conditions for three runs with two": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, observations=swept(chi=[0.1, 0.2, 0.3])),
        r"deformation has shape \(2, 1, 1\), expected \(3, T, ...\)",
    ),
    "a condition that no scene may have": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, observations=swept(chi=[0.1, -0.2])), "field.chi = -0.2",
    ),
    "a condition that is an unknown": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, observations=swept(beta=[1.0, 2.0])), "field.beta is an unknown too",
    ),
    "no starts": (lambda: fitted({"field.beta": (1.0, 4.0)}, starts=0), "starts = 0"),
    "a fit with an early end": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, scene=case(stop={"steady": 1e-3})), "stop",
    ),
    "a fit that certifies": (
        lambda: fitted({"field.beta": (1.0, 4.0)}, scene=case(numerics={"certify": True})), "numerics.certify",
    ),
    "a bracket that goes back": (lambda: critical_field.critical_field(case(), (4.0, 2.0)), "bracket"),
    "a bracket of one": (lambda: critical_field.critical_field(case(), 4.0), "bracket"),
    "a bracket below zero": (lambda: critical_field.critical_field(case(), (-1.0, 2.0)), "bracket"),
    "a critical field with adaptive nodes": (
        lambda: critical_field.critical_field(case(numerics={"nodes": "auto"}), (1.0, 2.0)), 'numerics.nodes = "auto"',
    ),
    "a critical value of a number that is none": (lambda: jaxves.critical_value(case(), "beta"), "name = 'beta'"),
    "a critical value from zero": (
        lambda: jaxves.critical_value(case(), "field.membrane_conductance"), "field.membrane_conductance = 0",
    ),
    "a critical value in a field that changes": (
        lambda: jaxves.critical_value(case(field=SINE), "field.beta"), 'field.time.kind = "sine"',
    ),
    "a critical value near other nodes": (
        lambda: jaxves.critical_value(case(), "field.beta", near=jaxves.Unknowns.of(E[None, ::2])), "near.x = shape",
    ),
    "rates of no disturbance": (lambda: jaxves.stability(SCENE, jaxves.Unknowns.of(E[None]), count=0), "count = 0"),
    "stability in a flow that is curved": (
        lambda: jaxves.stability(jaxves.make_scene(E, flow=jaxves.Poiseuille(1.0, 3.0)), jaxves.Unknowns.of(E[None])),
        "scene = not symmetric about a point",
    ),
    "stability in a field with a period": (
        lambda: jaxves.stability(
            jaxves.make_scene(E, field=jaxves.dc_field(1.0, conductivity_ratio=0.5, history=jaxves.AC(5.0))),
            jaxves.Unknowns.of(E[None], E[None, :, 0]),
        ),
        "scene = a field or flow with a period",
    ),
    "a run of a name that is none": (lambda: jaxves.run("popp", "never.h5"), "popp"),
    "a run of nothing": (lambda: jaxves.run(None, "never.h5"), "scene_file"),
    "a sweep without a scene": (lambda: jaxves.sweep({"axes": {"field.beta": [1.0]}}, "never.h5"), "scene"),
    "a sweep without cases": (lambda: jaxves.sweep({"scene": "pop"}, "never.h5"), "axes"),
    "a sweep of a number that is none": (
        lambda: jaxves.sweep({"scene": "pop", "axes": {"field.betta": [1.0]}}, "never.h5"), "field.betta",
    ),
    "a sweep on no device": (
        lambda: jaxves.sweep({"scene": "pop", "axes": {"field.beta": [1.0]}}, "never.h5", devices=0), "devices = 0",
    ),
    "a sweep in batches of none": (
        lambda: jaxves.sweep({"scene": "pop", "axes": {"field.beta": [1.0]}}, "never.h5", batch=0), "batch = 0",
    ),
    "a sweep with adaptive nodes": (
        lambda: jaxves.sweep(
            {"scene": {"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}], "numerics": {"nodes": "auto"}},
             "axes": {"vesicle.reduced_area": [0.9]}}, "never.h5"
        ),
        'numerics.nodes = "auto"',
    ),
}  # fmt: skip


def complaint(call) -> tuple[str, str]:
    """The kind of error that the call raises, and its message; two empty texts where it raises none."""
    try:
        call()
    except Exception as error:
        return type(error).__name__, str(error)
    return "", ""


if __name__ == "__main__":
    found = {name: (said, *complaint(call)) for name, (call, said) in WRONG.items()}
    print(json.dumps(found))
