"""Imposed flows that are not linear in position, functions of the user, and flows that depend on time."""

import tomllib

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import diagnosed, motion_of

import jaxves
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.inputs.checking import SceneError
from jaxves.inputs.parameters import numbers
from jaxves.inputs.scene_files import parse, to_toml
from jaxves.physics.flow import FlowFunction
from jaxves.stepping.loop import stops_of

CA, W = 4.0, 3.0
NODES = jaxves.ellipse(32, 0.95, angle=0.4) + jnp.array([0.2, 0.5])
POINTS = jnp.array([[0.3, 0.2], [-1.1, 0.7], [0.6, -1.3]])


class Channel(eqx.Module):
    """Poiseuille flow as a user would write it, with numbers that can be differentiated."""

    strength: jax.Array
    width: jax.Array

    def __call__(self, x, t):
        return jnp.array([self.strength * (1 - (x[1] / self.width) ** 2), 0.0])


def plain(x, t):
    return jnp.array([CA * (1 - (x[1] / W) ** 2), 0.0])


def scene_in(flow, **others):
    return jaxves.make_scene(NODES, flow=flow, **others)


def velocity_in(flow):
    return motion_of(scene_in(flow), Unknowns.of(NODES[None])).velocity


def test_poiseuille_flow_is_a_stokes_flow_with_the_stated_pressure():
    """∇·v = 0, and the divergence of the stress -p + ∇v + ∇vᵀ vanishes."""
    flow = jaxves.Poiseuille(CA, W)

    def stress(x):
        rows = [flow.traction(x[None], n[None], jnp.zeros(()))[0] for n in jnp.eye(2)]
        return jnp.stack(rows, axis=-1)

    def velocity(x):
        return flow.velocity(x, jnp.zeros(()))

    for x in POINTS:
        gradient = jax.jacfwd(velocity)(x)
        np.testing.assert_allclose(jnp.trace(gradient), 0, atol=1e-15)
        pressure = -2 * CA * x[0] / W**2
        np.testing.assert_allclose(stress(x), -pressure * jnp.eye(2) + gradient + gradient.T, atol=1e-14)
        np.testing.assert_allclose(jnp.einsum("abb->a", jax.jacfwd(stress)(x)), 0, atol=1e-14)
    np.testing.assert_allclose(velocity(jnp.array([7.0, W])), 0, atol=1e-15)


def test_a_function_of_ones_own_moves_a_vesicle_like_the_built_in_flow():
    built_in = velocity_in(jaxves.Poiseuille(CA, W))
    assert float(jnp.abs(built_in).max()) > 1
    np.testing.assert_allclose(velocity_in(plain), built_in, atol=1e-13)
    np.testing.assert_allclose(velocity_in(Channel(jnp.array(CA), jnp.array(W))), built_in, atol=1e-13)
    shear = velocity_in(lambda x, t: jnp.array([2.0 * x[1], 0.0]))
    np.testing.assert_allclose(shear, velocity_in(jaxves.Shear(2.0)), atol=1e-13)


@pytest.mark.parametrize("flow", [jaxves.Poiseuille, lambda Ca, w: Channel(jnp.asarray(Ca), jnp.asarray(w))])
def test_numbers_of_a_flow_have_derivatives(flow):
    """Forward and reverse mode and central differences of the velocity of a vesicle, in Ca and w."""

    @jax.jit
    def speed(numbers):
        motion = equation_for(scene_in(flow(*numbers))).motion(jnp.zeros(()), Unknowns.of(NODES[None]))
        return jnp.sum(motion.velocity[..., 0] * jnp.arange(32.0))

    at, h = jnp.array([CA, W]), 1e-4
    reverse = jax.grad(speed)(at)
    for i, direction in enumerate(jnp.eye(2)):
        _, forward = jax.jvp(speed, (at,), (direction,))
        difference = (speed(at + h * direction) - speed(at - h * direction)) / (2 * h)
        np.testing.assert_allclose(forward, difference, rtol=1e-6)
        np.testing.assert_allclose(reverse[i], forward, rtol=1e-10)


@pytest.mark.parametrize("ratio", [None, 3.0])
def test_the_energy_balance_holds_in_poiseuille_flow(ratio):
    """To the error of 32 nodes, which is the same without a flow; without the pressure the balance lacks 10 %."""
    nodes = jaxves.ellipse(32, 0.98, angle=0.4) + jnp.array([0.2, 0.5])
    scene = jaxves.make_scene(nodes, flow=jaxves.Poiseuille(CA, W), viscosity_ratio=ratio)
    found = diagnosed(scene, Unknowns.of(nodes[None]))
    assert abs(float(found["power_balance"][()])) < 1e-6 * abs(float(found["power_flow"][()]))
    assert "effective_viscosity" not in found and "stress" in found


def test_a_flow_without_a_known_pressure_is_refused_where_viscosities_differ():
    with pytest.raises(ValueError, match="flow whose pressure is known where viscosities differ"):
        diagnosed(scene_in(plain, viscosity_ratio=3.0), Unknowns.of(NODES[None]))


