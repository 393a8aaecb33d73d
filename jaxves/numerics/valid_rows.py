"""Functions over lists of fixed length whose valid rows come first.

Compiled code needs a fixed length, and most lists are partly filled. Parts of a list without a valid row are left out.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, PyTree

from .batching import greatest


def over_valid(
    function: Callable[[PyTree, PyTree], PyTree], valid: Bool[Array, "T"], rows: PyTree, shared: PyTree, size: int
) -> PyTree:
    """Returns `function(part, shared)` for each part of `size` rows, or zeros if none of its rows is valid.

    The leaves of `rows` have T rows, a multiple of `size`. Those of the result have the parts along their first axis.
    """

    @jax.custom_jvp
    def values(valid, rows, shared):
        def of_part(k):
            def part():
                return jax.tree.map(lambda leaf: lax.dynamic_slice_in_dim(leaf, k * size, size), rows)

            return _if_valid(lambda: function(part(), shared), valid[k * size])

        return lax.map(of_part, jnp.arange(valid.size // size))

    # Rows that are not needed are not read above. The transpose would add a whole list of zeros for every part, so that
    # derivatives are those of a loop that reads all rows.
    @values.defjvp
    def _(primals, tangents):
        def of_all(valid, rows, shared):
            @jax.checkpoint
            def of_part(row):
                valid, part = row
                return _if_valid(lambda: function(part, shared), valid)

            parts = jax.tree.map(lambda leaf: leaf.reshape(-1, size, *leaf.shape[1:]), rows)
            return lax.map(of_part, (valid[::size], parts))

        return values(*primals), jax.jvp(of_all, primals, tangents)[1]

    return values(valid, rows, shared)


def _if_valid(found: Callable[[], PyTree], valid: Bool[Array, ""]) -> PyTree:
    nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), jax.eval_shape(found))
    return lax.cond(greatest(valid), found, lambda: nothing)
