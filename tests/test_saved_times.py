"""Saved instants of any spacing: `simulate(scene, times=...)`."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base import status
from jaxves.geometry import shapes
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

T_END = 0.03
ODD = (0.002, 0.0071, 0.0195, T_END)


def pop(beta=3.2, N=24):
    return make_scene(shapes.ellipse(N, 0.9, angle=jnp.pi / 2), field=dc_field(beta, conductivity_ratio=0.1))


@pytest.mark.parametrize("march", [Fixed(2), Adaptive(1e-4)])
def test_equidistant_times_are_the_equidistant_saves(march):
    even = simulate(pop(), T_END, saves=3, march=march)
    given = simulate(pop(), times=even.t[1:], march=march)
    for one, other in zip(jax.tree.leaves(even), jax.tree.leaves(given), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


def test_values_at_odd_times_agree_with_those_of_a_run_saved_densely():
    """With nodes enough that projecting more often changes nothing."""
    march, scene = Adaptive(1e-6), pop(N=64)
    odd = simulate(scene, times=ODD, march=march)
    assert odd.word == "complete"
    np.testing.assert_array_equal(odd.t, [0.0, *ODD])
    dense = simulate(scene, T_END, saves=300, march=march)
    places = [0, *(round(t / T_END * 300) for t in ODD)]
    np.testing.assert_allclose(dense.t[np.array(places)], odd.t, rtol=1e-14)
    np.testing.assert_allclose(dense.x[np.array(places)], odd.x, atol=1e-6)
    for name in ("deformation", "bending_energy"):
        np.testing.assert_allclose(dense.diagnostics[name][np.array(places)], odd.diagnostics[name], rtol=1e-5)


def of_both(numbers):
    """Deformations at two odd instants, of which the last moves with the second number."""
    times = jnp.array([0.3, 1.0]) * 0.01 * numbers[1]
    result = simulate(pop(3.2 * numbers[0]), times=times, march=Adaptive(1e-4, recorded=64))
    return jnp.sum(jnp.array([1.0, 2.0]) * result.diagnostics["deformation"][1:, 0])


def test_derivatives_with_respect_to_the_scene_and_the_times_agree_in_both_modes_and_with_differences():
    ones = jnp.ones(2)
    forward, reverse = jax.jit(jax.jacfwd(of_both))(ones), jax.jit(jax.grad(of_both))(ones)
    np.testing.assert_allclose(forward, reverse, rtol=1e-8)
    value, h = jax.jit(of_both), 1e-3
    found = [(value(ones + h * e) - value(ones - h * e)) / (2 * h) for e in jnp.eye(2)]
    assert np.min(np.abs(found)) > 1e-4
    np.testing.assert_allclose(forward, found, rtol=1e-3)


def test_traced_times_that_do_not_increase_end_the_run_as_invalid():
    @jax.jit
    def code(times):
        return simulate(pop(), times=times, march=Fixed(1)).status

    assert code(jnp.array([0.001, 0.002])) == status.COMPLETE
    for wrong in ([0.002, 0.001], [0.001, 0.001], [-0.001, 0.001], [0.001, jnp.nan]):
        assert code(jnp.array(wrong)) == status.INVALID
