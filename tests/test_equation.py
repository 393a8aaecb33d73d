"""The velocity F(y): forces, conservation, exact solutions on a circle, invariance, and what absence leaves out."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import circle, diagnosed, motion_of

from jaxves.equation.equation import equation_for
from jaxves.equation.projection import Filter
from jaxves.equation.state import Unknowns
from jaxves.geometry import curve, shapes
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.physics import electric, flow, membrane
from jaxves.physics.scene import dc_field, make_scene

ELLIPSE = dict(N=64, reduced_area=0.9, angle=0.4)


def field(**changes):
    return dc_field(**(dict(beta=3.2, conductivity_ratio=0.1, membrane_conductance=0.3) | changes))


def both():
    return make_scene(shapes.ellipse(**ELLIPSE), field=field(), flow=flow.Shear(10.0))


def charged(s, amplitude=0.4):
    """A state with a potential that has no symmetry."""
    alpha = fourier.grid(s.x.shape[1])
    return Unknowns.of(s.x, None if s.field is None else amplitude * (jnp.sin(alpha) + 0.3 * jnp.cos(2 * alpha))[None])


def test_both_forms_of_the_elastic_force_are_one_at_high_resolution():
    """-x_ssss + (σ x_s)_s = f_b + f_λ with λ = σ + (3/2)κ²."""
    c, bending = Curve.from_nodes(shapes.ellipse(256, 0.9)), jnp.asarray(1.3)
    sigma = jnp.exp(jnp.sin(fourier.grid(256)))
    linear = membrane.linear_bending_force(c, bending) + membrane.linear_tension_force(c, sigma)
    tension = membrane.physical_tension(c, sigma, bending)
    physical = membrane.bending_force(c, bending) + membrane.linear_tension_force(c, tension)
    np.testing.assert_allclose(linear, physical, atol=1e-7 * jnp.max(jnp.abs(linear)))


def test_membrane_forces_have_no_resultant_and_no_torque():
    s = both()
    motion = motion_of(s, charged(s))
    c = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
    elastic = (motion.f_hd + motion.electric.traction)[0] * c.weights[:, None]
    scale = jnp.sum(jnp.abs(elastic))
    np.testing.assert_allclose(jnp.sum(elastic, axis=0), 0, atol=1e-13 * scale)
    torque = jnp.sum(c.x[:, 0] * elastic[:, 1] - c.x[:, 1] * elastic[:, 0])
    np.testing.assert_allclose(torque, 0, atol=1e-7 * scale)


def test_the_electric_force_has_no_resultant_and_its_torque_is_that_of_the_dipole():
    s = both()
    motion = motion_of(s, charged(s))
    c = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
    f_el = motion.electric.traction[0] * c.weights[:, None]
    scale = jnp.sum(jnp.abs(f_el))
    np.testing.assert_allclose(jnp.sum(f_el, axis=0), 0, atol=1e-8 * scale)
    d = diagnosed(s, charged(s))
    E = s.field.E_inf(jnp.zeros(()))
    cross = d["dipole"][0, 0] * E[1] - d["dipole"][0, 1] * E[0]
    np.testing.assert_allclose(jnp.abs(d["torque"][0]), s.field.stress_scale() * jnp.abs(cross), atol=1e-8 * scale)


def test_the_net_charge_of_a_membrane_is_zero():
    for ratio in (0.0, 0.1, 1.0, 7.0, jnp.inf):
        s = eqx.tree_at(lambda s: s.field, both(), field(conductivity_ratio=ratio))
        motion = motion_of(s, charged(s))
        weights = motion.surfaces.curves.weights
        assert jnp.all(jnp.isfinite(motion.velocity)), ratio
        assert abs(jnp.sum(weights * motion.electric.w)) < 1e-12 * jnp.sum(weights * jnp.abs(motion.electric.w)), ratio


def test_the_membrane_does_not_stretch():
    """Up to the modes that the velocity loses in the filter: spectrally small."""
    relative = []
    for N in (48, 96, 192):
        s = make_scene(shapes.ellipse(N, 0.9, angle=0.4), field=field(), flow=flow.Shear(10.0))
        motion = motion_of(s, charged(s))
        c = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
        stretch = membrane.stretch_rate(c, motion.velocity[0])
        relative.append(jnp.max(jnp.abs(stretch)) / jnp.max(jnp.abs(curve.d_ds(motion.velocity[0], c))))
    assert relative[1] < 0.1 * relative[0]
    assert relative[2] < 1e-8


def test_the_energy_balance_closes_to_discretisation_error():
    """dE_b/dt = power of flow and field - dissipation, spectrally accurate."""
    relative = []
    for N in (48, 96):
        s = make_scene(shapes.ellipse(N, 0.9, angle=0.4), field=field(), flow=flow.Shear(10.0))
        d = diagnosed(s, charged(s))
        assert d["dissipation"] > 0
        relative.append(abs(d["power_balance"] / d["dissipation"]))
    assert relative[1] < 1e-9
    assert relative[1] < 0.1 * relative[0] or relative[0] < 1e-12


def test_charge_on_a_circle_is_the_closed_form():
    """Uncharged: w = 2 E·n. With V_m = V sin θ: w = (2E - V) sin θ for E along y."""
    for ratio in (0.0, 0.1, 5.0, jnp.inf):
        s = make_scene(circle(32), field=field(conductivity_ratio=ratio))
        y = Unknowns.of(s.x, 0.7 * jnp.sin(fourier.grid(32))[None])
        w = motion_of(s, y).electric.w[0]
        np.testing.assert_allclose(w, (2 - 0.7) * jnp.sin(fourier.grid(32)), atol=1e-12)


def test_fields_inside_an_uncharged_dielectric_disk_are_uniform():
    """E_i = 2/(1+Λ) E, and the traction follows from E_n, E_t of the two sides."""
    ratio = 0.25
    s = make_scene(circle(64), field=field(conductivity_ratio=ratio))
    motion = motion_of(s, Unknowns.of(s.x, jnp.zeros((1, 64))))
    alpha = fourier.grid(64)
    inner = 2 / (1 + ratio)
    np.testing.assert_allclose(motion.electric.fields.inner_normal[0], inner * jnp.sin(alpha), atol=1e-12)
    np.testing.assert_allclose(motion.electric.fields.outer_normal[0], inner * ratio * jnp.sin(alpha), atol=1e-12)
    np.testing.assert_allclose(motion.electric.fields.inner_tangential[0], inner * jnp.cos(alpha), atol=1e-12)
    np.testing.assert_allclose(motion.electric.fields.outer_tangential[0], inner * jnp.cos(alpha), atol=1e-12)
    jump = 0.5 * inner**2 * (1 - ratio**2) * jnp.sin(alpha) ** 2
    shear = inner**2 * (1 - ratio) * jnp.sin(alpha) * jnp.cos(alpha)
    c = Curve.from_nodes(s.x[0])
    expected = s.field.stress_scale() * (jump[:, None] * c.normal + shear[:, None] * c.tangent)
    np.testing.assert_allclose(motion.electric.traction[0], expected, atol=1e-10 * s.field.stress_scale())


def test_the_inner_share_and_its_derivative_hold_from_zero_to_infinity():
    for ratio, share, slope in [(0.0, 0.0, 1.0), (1.0, 0.5, 0.25), (3.0, 0.75, 1 / 16), (jnp.inf, 1.0, 0.0)]:
        np.testing.assert_allclose(electric.inner_share(jnp.asarray(ratio)), share, rtol=1e-15)
        np.testing.assert_allclose(jax.grad(electric.inner_share)(jnp.asarray(ratio)), slope, atol=1e-15)


def test_with_equal_fluids_and_no_membrane_potential_nothing_is_felt():
    s = make_scene(shapes.ellipse(**ELLIPSE), field=field(conductivity_ratio=1.0))
    motion = motion_of(s, Unknowns.of(s.x, jnp.zeros((1, 64))))
    np.testing.assert_allclose(motion.electric.traction, 0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.7, 2.0])
def test_turning_the_whole_scene_turns_the_motion(angle):
    s = make_scene(shapes.ellipse(**ELLIPSE), field=field(), flow=flow.LinearFlow([[1.0, 3.0], [0.5, -1.0]]))
    turn = jnp.array([[jnp.cos(angle), -jnp.sin(angle)], [jnp.sin(angle), jnp.cos(angle)]])
    turned = eqx.tree_at(
        lambda s: (s.x, s.field.direction, s.flow.velocity_gradient),
        s,
        (s.x @ turn.T, turn @ s.field.direction, turn @ s.flow.velocity_gradient @ turn.T),
    )
    y = charged(s)
    before, after = motion_of(s, y), motion_of(turned, Unknowns.of(turned.x, y.V_m))
    scale = jnp.max(jnp.abs(before.velocity))
    np.testing.assert_allclose(after.velocity, before.velocity @ turn.T, atol=1e-10 * scale)
    np.testing.assert_allclose(
        after.rates["V_m"], before.rates["V_m"], atol=1e-10 * jnp.max(jnp.abs(before.rates["V_m"]))
    )
    np.testing.assert_allclose(after.sigma, before.sigma, atol=1e-10 * jnp.max(jnp.abs(before.sigma)))


def test_moving_the_first_node_moves_nothing_else():
    s = both()
    y = charged(s)
    shifted = Unknowns.of(jnp.roll(y.x, 7, axis=1), jnp.roll(y.V_m, 7, axis=1))
    before, after = motion_of(s, y), motion_of(eqx.tree_at(lambda s: s.x, s, shifted.x), shifted)
    scale = jnp.max(jnp.abs(before.velocity))
    np.testing.assert_allclose(after.velocity, jnp.roll(before.velocity, 7, axis=1), atol=1e-11 * scale)


def test_the_frozen_part_of_the_potential_is_the_exact_derivative():
    """At fixed shape dV_m/dt is affine in V_m, and A_V is its matrix on resolved potentials."""
    s = both()
    y, alpha = charged(s), fourier.grid(64)
    equation = equation_for(s)
    dV = jnp.exp(jnp.cos(alpha)) - 1.2
    A_V = eqx.filter_jit(equation.freeze)(jnp.zeros(()), y).A_scalars[0]
    moved = Unknowns.of(y.x, y.V_m + dV)
    change = motion_of(s, moved).rates["V_m"][0] - motion_of(s, y).rates["V_m"][0]
    np.testing.assert_allclose(A_V @ dV, change, atol=1e-9 * jnp.max(jnp.abs(change)))


@pytest.mark.parametrize("ratio", [0.1, 1.0, 20.0])
def test_how_charging_follows_the_shape_is_the_exact_derivative(ratio):
    """At fixed V_m of the nodes: the formula of a transmission problem beside the derivative of the rate."""
    N, alpha = 96, fourier.grid(96)
    s = make_scene(
        shapes.ellipse(N, 0.95, angle=1.0), field=dc_field(3.2, conductivity_ratio=ratio, membrane_conductance=0.5)
    )
    equation = equation_for(s)
    start = eqx.filter_jit(equation.start)()
    y = Unknowns.of(start.x, jnp.sin(alpha - 1.0)[None] + 0.3 * jnp.cos(2 * alpha))
    dx = jnp.stack([jnp.sin(3 * alpha) + 0.2, jnp.exp(jnp.cos(alpha))], axis=-1)[None]

    @jax.jit
    def both(dx):
        exact = jax.jvp(lambda x: equation.rate(jnp.zeros(()), Unknowns.of(x, y.V_m)).scalars["V_m"], (y.x,), (dx,))[1]
        frozen = equation.freeze(jnp.zeros(()), y)
        found = [frozen.below(frozen.motion.surfaces, dx, jnp.asarray(c))["V_m"] for c in (2.0, 1e-3)]
        return exact, *found

    exact, long, short = both(dx)
    np.testing.assert_allclose(long, 2.0 * exact, atol=2e-8 * np.max(np.abs(exact)))
    assert not np.any(short)  # a stage much shorter than the charging time χ = 0.08 does without


@eqx.filter_jit
def rate_of_shapes(equation, y, dx):
    """A_x times a displacement (N, 2) of the membrane."""
    return (equation.freeze(jnp.zeros(()), y).A_x[0] @ dx.T.reshape(-1)).reshape(2, -1).T


@pytest.mark.parametrize(("N", "tolerance"), [(64, 1e-4), (128, 1e-10)])
def test_the_frozen_part_of_the_shape_agrees_with_its_definition_to_spectral_accuracy(N, tolerance):
    """P G (-κ_B ∂_s⁴ + ∂_s σ ∂_s) as dense products of matrices, beside the solutions d = r + c A d of the package."""
    s = make_scene(shapes.ellipse(N, 0.9, angle=1.0), flow=flow.Shear(3.0))
    equation = equation_for(s)
    y = eqx.filter_jit(equation.start)()
    frozen = eqx.filter_jit(equation.freeze)(jnp.zeros(()), y)
    found = frozen.motion.surfaces.curves, frozen.motion.surfaces.stokes_slp, frozen.motion.sigma
    c, own, sigma = jax.tree.map(lambda leaf: np.asarray(leaf[0]), found)
    D = fourier.derivative_matrix(N)
    G = np.block([[own.xx, own.xy], [own.xy, own.yy]])
    tangent = np.concatenate([np.diag(c.tangent[:, 0]), np.diag(c.tangent[:, 1])])
    T, Q = np.kron(np.eye(2), D) @ tangent, tangent.T @ np.kron(np.eye(2), D)
    L = fourier.low_pass_matrix(N, 1)  # the tension has no Nyquist mode
    P = np.eye(2 * N) - G @ T @ L @ np.linalg.solve(L @ Q @ G @ T @ L - (np.eye(N) - L), L @ Q)
    low = fourier.low_pass_matrix(N, equation.filter.x)
    K = (-np.linalg.matrix_power(D, 4) + D @ np.diag(sigma) @ D) @ low
    A = np.kron(np.eye(2), low) @ P @ G @ np.kron(np.eye(2), K)
    alpha = fourier.grid(N)
    dx = jnp.stack([jnp.sin(3 * alpha) + 0.3 * jnp.cos(7 * alpha), jnp.exp(jnp.cos(alpha))], axis=-1)
    c = jnp.asarray(1e-2)
    d = eqx.filter_jit(lambda frozen: frozen.implicit(c).x.solve(dx[None])[0])(frozen)
    exact = (A @ np.asarray(d).T.reshape(-1)).reshape(2, -1).T
    np.testing.assert_allclose((d - dx) / c, exact, atol=tolerance * np.max(np.abs(exact)))


def test_the_frozen_part_of_the_shape_is_what_stiffness_is_made_of():
    """A_x agrees with the true Jacobian on a stiff mode, where everything it leaves out is small."""
    s = make_scene(shapes.ellipse(**ELLIPSE))
    equation = equation_for(s)
    y = eqx.filter_jit(equation.start)()
    c = Curve.from_nodes(y.x[0])
    bump = jnp.cos(24 * fourier.grid(64))[:, None] * c.normal
    exact = jax.jvp(lambda x: motion_of(s, Unknowns.of(x)).velocity, (y.x,), (bump[None],))[1][0]
    frozen = rate_of_shapes(equation, y, bump)
    assert jnp.max(jnp.abs(frozen - exact)) < 0.05 * jnp.max(jnp.abs(exact))


def test_projection_restores_metric_and_area_quadratically():
    s = make_scene(shapes.ellipse(**ELLIPSE))
    equation = equation_for(s)
    y = eqx.filter_jit(equation.start)()
    constraint = eqx.filter_jit(equation.freeze)(jnp.zeros(()), y).constraint
    alpha = fourier.grid(64)
    shake = jnp.stack([jnp.cos(2 * alpha), jnp.sin(3 * alpha)], axis=-1)

    def left(size):
        c = Curve.from_nodes(equation.project(Unknowns.of(y.x + size * shake), constraint).x[0])
        return jnp.max(jnp.abs(c.speed - 1)) + abs(curve.area(c) - equation.area[0])

    assert left(1e-3) < 10 * 1e-3**2 * 10
    assert left(1e-4) < left(1e-3) / 50 or left(1e-4) < 1e-7


def _primitives(jaxpr):
    """Names of all primitives of a jaxpr and of those within it, each as often as it stands there."""
    for equation in jaxpr.eqns:
        yield equation.primitive.name
        for parameter in jax.tree.leaves(equation.params, is_leaf=lambda p: hasattr(p, "eqns") or hasattr(p, "jaxpr")):
            inner = getattr(parameter, "jaxpr", parameter)
            if hasattr(inner, "eqns"):
                yield from _primitives(inner)


def _traced(s):
    y = Unknowns.of(s.x, None if s.field is None else jnp.zeros(s.x.shape[:2]))
    jaxpr = jax.make_jaxpr(lambda s, y: equation_for(s, filter=Filter(4)).rate(jnp.zeros(()), y))(s, y)
    return list(_primitives(jaxpr.jaxpr))


def test_what_a_scene_lacks_leaves_no_trace():
    """The tension's Cholesky factor is always there, the charge's LU only with a field; a flow adds next to nothing."""
    x = shapes.ellipse(**ELLIPSE)
    bare, sheared = _traced(make_scene(x)), _traced(make_scene(x, flow=flow.Shear(1.0)))
    in_field = _traced(make_scene(x, field=field()))
    assert "lu" not in bare and "lu" not in sheared
    assert in_field.count("lu") == 2  # of the charge, and of its transpose for derivatives: one of them runs
    assert bare.count("cholesky") == sheared.count("cholesky") == in_field.count("cholesky") == 1
    assert len(bare) < len(sheared) < 1.1 * len(bare)
    assert len(in_field) > 1.2 * len(bare)
