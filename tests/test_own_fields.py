"""Imposed fields that depend on position: exact fields and forces of a circle, derivatives, refusals."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.equation.state import Unknowns

N, LAMBDA, BETA, CENTER = 32, 0.3, 2.0, np.array([0.4, -0.2])
CIRCLE = np.asarray(jaxves.circle(N))  # of radius 1


class Gradient(eqx.Module):
    """E = (-s x, 1 + s y), a uniform field and its gradient."""

    s: jax.Array

    def __call__(self, x, t):
        return jnp.array([-self.s * x[0], 1.0 + self.s * x[1]])


def uniform(x, t):
    return jnp.array([0.0, 1.0])


def scene_in(E_inf, **options):
    field = jaxves.dc_field(BETA, conductivity_ratio=LAMBDA, E_inf=E_inf, **options)
    return jaxves.make_scene(CIRCLE, centers=CENTER, field=field)


@eqx.filter_jit
def forces(scene):
    """The normal fields on both sides, the force on the circle, and the field at a point inside and one outside."""
    equation = jaxves.equation_for(scene)
    y = Unknowns.of(scene.x, jnp.zeros(scene.x.shape[:2]))
    motion = equation.motion(jnp.zeros(()), y)
    curve = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
    around = jaxves.fields_at(equation, 0.0, y, jnp.array([[0.6, 0.1], [2.4, 0.7]]))
    return motion.electric.fields, -curve.weights @ motion.electric.traction[0], around, curve.normal


@pytest.mark.parametrize("s", [0.0, 0.7])
def test_the_fields_and_the_force_of_an_uncharged_circle_are_exact(s):
    """Inside, the field is 2/(1+Λ) of the imposed one. The force is (p·∇)E with p = 2πR² η E at the center."""
    E = Gradient(jnp.asarray(s))
    fields, force, around, normal = forces(scene_in(E))
    imposed = np.asarray(jax.vmap(lambda x: E(x, 0.0))(CIRCLE + CENTER))
    np.testing.assert_allclose(fields.inner_normal[0], 2 / (1 + LAMBDA) * np.sum(imposed * normal, axis=1), atol=1e-11)
    inside = np.asarray(E(jnp.array([0.6, 0.1]), 0.0))
    np.testing.assert_allclose(around.electric_field[0], 2 / (1 + LAMBDA) * inside, atol=1e-10)
    assert around.potential is None
    eta, at_center = (LAMBDA - 1) / (LAMBDA + 1), np.asarray(E(jnp.asarray(CENTER), 0.0))
    exact = 2 * np.pi * eta * s * np.array([-at_center[0], at_center[1]]) * BETA / 0.08
    np.testing.assert_allclose(force, exact, atol=1e-9 * BETA / 0.08)


def test_a_uniform_function_is_the_uniform_field():
    own, force, *_ = forces(scene_in(uniform))
    field = jaxves.dc_field(BETA, conductivity_ratio=LAMBDA)
    given, same, around, _ = forces(jaxves.make_scene(CIRCLE, centers=CENTER, field=field))
    np.testing.assert_allclose(own.outer_tangential, given.outer_tangential, atol=1e-13)
    np.testing.assert_allclose(force, same, atol=1e-10)
    assert around.potential is not None


@eqx.filter_jit
def pushed(s):
    """The position of the circle after a short run, and its derivative with respect to the gradient of the field."""

    def run(s):
        result = jaxves.simulate(scene_in(Gradient(s)), 4e-3, saves=1, march=jaxves.Fixed(1))
        return result.diagnostics["center"][-1, 0], result.diagnostics

    return jax.jvp(run, (s,), (jnp.ones(()),))


def test_the_derivative_of_a_run_agrees_with_differences_and_the_circle_moves_along_its_force():
    (center, found), (slope, _) = pushed(jnp.asarray(0.5))
    h = 1e-3
    (after, _), _ = pushed(jnp.asarray(0.5 + h))
    (before, _), _ = pushed(jnp.asarray(0.5 - h))
    np.testing.assert_allclose(slope, (after - before) / (2 * h), rtol=1e-4, atol=1e-8)
    # η < 0: the circle is pushed to where the field is weaker, which is at (0, -2) for s = 1/2
    moved, to_weak_field = np.asarray(center - CENTER), np.array([0.0, -2.0]) - CENTER
    assert moved @ to_weak_field > 0.9 * np.linalg.norm(moved) * np.linalg.norm(to_weak_field) > 0
    assert not {"deformation_along_field", "stress", "effective_viscosity"} & set(found)


@pytest.mark.parametrize(
    ("E_inf", "options", "message"),
    [
        (lambda x, t: x, {}, r"E_inf = divergence 2 at x = \[0.3, 0.2\], t = 0.0, expected the gradient of a harmonic"),
        (lambda x, t: jnp.array([-x[1], x[0]]), {}, r"E_inf = curl 2 at .*expected the gradient of a harmonic"),
        (lambda x, t: x[0], {}, r"E_inf = a function that returns an array of shape \(\), expected a function E"),
        (lambda x: x, {}, r"E_inf = .*expected a function E\(x, t\)"),
        (uniform, {"direction": (1.0, 0.0)}, r"direction = .*expected no direction beside E_inf"),
        (uniform, {"charge_relaxation": 0.1}, r"charge_relaxation = 0.1, expected None"),
        (uniform, {"history": jaxves.AC(10.0, averaged=True)}, r"history.averaged = True, expected"),
    ],
)
def test_a_field_that_cannot_be_used_is_refused_in_one_line(E_inf, options, message):
    with pytest.raises(ValueError, match=message) as caught:
        scene_in(E_inf, **options)
    assert "\n" not in str(caught.value)


def test_a_periodic_cell_refuses_such_a_field():
    field = jaxves.dc_field(BETA, conductivity_ratio=LAMBDA, E_inf=uniform)
    with pytest.raises(ValueError, match="uniform field in a periodic cell"):
        jaxves.make_scene(CIRCLE, field=field, cell=jaxves.Cell.of([[6.0, 0.0], [0.0, 6.0]]))
