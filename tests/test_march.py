"""Marching in time: order, constraints, tolerance, ends, and derivatives of whole runs."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import circle, observed_order

from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.numerics import fourier
from jaxves.observables.checks import Checks
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.physics.waveform import Pulse
from jaxves.stepping import marching, schemes
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate


def pop(N=64):
    return make_scene(shapes.ellipse(N, 0.9, angle=jnp.pi / 2), field=dc_field(3.2, conductivity_ratio=0.1))


def treading(N=64):
    """Tank-treading in a field, from 20°."""
    field = dc_field(6.4, conductivity_ratio=0.1, membrane_conductance=4.0)
    return make_scene(shapes.ellipse(N, 0.9, angle=jnp.deg2rad(20.0)), field=field, flow=Shear(10.0))


@eqx.filter_jit
def run(s, t_end, march, saves=1, checks=None, average=None):
    return simulate(s, t_end, saves=saves, march=march, checks=checks, average=average)


@pytest.mark.parametrize(("make", "t_end"), [(pop, 0.3), (treading, 0.2)])
def test_the_fourth_order_method_is_of_fourth_order_in_shape_potential_and_tension(make, t_end):
    """At 96 nodes, where the error of space (and of projecting onto it every step) is below that of time."""
    s, steps = make(96), [80, 160, 320]
    reference = run(s, t_end, Fixed(480, schemes.ARK5()))
    errors = {"x": [], "V_m": [], "tension": []}
    for n in steps:
        result = run(s, t_end, Fixed(n))
        assert result.word == "complete"
        for part, found in errors.items():
            found.append(jnp.max(jnp.abs(getattr(result, part)[-1] - getattr(reference, part)[-1])))
        for kept in ("area", "length"):
            values = result.diagnostics[kept][:, 0]
            assert abs(values[-1] / values[0] - 1) < 1e-9
    for part, found in errors.items():
        assert observed_order([1 / n for n in steps], found) > 3.7, (part, found)


def test_the_papers_scheme_is_of_first_order():
    march = [Fixed(n, schemes.SemiImplicitEuler(), projection=False) for n in (20, 40, 80)]
    reference = run(pop(), 0.1, Fixed(80))
    errors = [jnp.max(jnp.abs(run(pop(), 0.1, m).x[-1] - reference.x[-1])) for m in march]
    assert abs(observed_order([1 / 20, 1 / 40, 1 / 80], errors) - 1) < 0.2, errors


def test_tableaus_meet_the_order_conditions_they_claim():
    """Row sums agree; Σ b c^k = 1/(k+1) for both weights; embedded weights one order less."""
    for stepper in (schemes.ARK4(), schemes.ARK5()):
        table = stepper.tableau
        np.testing.assert_allclose(table.implicit.sum(axis=1), table.times, atol=2e-15)
        embedded = table.weights - table.error_weights
        for k in range(stepper.order):
            np.testing.assert_allclose(table.weights @ table.times**k, 1 / (k + 1), atol=1e-14)
            if k < stepper.order - 1:
                np.testing.assert_allclose(embedded @ table.times**k, 1 / (k + 1), atol=1e-14)
        for left in (table.explicit, table.implicit):  # the order-3 tree Σ b a c = 1/6
            np.testing.assert_allclose(table.weights @ left @ table.times, 1 / 6, atol=1e-14)


@pytest.mark.parametrize("stepper", [schemes.ARK4(), schemes.ARK5()], ids=["ARK4", "ARK5"])
def test_the_error_follows_the_tolerance(stepper):
    """Above 1e-5 stability sets the steps, and the error stays below; with 64 nodes space would end it at 1e-7."""
    reference = run(pop(96), 0.3, Adaptive(1e-10, schemes.ARK5()), saves=3)
    tolerances = [1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8]
    errors = []
    for tolerance in tolerances:
        result = run(pop(96), 0.3, Adaptive(tolerance, stepper), saves=3)
        errors.append(jnp.max(jnp.abs(result.x - reference.x)))
        assert errors[-1] < 10 * tolerance
    assert max(errors[:2]) < 1e-4, errors
    assert 0.8 < observed_order(tolerances[2:], errors[2:]) < 1.3, errors


def test_charging_of_a_circle_is_the_closed_form():
    """V_m = 2Λ/(1+Λ)/r · sin θ · (1 - e^{-rt/χ}), r = G + Λ/(1+Λ): β = 0 leaves the circle at rest."""
    ratio, G, chi = 5.0, 0.5, 0.08
    s = make_scene(circle(32), field=dc_field(0.0, conductivity_ratio=ratio, membrane_conductance=G, chi=chi))
    result = run(s, 0.2, Fixed(100), saves=4)
    rate = G + ratio / (1 + ratio)
    exact = 2 * ratio / (1 + ratio) / rate * (1 - jnp.exp(-rate * result.t / chi))
    error = result.V_m[:, 0] - exact[:, None] * jnp.sin(fourier.grid(32))
    assert jnp.max(jnp.abs(error)) < 1e-8


def test_a_net_potential_decays_at_the_rate_of_the_conductance():
    """∮ V_m ds ~ e^{-Gt/χ}, whatever the shape does."""
    s = pop()
    field = eqx.tree_at(lambda f: f.membrane_conductance, s.field, jnp.array([0.2]))
    s = Scene(s.x, s.bending, field, None, 0.3 * jnp.ones((1, 64)))
    result = run(s, 0.1, Adaptive(1e-7), saves=2)
    np.testing.assert_allclose(jnp.mean(result.V_m[-1]), 0.3 * jnp.exp(-0.2 * 0.1 / 0.08), rtol=1e-6)


def test_without_field_and_flow_the_bending_energy_only_falls():
    result = run(make_scene(shapes.ellipse(64, 0.7)), 0.5, Adaptive(1e-5), saves=20)
    energy = result.diagnostics["bending_energy"][:, 0]
    assert jnp.all(jnp.diff(energy) < 1e-9)
    assert energy[0] - energy[-1] > 0.1


def test_the_mirror_symmetry_of_a_start_is_kept():
    result = run(pop(), 0.2, Adaptive(1e-5), saves=1)
    x = result.x[-1, 0]
    reflected = jnp.roll((x * jnp.array([1.0, -1.0]))[::-1], 1, axis=0)  # α → -α about the first node, on the y axis
    mirrored = jnp.roll((x * jnp.array([-1.0, 1.0]))[::-1], 1, axis=0)
    assert min(jnp.max(jnp.abs(reflected - x)), jnp.max(jnp.abs(mirrored - x))) < 1e-9


def test_an_arbitrary_start_ends_prolate_or_oblate():
    """A lobed blob with Δ = 0.8: along the field when the membrane insulates, across it when it conducts."""
    alpha = fourier.grid(256)
    radius = 1 + 0.25 * jnp.cos(3 * alpha) + 0.1 * jnp.sin(2 * alpha)
    blob = radius[:, None] * jnp.stack([jnp.cos(alpha), jnp.sin(alpha)], axis=-1)
    x = shapes.scaled(shapes.equispaced(blob, 64), 1.0)
    for conductance, expected in ((0.0, 0.38), (1.0, -0.38)):
        field = dc_field(3.2, conductivity_ratio=0.1, membrane_conductance=conductance)
        result = run(make_scene(x, field=field), 2.0, Adaptive(1e-3), saves=4)
        assert result.word == "complete"
        assert abs(result.diagnostics["deformation_along_field"][-1, 0] - expected) < 0.01


def test_projection_is_worth_its_price():
    """Same steps without it: area and length drift, and the shape is further off."""
    reference = run(pop(), 0.2, Fixed(100))
    errors, drifts = {}, {}
    for on in (True, False):
        result = run(pop(), 0.2, Fixed(20, projection=on))
        errors[on] = jnp.max(jnp.abs(result.x[-1] - reference.x[-1]))
        drifts[on] = abs(result.diagnostics["length"][-1, 0] / (2 * np.pi) - 1)
    assert drifts[False] > 1e2 * drifts[True]
    assert errors[False] > 2 * errors[True]


@pytest.mark.parametrize(("tolerance", "bound"), [(1e-4, 1e-4), (1e-3, 5e-3)])
def test_round_off_in_the_highest_modes_does_not_grow_to_what_the_tolerance_lets_pass(tolerance, bound):
    """Steady treading at steps on the edge of stability: [μ] is seen to be steady, with no more steps than without."""

    s = make_scene(shapes.ellipse(64, 0.7, angle=jnp.deg2rad(20.0)), flow=Shear(10.0))
    noise, steps = {}, {}
    for weight in (30.0, 0.0):
        result = run(s, 4.0, Adaptive(tolerance, edge_weight=weight), saves=40)
        noise[weight] = float(jnp.ptp(result.diagnostics["effective_viscosity"][20:]))
        steps[weight] = int(result.state.steps + result.state.rejected)
    assert noise[30.0] < bound and noise[0.0] > 20 * noise[30.0], noise
    assert steps[30.0] < 1.1 * steps[0.0], steps


def test_an_adaptive_run_stops_where_the_tolerance_is_out_of_reach():
    result = run(treading(), 1.0, Adaptive(1e-3, smallest=1e-3), saves=4)
    assert result.word == "step underflow"
    assert jnp.isnan(result.t[-1])


def test_a_fixed_step_that_is_too_large_ends_with_a_name():
    result = run(treading(), 1.0, Fixed(2), saves=4)
    assert result.word in {"not finite", "drift", "unresolved", "self-contact", "solve failed"}


def test_too_few_nodes_are_named_unresolved():
    s = make_scene(shapes.ellipse(24, 0.5, angle=jnp.pi / 2), field=dc_field(12.8, conductivity_ratio=0.1))
    result = run(s, 0.1, Adaptive(1e-3), saves=10)
    assert int(result.status) >= status.UNRESOLVED


def test_a_steady_state_ends_the_run_early():
    result = run(
        make_scene(shapes.ellipse(48, 0.9)), 20.0, Adaptive(1e-5), saves=20, checks=Checks(steady=jnp.asarray(1e-4))
    )
    assert result.word == "steady"
    assert jnp.isnan(result.t[-1])


def test_time_averages_are_those_of_a_fine_history():
    result = run(treading(), 0.4, Adaptive(1e-6), saves=40, average=jnp.array([0.2, 0.4]))
    late = result.t >= 0.2 - 1e-12
    t, mu = result.t[late], result.diagnostics["effective_viscosity"][late]
    np.testing.assert_allclose(result.averages["effective_viscosity"], np.trapezoid(mu, t) / 0.2, rtol=1e-3)
    theta = result.diagnostics["inclination"][late, 0]
    np.testing.assert_allclose(result.averages["inclination"][0], np.trapezoid(theta, t) / 0.2, rtol=1e-3)


def test_a_pulse_ends_and_the_vesicle_discharges():
    s = pop()
    s = eqx.tree_at(lambda s: s.field.history, s, Pulse(0.02, 0.05, 1e-3), is_leaf=lambda v: v is None)
    result = run(s, 0.4, Adaptive(1e-4), saves=20)
    V = result.diagnostics["max_V_m"][:, 0]
    assert result.word == "complete"
    assert V[1] < 1e-6 < 0.05 < jnp.max(V)
    assert V[-1] < 0.8 * jnp.max(V)


def test_runs_differentiate_forward_backward_and_as_differences_do():
    """d(deformation, viscosity, potential)/d(every number) through 4 fixed steps of the coupled problem."""
    base = treading(48)

    def numbers(s):
        f = s.field
        electric = (f.beta, f.conductivity_ratio, f.membrane_conductance, f.membrane_chi, f.permittivity_ratio)
        return (*electric, f.direction, s.flow.capillary_number, s.bending)

    def outcome(scales):
        s = eqx.tree_at(numbers, base, tuple(leaf * scales[i] for i, leaf in enumerate(numbers(base))))
        result = simulate(s, 0.01, saves=1, march=Fixed(4))
        d = result.diagnostics
        return d["deformation"][-1, 0] + 0.1 * d["effective_viscosity"][-1] + 0.1 * d["max_V_m"][-1, 0]

    ones = jnp.ones(len(numbers(base)))
    forward, reverse = jax.jit(jax.jacfwd(outcome))(ones), jax.jit(jax.grad(outcome))(ones)
    np.testing.assert_allclose(forward, reverse, rtol=1e-8, atol=1e-10)
    h, value = 1e-3, jax.jit(outcome)

    def difference(step):
        return (value(ones + step) - value(ones - step)) / (2 * h)

    for i in range(len(ones)):
        step = h * jnp.eye(len(ones))[i]
        richardson = (4 * difference(step) - difference(2 * step) / 2) / 3
        np.testing.assert_allclose(forward[i], richardson, rtol=1e-6, atol=1e-9)


def test_a_batch_of_scenes_is_the_scenes_one_by_one():
    base = pop()
    betas = jnp.array([1.0, 3.2])

    def outcome(beta):
        s = eqx.tree_at(lambda s: s.field.beta, base, beta)
        result = simulate(s, 0.05, saves=1, march=Adaptive(1e-4))
        return result.x[-1], result.state.steps

    x, steps = jax.jit(jax.vmap(outcome))(betas)
    for i in range(2):
        alone, count = jax.jit(outcome)(betas[i])
        assert steps[i] == count
        np.testing.assert_allclose(x[i], alone, atol=1e-10)


def test_a_scene_is_built_and_run_without_callbacks_so_that_its_program_can_be_kept_on_disk():
    def work(reduced_area):
        field = dc_field(3.2, conductivity_ratio=0.1)
        scene = make_scene(shapes.ellipse(16, reduced_area), field=field, flow=Shear(1.0))
        return jnp.sum(simulate(scene, 0.1, march=Adaptive(1e-3)).x)

    assert "callback" not in jax.jit(jax.value_and_grad(work)).lower(0.9).as_text()


def test_outside_of_jit_a_run_is_compiled_once_whatever_its_numbers(calls_of):
    traced = calls_of(marching, "stops_of")
    for beta, t_end in ((3.2, 0.01), (1.0, 0.02)):
        scene = make_scene(shapes.ellipse(36, 0.9), field=dc_field(beta, conductivity_ratio=0.1))
        result = simulate(scene, t_end, saves=1)
        assert result.word == "complete" and result.t[-1] == t_end
    assert len(traced) == 1
