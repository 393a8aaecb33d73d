"""Branches that stay branches under `jax.vmap`.

If the predicate of a `lax.cond` is batched, JAX computes both branches for every batch element. If the expensive branch
is valid for every batch element, this can be avoided: take it for all as soon as one element needs it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int


@jax.custom_batching.custom_vmap
def _greatest(value):
    return value


@_greatest.def_vmap
def _(size, is_batched, value):
    return _greatest(jnp.max(value, axis=0) if is_batched[0] else value), False


def greatest(value: Int[Array, ""] | Bool[Array, ""]) -> Int[Array, ""] | Bool[Array, ""]:
    """Returns `value`; under `vmap` the largest value of all batch elements, not batched. It has no derivative.

    Of booleans it tells whether any is true.
    """
    return _greatest(jax.lax.stop_gradient(value))
