"""Charge on the interfaces relaxes in a finite time; on a circle everything is known in closed form."""

import re

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm

import jaxves
from jaxves.equation.electrics import MembraneCharging
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.inputs.checking import SceneError
from jaxves.inputs.scene_files import parse
from jaxves.operators.pairs import Pairwise
from jaxves.operators.sums import MatrixFree
from jaxves.operators.surfaces import Surfaces
from jaxves.physics.scene import dc_field, make_scene
from jaxves.runs.problem import reconstructed
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate
from jaxves.stepping.schemes import SemiImplicitEuler

N = 16


def circle_system(ratio, conductance, chi, epsilon, delta):
    """dy/dt = A y + f of y = (Q, W) for the mode along the field, and the matrix from (Q, W, 1) to (c, b).

    E_n,i = c, E_n,e = 1 - b and V = 1 + b - c, times the cosine of the angle from the field.
    """
    # Q = 1 - b - ε c,  W = 1 + b - c - (δ/2)(ε c + 1 - b)
    of_cb = np.array([[-epsilon, -1.0], [-1 - delta * epsilon / 2, 1 + delta / 2]])
    constant = np.array([1.0, 1 - delta / 2])
    to_cb = np.linalg.inv(of_cb)
    # χδ Q' = Λ c - (1 - b),  χ W' = ½(Λ c + 1 - b) - G (1 + b - c)
    rate = np.array([[ratio, 1.0], [ratio / 2 + conductance, -0.5 - conductance]])
    rate_constant = np.array([-1.0, 0.5 - conductance])
    scale = np.array([1 / (chi * delta), 1 / chi])
    A = scale[:, None] * (rate @ to_cb)
    f = scale * (rate_constant - rate @ to_cb @ constant)
    return A, f, to_cb, constant


def circle_history(times, ratio, conductance, chi, epsilon, delta):
    """c and b at the times after a field is switched on at an uncharged circle."""
    A, f, to_cb, constant = circle_system(ratio, conductance, chi, epsilon, delta)
    rest = np.linalg.solve(A, -f)
    return np.array([to_cb @ (rest - expm(A * t) @ rest - constant) for t in times])


@eqx.filter_jit
def run(scene, times, tolerance=1e-6):
    return simulate(scene, times=times, march=Adaptive(tolerance))


TIMES = np.array([1e-4, 1e-3, 0.01, 0.1, 1.0])


def test_a_circle_charges_at_both_rates_with_the_amplitudes_of_the_closed_form():
    numbers = dict(ratio=0.3, conductance=0.5, chi=0.08, epsilon=0.6, delta=0.05)
    field = dc_field(
        2.0, conductivity_ratio=0.3, membrane_conductance=0.5, permittivity_ratio=0.6, charge_relaxation=0.05
    )
    result = run(make_scene(shapes.circle(N), field=field), TIMES)
    c, b = circle_history(np.concatenate([[0.0], TIMES]), **numbers).T
    # at once c = D/ε and b = 1 - D with D = 2/(1 + 1/ε + δ)
    D = 2 / (1 + 1 / 0.6 + 0.05)
    np.testing.assert_allclose([c[0], b[0]], [D / 0.6, 1 - D], rtol=1e-12)
    amplitude = 2 * np.mean(np.asarray(result.V_m[:, 0]) * np.asarray(result.x[0, 0, :, 1]), axis=1)
    np.testing.assert_allclose(amplitude, 1 + b - c, atol=1e-5)
    Q = np.asarray(result.state.y.scalars["Q"][0])
    np.testing.assert_allclose(Q, (1 - b[-1] - 0.6 * c[-1]) * np.asarray(result.x[0, 0, :, 1]), atol=1e-5)
    np.testing.assert_allclose(result.diagnostics["charge"], 0.0, atol=1e-12)


NUMBERS = dict(conductivity_ratio=0.3, permittivity_ratio=0.6, membrane_conductance=0.2)


@eqx.filter_jit
def from_a_potential(x, delta):
    """The motion at a start with a given potential and relaxed charge, and the nodes and the potential later."""
    scene = make_scene(x, field=dc_field(3.0, **NUMBERS, charge_relaxation=delta))
    scene = eqx.tree_at(lambda s: s.V_m, scene, 0.4 * scene.x[..., 1], is_leaf=lambda f: f is None)
    equation = equation_for(scene)
    y = Unknowns(scene.x, equation.electrics.start(scene, lambda: Surfaces.of(scene.x, electric=True)))
    motion = equation.motion(jnp.zeros(()), y)
    march, h = Fixed(1), 1e-3
    later = jax.lax.fori_loop(0, 12, lambda i, y: march.step(equation, i * h, y, (i + 1) * h), y)
    potential = equation.motion(jnp.zeros(()), later).electric.potential(later.scalars)
    start = motion.velocity, motion.rates["V_m" if delta is None else "W"], motion.electric.potential(y.scalars)
    return start, (later.x, potential)


