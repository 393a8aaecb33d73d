"""Names for array shapes, and the one precision the method works in.

Axis names: `M` vesicles, `N` nodes on one vesicle, `P` target points, `T` saved times.
A lone `Scalar` is a traced zero-dimensional array; Python numbers become one at the door
(`as_float`), so that every number with a meaning can be differentiated and batched.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

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
ComplexNodes = Complex[Array, "N"]


def as_float(value) -> Float[Array, "..."]:
    """A double-precision array; leaves tracers and their shapes alone."""
    return jnp.asarray(value, dtype=float)


def staged(constant: np.ndarray) -> Array:
    """The constant, as if it were computed: what makes things again for a derivative makes it again as well.

    As a constant it would be kept beside what is made again, once for every branch of a `lax.switch`, where those
    that are not taken fill it with zeros.
    """
    return jax.jit(lambda: jnp.asarray(constant))()


def require_x64() -> None:
    """Raises RuntimeError when JAX would compute in single precision.

    The implicit step inverts operators whose condition number reaches 1e7: seven digits leave nothing.
    """
    if not jax.config.jax_enable_x64:
        raise RuntimeError(
            "jaxves needs double precision, but jax_enable_x64 is off: call "
            "jax.config.update('jax_enable_x64', True) before the first array is made."
        )
