"""The logarithm by bit operations is the logarithm: to round-off, at every magnitude, with both derivatives."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxves.numerics.logarithm import log

RNG = np.random.default_rng(0)
# Every magnitude, and the two sides of each change of the exponent.
MAGNITUDES = np.exp(RNG.uniform(-700, 700, 20000))
EDGES = np.ldexp(np.sqrt(0.5) * np.array([1 - 2.0**-52, 1, 1 + 2.0**-52]), np.arange(-900, 900, 7)[:, None])


def test_it_is_right_to_the_last_digit_or_two():
    for x in (MAGNITUDES, EDGES.reshape(-1), 1 + RNG.uniform(-1e-3, 1e-3, 1000)):
        wanted = np.log(x)
        found = jax.jit(log)(jnp.asarray(x))
        np.testing.assert_allclose(found, wanted, rtol=4e-16, atol=4e-16)


def test_its_derivatives_are_those_of_a_logarithm_in_both_modes():
    x = jnp.asarray(RNG.uniform(0.01, 30, 50))
    one = jnp.ones_like(x)
    forward = jax.jit(lambda x: jax.jvp(log, (x,), (one,))[1])(x)
    (reverse,) = jax.jit(lambda x: jax.vjp(log, x)[1](one))(x)
    second = jax.jit(jax.vmap(jax.grad(jax.grad(log))))(x)
    np.testing.assert_allclose(forward, 1 / x, rtol=1e-15)
    np.testing.assert_array_equal(forward, reverse)
    np.testing.assert_allclose(second, -1 / x**2, rtol=1e-15)
