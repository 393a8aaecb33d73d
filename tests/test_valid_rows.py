"""Functions over the valid rows of a list: values, derivatives in both modes, and parts that are left out."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.numerics.valid_rows import over_valid

SIZE, ROWS = 4, 12
RNG = np.random.default_rng(2)
A, B = jnp.asarray(RNG.normal(size=(ROWS, 3))), jnp.asarray(RNG.normal(size=3))


def product(part, b):
    return jnp.sin(part @ b)


def values(a, b, count):
    return over_valid(product, jnp.arange(ROWS) < count, a, b, SIZE).reshape(-1)


@pytest.mark.parametrize("count", [0, 5, 12])
def test_parts_without_a_valid_row_are_zero_and_their_rows_are_not_used(count):
    used = -(-count // SIZE) * SIZE
    found = jax.jit(values)(A.at[used:].set(jnp.nan), B, count)
    np.testing.assert_allclose(found[:used], product(A, B)[:used], rtol=1e-15)
    np.testing.assert_array_equal(found[used:], 0.0)


def test_derivatives_are_those_of_the_function():
    push = jnp.asarray(RNG.normal(size=A.shape)), jnp.asarray(RNG.normal(size=3))
    weights = jnp.asarray(RNG.normal(size=ROWS)).at[8:].set(0.0)

    def exact(a, b):
        return jnp.sum(weights * product(a, b))

    def summed(a, b):
        return jnp.sum(weights * values(a, b, 7))

    np.testing.assert_allclose(*(jax.jvp(f, (A, B), push)[1] for f in (summed, exact)), rtol=1e-13)
    for found, wanted in zip(*(jax.grad(f, argnums=(0, 1))(A, B) for f in (summed, exact)), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-13, atol=1e-15)


def test_a_linear_function_can_be_transposed():
    def linear(b):
        return over_valid(lambda part, b: part @ b, jnp.arange(ROWS) < 7, A, b, SIZE).reshape(-1)

    c = jnp.asarray(RNG.normal(size=ROWS))
    (found,) = jax.linear_transpose(linear, B)(c)
    np.testing.assert_allclose(found, A[:8].T @ c[:8], rtol=1e-13)


def test_a_part_is_left_out_of_a_batch_only_if_no_element_needs_it():
    found = jax.vmap(lambda count: values(A, B, count))(jnp.array([1, 6]))
    np.testing.assert_allclose(found[1, :8], product(A, B)[:8], rtol=1e-15)
    assert np.all(found[:, 8:] == 0)