def test_symmetry_is_kept_in_linear_flows_alone():
    assert equation_for(scene_in(jaxves.Shear(1.0))).symmetry is not None
    oscillating = jaxves.TimeDependent(jaxves.Shear(1.0), jaxves.Sine(5.0))
    assert equation_for(scene_in(oscillating)).symmetry is not None
    for flow in (jaxves.Poiseuille(1.0), plain, jaxves.TimeDependent(jaxves.Poiseuille(1.0), jaxves.Sine(5.0))):
        assert equation_for(scene_in(flow)).symmetry is None


def test_a_factor_of_time_scales_the_flow_and_steps_end_at_its_kinks():
    steady, start = jaxves.Shear(CA), jaxves.PiecewiseLinear([0.1, 0.2], [0.0, 1.0])
    flow = jaxves.TimeDependent(steady, start)
    for t, factor in ((0.05, 0.0), (0.15, 0.5), (0.3, 1.0)):
        at = jnp.asarray(t)
        np.testing.assert_allclose(flow.velocity(NODES, at), factor * steady.velocity(NODES, at), atol=1e-12)
    np.testing.assert_allclose(sorted(stops_of(scene_in(flow), 1.0)), [0.1, 0.2, 1.0], atol=1e-12)
    assert len(stops_of(scene_in(steady), 1.0)) == 1
    assert flow.effective_viscosity(jnp.eye(2)) is None


def test_steps_see_every_period_of_an_oscillating_flow_and_averages_take_whole_periods():
    """The flow is so weak that the error estimate alone would let steps skip its periods."""
    flow = jaxves.TimeDependent(jaxves.Shear(1e-9), jaxves.Sine(20.0))
    scene = jaxves.make_scene(jaxves.circle(16), flow=flow)
    result = jaxves.simulate(scene, 0.5, saves=1)
    assert result.word == "complete" and int(result.state.steps) >= 0.5 * 20 * 8
    np.testing.assert_allclose(sorted(stops_of(scene, 0.5, jnp.array([0.1, 0.48]))), [0.1, 0.45, 0.5], atol=1e-12)


FILE = """
t_end = 1.0
vesicle = [{ reduced_area = 0.95 }]
[flow]
kind = "poiseuille"
capillary_number = 4.0
half_width = 3.0
[flow.time]
kind = "sine"
frequency = 5.0
"""


def test_a_scene_file_has_poiseuille_flow_and_the_time_dependence_of_any_flow():
    file = parse(tomllib.loads(FILE))
    assert parse(tomllib.loads(to_toml(file))) == file
    flow = jaxves.scene_of(file, {"flow.time.frequency": 2.0, "flow.half_width": W}).flow
    np.testing.assert_allclose(flow.history(jnp.asarray(0.125)), 1.0)
    np.testing.assert_allclose(flow.velocity(POINTS[None], jnp.asarray(0.125))[0], [plain(x, 0.0) for x in POINTS])
    assert numbers(file)["flow.time.frequency"] == 5.0
    with pytest.raises(SceneError, match=r"flow.time.kind = \"square\""):
        parse(tomllib.loads(FILE.replace('"sine"', '"square"')))
    with pytest.raises(SceneError, match=r"numerics.time_step = 0.1, expected at most 0.025, an eighth .* of the flow"):
        parse(tomllib.loads(FILE + "[numerics]\ntime_step = 0.1\n"))


def test_a_period_that_no_run_can_resolve_is_refused():
    """With eight steps for each period, t_end = 1 has room for 25,000 periods."""
    base = "t_end = 1.0\n[[vesicle]]\nreduced_area = 0.9\n"
    field = base + '[field]\nbeta = 1.0\nconductivity_ratio = 0.1\n[field.time]\nkind = "ac"\nfrequency = 3e4\n'
    parse(tomllib.loads(field.replace("3e4", "2e4")))
    parse(tomllib.loads(field + "averaged = true\n"))
    parse(tomllib.loads(field + "[stop]\nsteady = 1e-3\n"))  # may end in time
    parse(tomllib.loads(field + "[numerics]\ntime_step = 1e-6\n"))
    expected = r"field.time.frequency = 30000.0, expected at most 25000 for this t_end, .*; or averaged = true"
    with pytest.raises(SceneError, match=expected):
        parse(tomllib.loads(field))
    with pytest.raises(SceneError, match=r"flow.time.frequency = 100000.0, expected at most 25000 for .* 200000$"):
        parse(tomllib.loads(FILE.replace("frequency = 5.0", "frequency = 1e5")))


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x, t: x, r"divergence 2 at x = \[0.3, 0.2\], t = 0.0, expected a divergence-free flow"),
        (lambda x, t: jnp.sum(x), r"an array of shape \(\), expected a function v\(x, t\)"),
        (lambda x: x, "expected a function v"),
    ],
)
def test_what_is_no_flow_is_refused_in_one_line(function, message):
    with pytest.raises(ValueError, match=message) as refused:
        scene_in(function)
    assert "\n" not in str(refused.value)


def test_a_function_passes_through_transformations_of_jax():
    """A scene with a function of one's own is a pytree of arrays, whose function is part of its structure."""
    scene = scene_in(plain)
    assert isinstance(scene.flow, FlowFunction) and all(eqx.is_array(leaf) for leaf in jax.tree.leaves(scene))
    batch = jax.vmap(lambda Ca: scene_in(Channel(Ca, jnp.array(W))).flow.velocity(POINTS, 0.0))(jnp.array([1.0, CA]))
    np.testing.assert_allclose(batch[1], 4 * batch[0])