def test_for_fast_relaxation_the_model_becomes_that_of_the_paper_with_an_error_proportional_to_delta():
    """At a start with relaxed charge, even the motion is the same."""
    ellipse = shapes.ellipse(32, 0.97, angle=1.2)
    x = jax.jit(lambda x: equation_for(make_scene(x)).settled(Unknowns(x[None])).x[0])(ellipse)
    start, later = from_a_potential(x, None)
    errors = []
    for delta in (1e-3, 1e-4, 1e-5):
        found, after = from_a_potential(x, jnp.asarray(delta))
        for a, b in zip(found, start, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-9)
        errors.append([float(jnp.max(jnp.abs(a - b))) for a, b in zip(after, later, strict=True)])
    slopes = -np.diff(np.log10(errors), axis=0)
    np.testing.assert_allclose(slopes, 1.0, atol=0.1, err_msg=str(errors))


def pair(gap, coupling):
    """The equation of two different vesicles with numbers of their own, and a state without symmetry."""
    shape = shapes.ellipse(32, 0.95, angle=0.7)
    field = dc_field(
        3.0, conductivity_ratio=[0.3, 2.0], permittivity_ratio=[0.6, 1.5], membrane_conductance=[0.2, 0.0],
        chi=[0.08, 0.05], charge_relaxation=0.05, vesicles=2,
    )  # fmt: skip
    scene = make_scene([shape, shapes.circle(32)], centers=[[0.0, 0.0], [2.0 + gap, 0.3]], field=field)
    x, y = scene.x[..., 0], scene.x[..., 1]
    return equation_for(scene, coupling=coupling), Unknowns(scene.x, {"Q": 0.2 * y - 0.1, "W": 0.3 * y + 0.1 * x})


