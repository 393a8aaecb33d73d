"""Stages of steps with many nodes solve for the tension by iteration, with the factors of the start of the step."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation import equation as module
from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.physics.flow import Extension
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.fixed import Fixed

N = 32


@pytest.fixture
def few(monkeypatch):
    """All numbers of nodes count as many."""
    monkeypatch.setattr(module, "_MANY", 2)


@pytest.fixture(scope="module")
def scene():
    return make_scene(
        shapes.ellipse(N, 0.9, angle=0.4), flow=Extension(20.0), field=dc_field(1.0, conductivity_ratio=0.1)
    )


def test_iteration_and_matrices_give_the_same_motion(scene, few):
    """A shape that has moved by 1 % needs few iterations more than the exact factors, which need one."""
    equation = equation_for(scene)
    y = Unknowns.of(scene.x, jnp.sin(2 * jnp.arange(N) * 2 * np.pi / N)[None])
    iterations = []
    for moved in (0.0, 0.01):
        shape = Unknowns(y.x * (1 + moved * np.array([1.0, -1.0])), y.scalars)

        @eqx.filter_jit
        def both(equation, y, shape):
            nearby = equation.near(equation.freeze(jnp.zeros(()), y))
            return [one.motion(jnp.zeros(()), shape) for one in (equation, nearby)]

        direct, found = both(equation, y, shape)
        np.testing.assert_allclose(found.sigma, direct.sigma, atol=1e-9 * np.max(np.abs(direct.sigma)))
        np.testing.assert_allclose(found.velocity, direct.velocity, atol=1e-9 * np.max(np.abs(direct.velocity)))
        assert found.residual < 1e-10
        iterations.append(int(found.iterations - direct.iterations))
    assert iterations[0] == 1 and 2 <= iterations[1] <= 8


def test_steps_and_their_derivatives_do_not_depend_on_how_the_tension_is_found(scene, monkeypatch):
    dx = jnp.asarray(np.random.default_rng(0).normal(size=scene.x.shape))
    found = []
    for many in (2, 2 * N):
        monkeypatch.setattr(module, "_MANY", many)
        equation = equation_for(scene)
        march = Fixed(1)

        def step(x, equation=equation, march=march):
            y = Unknowns.of(x, jnp.zeros((1, N)))
            return march.step(equation, jnp.zeros(()), y, jnp.asarray(2e-3)).x

        def all_of(x, step=step):
            value, tangent = jax.jvp(step, (x,), (dx,))
            return value, tangent, jax.vjp(step, x)[1](dx)[0]

        found.append(jax.jit(all_of)(scene.x))
    assert np.max(np.abs(found[0][0] - scene.x)) > 0.01
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8 * np.max(np.abs(other)))


def test_a_tension_that_is_not_accurate_makes_the_rate_nan(scene, few, monkeypatch):
    """The step is then refused, and a shorter one is tried."""
    equation = equation_for(scene)
    y = Unknowns.of(scene.x, jnp.zeros((1, N)))
    rates = {}
    for limit in (module._LARGEST, 0.0):
        monkeypatch.setattr(module, "_LARGEST", limit)
        frozen = equation.freeze(jnp.zeros(()), y)
        rates[limit] = np.asarray(equation.near(frozen).rate(jnp.zeros(()), y).x)
    assert np.all(np.isnan(rates.pop(0.0))) and np.all(np.isfinite(*rates.values()))


def test_few_nodes_and_two_viscosities_have_matrices(monkeypatch):
    def nearby(N, **more):
        scene = make_scene(shapes.ellipse(N, 0.9), **more)
        equation = equation_for(scene)
        frozen = eqx.filter_eval_shape(equation.freeze, jnp.zeros(()), Unknowns(scene.x))
        return equation.near(frozen).nearby

    assert nearby(module._MANY - 2) is None
    assert nearby(module._MANY) is not None
    assert nearby(module._MANY, viscosity_ratio=2.0) is None
