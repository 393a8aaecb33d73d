r"""The kernels of Laplace and Stokes as a local part within r_c and a smooth rest.

A point charge is replaced by a radial blob of unit mass within r_c. With t = (r/r_c)², u = √(1 - t) and the shape c:

    R(t) = sinh(c u)/sinh c                   part of the field of the charge that stays local
    E(t) = (1 - R)/t,    H(t) = -½ ∫_t^1 E    smooth in t, so polynomials
    γ(κ) = (c/sinh c) sinh(w)/w,  w = √(c² - κ²),  κ = |k| r_c         Fourier transform of the blob

Every kernel has the form A δ_ab + B r_a r_b for Stokes, and -2 B r_a for ∇G. G is 2 (A + B r²) up to a constant:

    local        4π A = -½ log t + H - R           4π B = R/r²                        zero for t ≥ 1
    smooth       4π A = 1 - log r_c - H - t E      4π B = E/r_c²                      for t < 1
                 4π A = -log r                     4π B = 1/r²                        for t ≥ 1

The kernel of the Stokes double layer is K_abc n_b u_c with K_abc = -δ_bc ∂_a G - ∂_c S_ab - ∂_b S_ac. Its parts follow
from those of G and S and have the form C (r_c δ_ab + r_b δ_ac) + Q r_a r_b r_c:

    local        4π C = -2 (E + t E')/r_c²         4π Q = 4/r⁴ + 4 E'/r_c⁴            zero for t ≥ 1
    smooth       4π C = 2 (E + t E')/r_c²          4π Q = -4 E'/r_c⁴                  for t < 1
                 4π C = 0                          4π Q = 4/r⁴                        for t ≥ 1

In Fourier space the smooth parts are γ/k² for G and (1 - kk/k²)(γ - ½ κ γ')/k² for Stokes. This is Hasimoto's form [H]
for any blob. Beyond κ = c the transform is below the tolerance. The root of R at t = 1 has the size c/sinh c, so that a
polynomial misses it only by the tolerance.

[H] H. Hasimoto, On the periodic fundamental solutions of the Stokes equations, J. Fluid Mech. 5 (1959) 317-328.
"""

import functools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.polynomial import chebyshev

from ..numerics.arrays import Scalar, ScalarLike
from ..numerics.logarithm import log
from .plans import Accuracy

Kernel = tuple[Float[Array, "*pairs"], Float[Array, "*pairs"]]  # A and B, or C and Q
_SAMPLES = 100  # Chebyshev points at which E is sampled
_SINE = [1 / math.factorial(2 * k + 1) for k in range(8, -1, -1)]
_CHANGE = [2 * k / math.factorial(2 * k + 1) for k in range(9, 0, -1)]


@functools.cache
def _polynomials(accuracy: Accuracy) -> tuple[np.ndarray, np.ndarray]:
    """Returns the coefficients of E and H in powers of 2t - 1, the highest first."""
    c = accuracy.shape
    z = np.cos(np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES)
    t = 0.5 * (z + 1)
    u = np.sqrt(1 - t)
    # sinh c - sinh cu as a product, because the difference loses digits at small t
    E = 2 * np.cosh(0.5 * c * (1 + u)) * np.sinh(0.5 * c * t / (1 + u)) / (np.sinh(c) * t)
    E = chebyshev.chebfit(z, E, _SAMPLES - 1)[: accuracy.degree + 1]
    H = 0.25 * chebyshev.chebint(E, lbnd=1)  # dt is dz/2
    return chebyshev.cheb2poly(E)[::-1], chebyshev.cheb2poly(H)[::-1]


def _smooth_functions(t, accuracy: Accuracy):
    """Returns E and H, for arrays of NumPy or JAX with t ≤ 1."""
    z = 2 * t - 1
    found = []
    for coefficients in _polynomials(accuracy):
        value = coefficients[0] * (z * 0 + 1)
        for coefficient in coefficients[1:]:
            value = value * z + coefficient
        found.append(value)
    return found


def local(r2: Float[Array, "*pairs"], r_c: Scalar, accuracy: Accuracy) -> Kernel:
    """Returns A and B of the local part, which are zero at r = 0 and for r ≥ r_c."""
    t = r2 / r_c**2
    inside = (t < 1) & (t > 0)
    t = jnp.where(inside, t, 0.5)
    E, H = _smooth_functions(t, accuracy)
    R = 1 - t * E
    A = (-0.5 * log(t) + H - R) / (4 * np.pi)
    B = R / (t * (4 * np.pi * r_c**2))
    return jnp.where(inside, A, 0.0), jnp.where(inside, B, 0.0)


