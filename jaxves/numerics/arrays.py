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


def staged(constant: np.ndarray) -> Array:
    """Wraps a constant in `jit`, so that `jax.checkpoint` recomputes it instead of storing it.

    A plain constant would be stored for the backward pass, one copy for each branch of a `lax.switch`. Equal constants
    share one function, so that a program contains them once.
    """
    constant = np.ascontiguousarray(constant)
    return _staged(constant.shape, constant.dtype.str, constant.tobytes())()


@functools.lru_cache(maxsize=128)
def _staged(shape: tuple[int, ...], dtype: str, data: bytes) -> Callable[[], Array]:
    return jax.jit(lambda: jnp.asarray(np.frombuffer(data, dtype).reshape(shape)))


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
