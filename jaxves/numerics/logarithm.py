r"""The logarithm in double precision as plain arithmetic, which XLA vectorises on CPUs.

    log x = e log 2 + log m,    x = 2^e m,  m in [√½, √2)
    log m = 2 artanh s = 2 (s + s³/3 + s⁵/5 + …),    s = (m - 1)/(m + 1),  |s| ≤ 0.172

e and m come from the bits of x. Ten terms leave 3e-17. With it, the direct sum of the Stokes single layer takes
0.6 to 0.8 of the time that it takes with `jnp.log`, on one busy core with AVX-512 (`experiments/fast_sums.py`).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

_TERMS = 10
_MANTISSA = 52  # bits
_LEAST = np.sqrt(0.5).view(np.int64)  # bits of the least m
_SHIFT = np.float64(1.5 * 2.0**_MANTISSA)  # its last bit is worth 1, so that adding it converts integers exactly


@jax.custom_jvp
def log(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Returns log x for positive normal numbers x. The value for other numbers is finite and has no meaning."""
    bits = lax.bitcast_convert_type(x, jnp.int64)
    e = (bits - _LEAST) >> _MANTISSA
    m = lax.bitcast_convert_type(bits - (e << _MANTISSA), jnp.float64)
    s = (m - 1) / (m + 1)
    s2 = s * s
    series = jnp.full_like(s, 2 / (2 * _TERMS - 1))
    for k in range(_TERMS - 2, -1, -1):
        series = series * s2 + 2 / (2 * k + 1)
    exponent = lax.bitcast_convert_type(e + _SHIFT.view(np.int64), jnp.float64) - _SHIFT
    return exponent * np.log(2.0) + s * series


@log.defjvp
def _(primals, tangents):
    (x,), (dx,) = primals, tangents
    return log(x), dx / x