@pytest.mark.parametrize("gap", [0.3, 0.02])
def test_a_stage_of_several_vesicles_solves_for_the_scalars_of_all_together_apart_and_in_contact(gap):
    c = jnp.asarray(3e-3)

    @eqx.filter_jit
    def stage(coupling):
        equation, y = pair(gap, coupling)
        surfaces = equation._surfaces(jnp.zeros(()), y)
        solve = equation.electrics.solve_stage
        found, solution = solve(jnp.zeros(()), surfaces, y.scalars, c, direct=equation.coupling.direct)
        again, _ = solve(jnp.zeros(()), surfaces, found.found, 0 * c, direct=equation.coupling.direct)
        return found, again, solution.residual, y.scalars

    found, again, residual, start = stage(Pairwise(direct=True))
    for name in ("Q", "W"):
        np.testing.assert_allclose(found.found[name], start[name] + c * found.scalar_rates[name], atol=1e-12)
        np.testing.assert_allclose(again.scalar_rates[name], found.scalar_rates[name], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(again.traction, found.traction, atol=1e-9 * float(jnp.max(jnp.abs(found.traction))))
    assert float(jnp.max(residual)) < 1e-12
    for coupling in (Pairwise(direct=False), MatrixFree(2)):
        other = stage(coupling)[0]
        np.testing.assert_allclose(other.V_m, found.V_m, atol=1e-9)
        np.testing.assert_allclose(other.traction, found.traction, atol=1e-8 * float(jnp.max(jnp.abs(found.traction))))


def test_the_net_charge_of_each_vesicle_relaxes_by_itself_whatever_the_shapes():
    """t_c d(∮Q)/dt = -∮Q and χ d(∮W)/dt = ½ ∮Q - G ∮V."""
    equation, y = pair(0.3, None)
    motion = eqx.filter_jit(equation.motion)(jnp.zeros(()), y)
    weights, field = motion.surfaces.curves.weights, equation.scene.field

    def net(f):
        return jnp.sum(weights * f, axis=1)

    V_m = motion.electric.potential(y.scalars)
    charge = net(y.scalars["Q"])
    assert float(jnp.min(jnp.abs(charge))) > 0.1
    np.testing.assert_allclose(net(motion.rates["Q"]), -charge / (0.08 * 0.05), rtol=1e-6)
    expected = (0.5 * charge - field.membrane_conductance * net(V_m)) / field.membrane_chi
    np.testing.assert_allclose(net(motion.rates["W"]), expected, rtol=1e-6)


def test_derivatives_in_relaxation_and_permittivity_are_those_of_differences_in_both_modes():
    x = shapes.ellipse(N, 0.95, angle=0.7)

    @jax.jit
    def outcome(numbers):
        delta, epsilon = numbers
        field = dc_field(6.0, conductivity_ratio=0.3, permittivity_ratio=epsilon, charge_relaxation=delta)
        equation = equation_for(make_scene(x, field=field))
        y = Fixed(1).step(equation, jnp.zeros(()), equation.start(), jnp.asarray(4e-3))
        weight = jnp.cos(jnp.arange(N))
        return jnp.sum(weight * (y.x[0, :, 0] + y.scalars["Q"][0] + y.scalars["W"][0]))

    at, h = jnp.array([0.05, 0.7]), 1e-4
    reverse = jax.jit(jax.grad(outcome))(at)
    forward = jax.jit(lambda e: jax.jvp(outcome, (at,), (e,))[1])
    for i, e in enumerate(np.eye(2)):
        np.testing.assert_allclose(forward(e), reverse[i], rtol=1e-9)
        one, two = ((outcome(at + k * h * e) - outcome(at - k * h * e)) / (2 * k * h) for k in (1, 2))
        np.testing.assert_allclose(reverse[i], (4 * one - two) / 3, rtol=1e-6)


def test_without_the_number_nothing_of_it_is_built():
    plain = equation_for(make_scene(shapes.circle(N), field=dc_field(1.0, conductivity_ratio=0.5)))
    assert type(plain.electrics) is MembraneCharging and not plain.is_staged
    assert plain.scene.field.charge_relaxation is None


def test_the_lipid_carries_the_share_of_the_capacitor_beside_the_tension():
    """On a circle with V = V_0 sin θ its greatest value is above that of λ by (β/2χδ) V_0²."""
    field = dc_field(2.0, conductivity_ratio=1.0, charge_relaxation=0.1)
    found = run(make_scene(shapes.circle(N), field=field), TIMES[-1:], 1e-4)
    V_0 = found.diagnostics["max_V_m"][-1, 0]
    lipid, tension = found.diagnostics["lipid_tension_max"][-1, 0], found.tension[-1, 0]
    at_poles = np.argmax(np.abs(np.asarray(found.x[-1, 0, :, 1])))
    np.testing.assert_allclose(lipid, tension[at_poles] + 2.0 / (2 * 0.08 * 0.1) * V_0**2, rtol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"field": {"conductivity_ratio": float("inf")}}, "field.conductivity_ratio = inf"),
        ({"numerics": {"method": "euler", "time_step": 1e-3}}, 'numerics.method = "euler"'),
    ],
)
def test_scene_files_refuse_what_relaxation_does_not_support(change, message):
    tables = {"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}]}
    tables["field"] = {"beta": 1.0, "conductivity_ratio": 0.1, "charge_relaxation": 0.01} | change.pop("field", {})
    with pytest.raises(SceneError, match=re.escape(message)):
        parse(tables | change)


def test_python_refuses_what_relaxation_does_not_support():
    with pytest.raises(ValueError, match="charge_relaxation"):
        dc_field(1.0, conductivity_ratio=float("inf"), charge_relaxation=0.1)
    with pytest.raises(ValueError, match="ARK4"):
        field = dc_field(1.0, conductivity_ratio=1.0, charge_relaxation=0.1)
        march = Fixed(1, SemiImplicitEuler())
        jax.eval_shape(lambda: simulate(make_scene(shapes.circle(N), field=field), 0.1, saves=1, march=march))


def test_a_result_file_has_the_charge_and_a_run_resumes_and_is_drawn_from_it(tmp_path):
    tables = {
        "t_end": 0.02,
        "saves": 2,
        "vesicle": [{"reduced_area": 0.95, "angle": 60.0}],
        "field": {"beta": 2.0, "conductivity_ratio": 0.5, "charge_relaxation": 0.05},
        "numerics": {"nodes": 32, "time_step": 5e-3, "certify": False},
    }
    path = tmp_path / "run.h5"
    assert jaxves.run(tables, path) == "complete"
    record = jaxves.read_result(path)
    assert record.scalars["Q"].shape == record.V_m.shape
    equation, t, y = reconstructed(record, 0.02)
    V_m = equation.motion(jnp.asarray(t), y).electric.potential(y.scalars)
    np.testing.assert_allclose(V_m, record.V_m[-1], atol=1e-9)
    assert jaxves.run(tables | {"t_end": 0.03, "saves": 3}, path, resume=True) == "complete"
    longer = jaxves.read_result(path)
    assert len(longer.t) == 4 and np.max(np.abs(longer.diagnostics["interfacial_charge"])) < 1e-12
    with pytest.raises(jaxves.StoreError, match="takes over V_m, but not Q and W"):
        jaxves.run(tables, tmp_path / "next.h5", start=path)
    shapes_only = {name: table for name, table in tables.items() if name != "field"}
    assert jaxves.run(shapes_only, tmp_path / "next.h5", start=path) == "complete"
