"""Fields away from the membranes: exact solutions about circles, and what holds about any shape."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.observables import fields
from jaxves.observables.fields import _closely, _Membrane, _widely, fields_at
from jaxves.physics.flow import Shear
from jaxves.physics.scene import dc_field, make_scene
from jaxves.potentials import far

N = 32
RADII = (0.05, 0.4, 0.7, 0.9, 1 - 1e-4, 1 - 1e-10, 1 + 1e-10, 1 + 1e-4, 1.1, 1.3, 2.0, 20.0)


def polar(r, P=7):
    """P points at radius r, away from symmetric angles."""
    theta = 0.3 + 2 * np.pi * np.arange(P) / P
    return jnp.asarray(r * np.stack([np.cos(theta), np.sin(theta)], axis=-1))


def as_complex(v):
    return np.asarray(v[..., 0] + 1j * v[..., 1])


def circle(radius=1.0, nodes=256):
    return jax.vmap(Curve.from_nodes)(shapes.circle(nodes, length=radius)[None])


MANY = 600  # more than are evaluated at once, and not a multiple


def surroundings(equation, y, points):
    """`fields_at` at time 0, always for `MANY` points, so that it is compiled once per scene."""
    padded = jnp.concatenate([points, jnp.full((MANY - len(points), 2), 9.0)])
    return jax.tree.map(lambda leaf: leaf[: len(points)], fields_at(equation, 0.0, y, padded))


def charged_circle(conductivity_ratio, V, **flow):
    """Unit circle in a field along y with V_m = V sin θ: its equation and state."""
    x = shapes.circle(N)
    equation = equation_for(make_scene(x, field=dc_field(1.0, conductivity_ratio=conductivity_ratio), **flow))
    return equation, Unknowns.of(x[None], V * x[None, :, 1])


@pytest.fixture(scope="module")
def pair():
    """Two unlike vesicles in a field and a shear, one with a charged membrane of no symmetry."""
    x = jax.jit(jax.vmap(lambda D, a: shapes.ellipse(64, D, angle=a)))(jnp.array([0.95, 0.9]), jnp.array([0.4, 1.4]))
    field = dc_field(3.2, conductivity_ratio=jnp.array([0.1, 3.0]), vesicles=2, direction=(0.6, 0.8))
    what = make_scene(list(x), centers=[[-1.5, 0.2], [1.4, -0.3]], field=field, flow=Shear(2.0))
    return equation_for(what), Unknowns.of(what.x, 0.3 * what.x[..., 1] + 0.2 * what.x[..., 0] ** 2)


@pytest.fixture(scope="module")
def vesicle():
    """A lone ellipse in shear."""
    x = jax.jit(lambda: shapes.ellipse(64, 0.9, angle=0.4))()
    what = make_scene(x, flow=Shear(2.0))
    return equation_for(what), Unknowns.of(what.x)


@pytest.mark.parametrize("Lambda", [0.0, 0.1, 1.0, 5.0, np.inf])
@pytest.mark.parametrize("V", [0.0, 0.7])
def test_a_charged_circle_has_the_exact_field(Lambda, V):
    """φ = -y + (η(1-V/2) + V/2) y inside, -y + (η(1-V/2) - V/2) y/r² outside: E uniform 2/(1+Λ) at V = 0.

    At any distance from the membrane, on either side.
    """
    eta = 1.0 if np.isinf(Lambda) else (Lambda - 1) / (Lambda + 1)
    equation, y = charged_circle(Lambda, V)
    points = jnp.concatenate([polar(r) for r in RADII])
    found = surroundings(equation, y, points)
    (x, z), r2 = np.asarray(points).T, np.sum(np.asarray(points) ** 2, axis=-1)
    inside, source = r2 < 1, eta * (1 - V / 2)
    dipole = source - V / 2
    phi = np.where(inside, (source + V / 2 - 1) * z, -z + dipole * z / r2)
    E = np.where(
        inside[:, None],
        np.array([0.0, 1.0 - source - V / 2]),
        np.array([0.0, 1.0]) - dipole * np.stack([-2 * x * z, x**2 - z**2], axis=-1) / r2[:, None] ** 2,
    )
    np.testing.assert_array_equal(found.inside, np.where(inside, 0, -1))
    np.testing.assert_allclose(found.potential, phi, atol=1e-12 * max(1, np.abs(phi).max()))
    np.testing.assert_allclose(found.electric_field, E, atol=1e-12)


@pytest.mark.parametrize("k", [-3, -1, 0, 1, 2, 4])
def test_the_stokes_layer_of_a_circle_continues_as_derived(k):
    """f₁ + i f₂ = e^{ikθ} on radius R: R/4|k| (z̄/R)^|k| inside for k < 0, R/4k (R/z̄)^k outside for k ≥ 2;
    k = 0 is constant inside; at k = 1 the tangential part is a rotation inside and a rotlet outside.
    """
    R = 0.8
    curves = circle(R)
    theta = 2 * np.pi * np.arange(256) / 256
    f = np.exp(1j * k * theta) * (1j if k == 1 else 1)
    density = jnp.asarray(np.stack([f.real, f.imag], axis=-1)[None])
    velocity = jax.jit(far.stokes_slp)

    def at(r):
        return as_complex(velocity(curves, density, polar(r))), as_complex(polar(r))

    inner, outer = 0.5, 1.3
    if k < 0:
        u, z = at(inner)
        expected = R / (4 * abs(k)) * (z.conj() / R) ** abs(k)
    elif k == 0:
        u, z = at(inner)
        expected = np.full(z.shape, R * (0.25 - 0.5 * np.log(R)))
    elif k == 1:
        u, z = at(outer)
        expected = 0.5j * R**2 / z.conj()
        inside, z_inside = at(inner)
        np.testing.assert_allclose(inside, 0.5j * z_inside, atol=1e-13)
    else:
        u, z = at(outer)
        expected = R / (4 * k) * (R / z.conj()) ** k
    np.testing.assert_allclose(u, expected, atol=1e-13)


def test_the_dipole_layer_of_one_counts_the_enclosing_vesicles(pair):
    _, y = pair
    curves = jax.vmap(Curve.from_nodes)(y.x)
    points = jnp.array([[-1.5, 0.2], [1.4, -0.3], [0.0, 4.0]])
    D = jax.jit(far.laplace_dlp)(curves, jnp.ones(y.x.shape[:2]), points)
    np.testing.assert_allclose(D, [-1, -1, 0], atol=1e-12)


def test_the_number_inside_is_right_at_any_distance(pair):
    """Also all but on the membrane, and for points level with a node."""
    equation, y = pair
    curves = jax.jit(jax.vmap(Curve.from_nodes))(y.x)
    offset = 1e-8
    inner = (curves.x - offset * curves.normal).reshape(-1, 2)
    outer = (curves.x + offset * curves.normal).reshape(-1, 2)
    level = jnp.stack([jnp.full(len(y.x[1]), 4.0), y.x[1, :, 1]], axis=-1)
    centers = jnp.array([[-1.5, 0.2], [1.4, -0.3]])
    found = surroundings(equation, y, jnp.concatenate([inner, outer, level, -level, centers]))
    expected = [0] * 64 + [1] * 64 + [-1] * 256 + [0, 1]
    np.testing.assert_array_equal(found.inside, expected)


def test_both_rules_agree_where_one_takes_over_from_the_other(pair):
    """The 5h rule leaves e^{-10π} = 2e-14 of the densities, in gradients some digits more."""
    equation, y = pair

    @jax.jit
    def both(y):
        motion = equation.motion(jnp.zeros(()), y)
        curve, f_hd, w, V_m = jax.tree.map(
            lambda leaf: leaf[0], (motion.surfaces.curves, motion.f_hd, motion.electric.w, y.V_m)
        )
        membrane = _Membrane(curve, f_hd, w, V_m)
        strip = 5 / 4 * jnp.max(curve.weights)
        points = (curve.x + strip * jnp.array([[[1.0]], [[-1.0]]]) * curve.normal).reshape(-1, 2)
        return _closely(membrane, points)[0], _widely(membrane, points)

    for a, b in zip(*both(y), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-11 * np.abs(a).max())


@pytest.mark.parametrize("distance", [0.0, 1e-9])
def test_what_is_found_next_to_a_membrane_is_what_the_membrane_has(pair, distance):
    """Its velocity on both sides, E there as the traction has it, and p_i - p_e = -f_hd·n.

    The membrane takes D' and ∂_s S from other formulas.
    """
    equation, y = pair
    motion = jax.jit(lambda y: equation.motion(jnp.zeros(()), y))(y)
    curves, fields = motion.surfaces.curves, motion.electric.fields
    velocity = eqx.filter_jit(lambda motion: motion.surfaces.stokes(motion.f_hd))(motion)
    velocity = (velocity + equation.scene.flow.velocity(y.x, jnp.zeros(()))).reshape(-1, 2)
    normal, tangent = curves.normal.reshape(-1, 2), curves.tangent.reshape(-1, 2)
    nodes, number = y.x.reshape(-1, 2), np.repeat([0, 1], 64)
    found = [surroundings(equation, y, nodes + side * distance * normal) for side in (1, -1)]
    if distance:
        np.testing.assert_array_equal(found[0].inside, np.full(128, -1))
        np.testing.assert_array_equal(found[1].inside, number)
        pull = np.sum(motion.f_hd * curves.normal, axis=-1).reshape(-1)
        np.testing.assert_allclose(found[0].pressure - found[1].pressure, pull, atol=1e-8 * np.abs(pull).max())
    for side in found:
        assert set(np.asarray(side.inside)) <= {-1, 0, 1}
        np.testing.assert_allclose(side.velocity, velocity, atol=1e-7 * np.abs(velocity).max())
        within = side.inside == number
        E_n = np.where(within, fields.inner_normal.reshape(-1), fields.outer_normal.reshape(-1))
        E_t = np.where(within, fields.inner_tangential.reshape(-1), fields.outer_tangential.reshape(-1))
        np.testing.assert_allclose(np.sum(side.electric_field * normal, axis=-1), E_n, atol=1e-7)
        np.testing.assert_allclose(np.sum(side.electric_field * tangent, axis=-1), E_t, atol=1e-7)


def test_the_field_is_the_gradient_of_the_potential(pair):
    equation, y = pair
    points = jnp.concatenate([polar(3.3), jnp.array([[-1.5, 0.2], [1.4, -0.3]])])
    h = 1e-3
    shifted = jnp.stack([points + sign * h * jnp.eye(2)[a] for a in (0, 1) for sign in (1, -1)])
    found = surroundings(equation, y, jnp.concatenate([points, shifted.reshape(-1, 2)]))
    E = found.electric_field[: len(points)]
    phi = found.potential[len(points) :].reshape(2, 2, -1)
    np.testing.assert_allclose(E.T, -(phi[:, 0] - phi[:, 1]) / (2 * h), atol=10 * h**2)


def test_the_fluid_is_incompressible_and_without_a_field_there_is_no_potential(vesicle):
    equation, y = vesicle
    flow = eqx.filter_jit(lambda dx: fields_at(equation, 0.0, y, polar(1.8) + dx))
    found, along_x = eqx.filter_jvp(flow, (jnp.zeros(2),), (jnp.array([1.0, 0.0]),))
    _, along_y = eqx.filter_jvp(flow, (jnp.zeros(2),), (jnp.array([0.0, 1.0]),))
    assert found.potential is None and found.electric_field is None
    assert np.abs(along_x.velocity).max() > 0.1
    np.testing.assert_allclose(along_x.velocity[:, 0] + along_y.velocity[:, 1], 0.0, atol=1e-11)


def test_far_away_only_the_imposed_field_and_flow_remain(pair):
    """The disturbances of a force-free pair fall like 1/r (stresslet) and 1/r² (dipole)."""
    equation, y = pair
    E_inf = equation.scene.field.E_inf(jnp.zeros(()))

    def disturbance(r):
        points = polar(r)
        found = surroundings(equation, y, points)
        du = found.velocity - equation.scene.flow.velocity(points[None], jnp.zeros(()))[0]
        return np.abs(du).max(), np.abs(found.electric_field - E_inf).max()

    (u1, E1), (u2, E2) = disturbance(200.0), disturbance(400.0)
    assert abs(np.log2(u1 / u2) - 1) < 0.05
    assert abs(np.log2(E1 / E2) - 2) < 0.05


def test_a_value_does_not_depend_on_the_place_among_the_points(pair):
    """They are evaluated in chunks; the last one is not full."""
    equation, y = pair
    points = jnp.concatenate([polar(r) for r in np.linspace(2.9, 4.0, 85)])
    one_way = surroundings(equation, y, points)
    other_way = surroundings(equation, y, points[::-1])
    np.testing.assert_allclose(one_way.velocity, other_way.velocity[::-1], rtol=1e-11)
    np.testing.assert_allclose(one_way.electric_field, other_way.electric_field[::-1], rtol=1e-11)


@pytest.mark.parametrize("batched", [False, True])
def test_gradients_are_finite_and_right_next_to_a_node(batched):
    """Reverse mode through the conductivity ratio: dE/dΛ = -2/(1+Λ)² inside; under `vmap` both rules are traced."""
    x = shapes.circle(N)
    points = jnp.stack([x[3] * (1 - 1e-9), jnp.zeros(2)])

    def inner_field(Lambda, points):
        equation = equation_for(make_scene(x, field=dc_field(1.0, conductivity_ratio=Lambda)))
        return jnp.sum(fields_at(equation, 0.0, Unknowns.of(x[None], jnp.zeros((1, N))), points).electric_field[:, 1])

    if batched:
        gradient = jax.vmap(jax.grad(inner_field), in_axes=(None, 0))(jnp.asarray(0.5), jnp.stack([points, points + 5]))
        gradient = gradient[0]
    else:
        gradient = jax.jit(jax.grad(inner_field))(jnp.asarray(0.5), points)
    np.testing.assert_allclose(gradient, 2 * -2 / 1.5**2, rtol=1e-9)


def test_far_points_are_not_closely_evaluated(vesicle):
    """The choice is made at run time, for each chunk: both rules stand in branches of the compiled program."""
    equation, y = vesicle
    traced = str(eqx.filter_make_jaxpr(fields_at)(equation, 0.0, y, polar(3.0))[0])
    assert "cond" in traced


def test_outside_of_jit_points_are_evaluated_by_a_program_made_once(vesicle, calls_of):
    equation, y = vesicle
    traced = calls_of(fields, "_place")
    before = fields_at(equation, 0.0, y, polar(3.0, P=11))
    once = len(traced)
    after = fields_at(equation, 1.0, Unknowns.of(2 * y.x), polar(4.0, P=11))
    assert len(traced) == once > 0
    assert np.all(after.velocity != before.velocity)
