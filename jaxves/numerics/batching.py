"""Branches that stay branches under `jax.vmap`.

A `lax.cond` whose predicate is batched becomes a choice between both sides, and both are paid for. Where the dear
side is right for everybody, the lanes of a batch can decide together instead: it is taken when any lane needs it.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int


@jax.custom_batching.custom_vmap
def _greatest(value):
    return value


@_greatest.def_vmap
def _(size, is_batched, value):
    return _greatest(jnp.max(value, axis=0) if is_batched[0] else value), False


def greatest(value: Int[Array, ""]) -> Int[Array, ""]:
    """The value itself; under `vmap` the greatest of all lanes, one for all. Carries no derivative."""
    return _greatest(jax.lax.stop_gradient(value))