def smooth(r2: Float[Array, "*pairs"], r_c: Scalar, accuracy: Accuracy) -> Kernel:
    """Returns A and B of the smooth part at any distance, zero included."""
    t = r2 / r_c**2
    inside = t < 1
    E, H = _smooth_functions(jnp.where(inside, t, 0.5), accuracy)
    outer = jnp.where(inside, 1.0, r2)
    A = jnp.where(inside, 1 - jnp.log(r_c) - H - t * E, -0.5 * log(outer))
    B = jnp.where(inside, E / r_c**2, 1 / outer)
    return A / (4 * np.pi), B / (4 * np.pi)


def smooth_on_host(r2: np.ndarray, r_c: float, accuracy: Accuracy) -> tuple[np.ndarray, np.ndarray]:
    """Returns the same as `smooth` as arrays of NumPy."""
    t = r2 / r_c**2
    inside = t < 1
    E, H = _smooth_functions(np.where(inside, t, 0.5), accuracy)
    outer = np.where(inside, 1.0, r2)
    A = np.where(inside, 1 - np.log(r_c) - H - t * E, -0.5 * np.log(outer))
    B = np.where(inside, E / r_c**2, 1 / outer)
    return A / (4 * np.pi), B / (4 * np.pi)


def local_stresslet(r2: Float[Array, "*pairs"], r_c: Scalar, accuracy: Accuracy) -> Kernel:
    """Returns C and Q of the local part, which are zero at r = 0 and for r ≥ r_c."""
    t = r2 / r_c**2
    inside = (t < 1) & (t > 0)
    t = jnp.where(inside, t, 0.5)
    C, Q = _smooth_stresslet(t, accuracy)
    scale = 1 / (4 * np.pi * r_c**2)
    return jnp.where(inside, -C * scale, 0.0), jnp.where(inside, (4 / t**2 - Q) * (scale / r_c**2), 0.0)


def smooth_stresslet(
    r2: Float[Array | np.ndarray, "*pairs"], r_c: ScalarLike, accuracy: Accuracy
) -> tuple[Float[Array | np.ndarray, "*pairs"], Float[Array | np.ndarray, "*pairs"]]:
    """Returns C and Q of the smooth part at any distance, zero included, in the library of `r2`: JAX or NumPy."""
    xp = r2.__array_namespace__()
    t = r2 / r_c**2
    inside = t < 1
    C, Q = _smooth_stresslet(xp.where(inside, t, 0.5), accuracy)
    outer = xp.where(inside, 1.0, r2)
    return (
        xp.where(inside, C / (4 * np.pi * r_c**2), 0.0),
        xp.where(inside, Q / (4 * np.pi * r_c**4), 1 / (np.pi * outer**2)),
    )


def _smooth_stresslet(t, accuracy: Accuracy):
    """Returns 2 (E + t E') and -4 E', for arrays of NumPy or JAX with t ≤ 1."""
    E, slope = _polynomials(accuracy)[0], 0.0
    z, value = 2 * t - 1, E[0]
    for coefficient in E[1:]:
        slope = slope * z + value
        value = value * z + coefficient
    return 2 * (value + t * (2 * slope)), -8 * slope


def blob_transforms(kappa2: Float[Array, "*modes"], accuracy: Accuracy) -> tuple[Array, Array]:
    """Returns γ and γ - ½ κ γ' for κ², both zero for κ ≥ c."""
    c = accuracy.shape
    w2 = c**2 - kappa2
    inside, small = w2 > 0, w2 < 1
    w2 = jnp.where(inside, w2, 0.0)
    w = jnp.sqrt(jnp.where(small, 1.0, w2))
    # c/sinh c times sinh w and cosh w, without overflow
    scale = c / (1 - np.exp(-2 * c))
    sinh = scale * (jnp.exp(w - c) - jnp.exp(-w - c))
    cosh = scale * (jnp.exp(w - c) + jnp.exp(-w - c))
    least = 2 * scale * np.exp(-c)
    # for small w, series of sinh(w)/w and (cosh(w) - sinh(w)/w)/w², where the difference has no digits
    gamma = jnp.where(small, least * jnp.polyval(np.array(_SINE), w2), sinh / w)
    change = jnp.where(small, least * jnp.polyval(np.array(_CHANGE), w2), (cosh - sinh / w) / w**2)
    stokes = gamma + 0.5 * kappa2 * change
    return jnp.where(inside, gamma, 0.0), jnp.where(inside, stokes, 0.0)


def local_mean(r_c: Scalar, accuracy: Accuracy) -> Scalar:
    """Returns the integral of the local part of G over the plane."""
    c = accuracy.shape
    return r_c**2 * 0.5 * (1 / (c * np.tanh(c)) - 1 / c**2)
