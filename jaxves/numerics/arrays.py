"""Names for array shapes, and double precision.

Axis names: `M` vesicles, `N` nodes on one vesicle, `P` target points, `T` saved times.
A `Scalar` is an array without axes. Constructors convert Python numbers to such arrays with `as_float`, so that every
physical number can be differentiated and batched.
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

Scalar = Float[Array, ""]
Nodes = Float[Array, "N"]
NodePoints = Float[Array, "N 2"]
NodeMatrix = Float[Array, "N N"]
PerVesicle = Float[Array, "M"]
VesicleNodes = Float[Array, "M N"]
VesiclePoints = Float[Array, "M N 2"]
Points = Float[Array, "P 2"]
ScalarLike = float | int | Scalar
Status = Int[Array, ""]


def as_float(value) -> Float[Array, "..."]:
    """Returns `value` as an array in double precision; traced values stay traced."""
    return jnp.asarray(value, dtype=float)


def optional_float(value) -> Float[Array, "..."] | None:
    """Returns `value` as an array in double precision, or None for None."""
    return None if value is None else as_float(value)


CONSTANT = 3 * 2**16  # entries of the largest matrix that is a constant of a compiled program


def staged(constant: np.ndarray | Array) -> Array:
    """Wraps a constant in `jit`, so that `jax.checkpoint` recomputes it instead of storing it.

    A plain constant would be stored for the backward pass, one copy for each branch of a `lax.switch`. Equal constants
    share one function, so that a program contains them once. An array of JAX is returned as it is.
    """
    if isinstance(constant, Array):
        return constant
    constant = np.ascontiguousarray(constant)
    return _staged(constant.shape, constant.dtype.str, constant.tobytes())()


@functools.lru_cache(maxsize=128)
def _staged(shape: tuple[int, ...], dtype: str, data: bytes) -> Callable[[], Array]:
    return jax.jit(lambda: jnp.asarray(np.frombuffer(data, dtype).reshape(shape)))


def picked(
    values: Float[np.ndarray, "n"], places: Callable[[Callable[[int], Array]], Array], entries: int
) -> np.ndarray | Array:
    """Returns values[places(arange)], an array with this number of entries, in NumPy if there are few of them.

    More than `CONSTANT` entries are picked inside the compiled program, with the `arange` of JAX. As a constant, they
    would fill the text of the program. The barrier keeps the compiler from computing them in advance.
    """
    if entries <= CONSTANT:
        return values[places(np.arange)]
    return lax.optimization_barrier(jnp.asarray(values))[places(jnp.arange)]


def identity(n: int) -> np.ndarray | Float[Array, "n n"]:
    """Returns the identity matrix, in NumPy if it is small (see `picked`)."""
    return np.eye(n) if n * n <= CONSTANT else jnp.eye(n)


def require_x64() -> None:
    """Raises RuntimeError if JAX computes in single precision.

    The implicit step inverts operators with condition numbers up to 1e7. Single precision has seven digits, so no
    correct digit would be left.
    """
    if not jax.config.jax_enable_x64:
        raise RuntimeError(
            "jaxves needs double precision, but jax_enable_x64 is off: call "
            "jax.config.update('jax_enable_x64', True) before the first array is made."
        )
