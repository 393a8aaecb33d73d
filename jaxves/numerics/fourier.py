r"""Trigonometric interpolation on the periodic grid α_j = 2πj/N, N even.

    f(α) = Σ_k f̂_k e^{ikα},   |k| ≤ N/2

Derivatives drop the Nyquist mode k = N/2, which no odd derivative can see; what must not live in it
is filtered (`low_pass`). All functions act on the node axis `axis`.

Everything is a product with a constant matrix rather than a fast transform: at the sizes of one membrane that is
as fast on a CPU, and XLA's CPU transform can lock up its own thread pool when it runs inside a compiled loop.
Only grids of more than `_DENSE` nodes, on which no loop runs, are transformed.

[T] L. N. Trefethen, Spectral Methods in MATLAB, ch. 3.
"""

import functools

import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from .arrays import Scalar, staged

_DENSE = 1024
_CONSTANT = 256


def grid(N: int) -> Float[Array, "N"]:
    """The parameter values α_j = 2πj/N."""
    return 2 * np.pi * jnp.arange(N) / N


def wavenumbers(N: int) -> np.ndarray:
    """k = 0 … N/2, one per entry of a real transform."""
    return np.arange(N // 2 + 1)


def _along(matrix: np.ndarray, f: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """The matrix applied along one axis."""
    return jnp.moveaxis(jnp.moveaxis(f, axis, -1) @ staged(matrix.T), -1, axis)


def multiply(f: Float[Array, "..."], symbol: np.ndarray, axis: int = -1) -> Float[Array, "..."]:
    """Multiplies mode k by symbol[k], k = 0 … N/2."""
    N = f.shape[axis]
    if N <= _DENSE:
        return _along(circulant(symbol, N), f, axis)
    shape = [1] * f.ndim
    shape[axis] = -1
    return jnp.fft.irfft(jnp.fft.rfft(f, axis=axis) * symbol.reshape(shape), N, axis=axis)


def circulant(symbol: np.ndarray, N: int) -> np.ndarray:
    """The matrix (N, N) of `multiply`."""
    column = np.fft.irfft(symbol, N)
    j = np.arange(N)
    return column[(j[:, None] - j[None, :]) % N]


def spread(column: np.ndarray) -> Float[Array, "N N"]:
    """The circulant matrix with this first column.

    A large one is made where it is needed: as a constant it would take its space in a compiled program at every place
    that names it, gigabytes in all.
    """
    N = column.shape[0]
    if N > _CONSTANT:
        j = jnp.arange(N)
        return lax.optimization_barrier(jnp.asarray(column))[(j[:, None] - j[None, :]) % N]
    j = np.arange(N)
    return staged(column[(j[:, None] - j[None, :]) % N])


def derivative_symbol(N: int) -> np.ndarray:
    """ik, zero at Nyquist."""
    symbol = 1j * wavenumbers(N)
    symbol[-1] = 0
    return symbol


def derivative(f: Float[Array, "..."], axis: int = -1) -> Float[Array, "..."]:
    """df/dα at the nodes."""
    return multiply(f, derivative_symbol(f.shape[axis]), axis)


def derivative_matrix(N: int) -> np.ndarray:
    """The matrix of `derivative`."""
    return circulant(derivative_symbol(N), N)


def antiderivative(f: Float[Array, "..."], axis: int = -1) -> Float[Array, "..."]:
    """∫ (f - mean) dα with mean zero."""
    N = f.shape[axis]
    k = wavenumbers(N)
    return multiply(f, np.where((k > 0) & (k < N // 2), -1j / np.maximum(k, 1), 0), axis)


def low_pass_symbol(N: int, cut: int) -> np.ndarray:
    """One for |k| ≤ N/2 - cut, zero above: cut = 1 removes Nyquist alone."""
    return (wavenumbers(N) <= N // 2 - cut).astype(float)


def low_pass(f: Float[Array, "..."], cut: int, axis: int = -1) -> Float[Array, "..."]:
    """Removes the `cut` highest modes."""
    return multiply(f, low_pass_symbol(f.shape[axis], cut), axis)


def low_pass_matrix(N: int, cut: int) -> np.ndarray:
    """The matrix of `low_pass`."""
    return circulant(low_pass_symbol(N, cut), N)


def high_modes(N: int, cut: int) -> np.ndarray:
    """Orthonormal basis (N, 2·cut - 1) of the modes that `low_pass` removes."""
    j, k = np.arange(N), np.arange(N // 2 - cut + 1, N // 2)
    phase = 2 * np.pi * np.outer(j, k) / N
    pairs = np.concatenate([np.cos(phase), np.sin(phase)], axis=1) * np.sqrt(2 / N)
    return np.concatenate([pairs, ((-1.0) ** j)[:, None] / np.sqrt(N)], axis=1)


def low_pass_rows(matrix: Float[Array, "N k"], cut: int) -> Float[Array, "N k"]:
    """`low_pass` along the first axis of a wide matrix, as a low-rank update."""
    modes = high_modes(matrix.shape[0], cut)
    return matrix - modes @ (modes.T @ matrix)


@functools.cache
def resampling_matrix(N: int, K: int) -> np.ndarray:
    """The matrix (K, N) of `resample`."""
    spectrum = np.fft.rfft(np.eye(N), axis=0)
    if K < N:
        spectrum = spectrum[: K // 2]  # what would alias, and the Nyquist mode of the coarser grid
    elif K > N:
        spectrum[-1] *= 0.5  # a mode of its own on the finer grid, shared between ±N/2
    return np.fft.irfft(spectrum, K, axis=0) * (K / N)


def resample(f: Float[Array, "..."], K: int, axis: int = -1) -> Float[Array, "..."]:
    """The trigonometric interpolant of f on a grid of K nodes; on a finer one its values at the old nodes stay."""
    N = f.shape[axis]
    return f if K == N else _along(resampling_matrix(N, K), f, axis)


def coefficients(f: Float[Array, "N *rest"]) -> tuple[Float[Array, "k *rest"], Float[Array, "k *rest"]]:
    """Cosine and sine coefficients a_k, b_k, k = 0 … N/2, of f = Σ a_k cos kα + b_k sin kα; node axis first."""
    N = f.shape[0]
    transform = np.fft.rfft(np.eye(N), axis=0)
    k = wavenumbers(N)
    weight = np.where((k == 0) | (k == N // 2), 1.0, 2.0)[:, None] / N
    return jnp.tensordot(weight * transform.real, f, 1), jnp.tensordot(-weight * transform.imag, f, 1)


def series(modes: tuple[Float[Array, "k *rest"], Float[Array, "k *rest"]], alpha: Float[Array, "P"]):
    """Σ a_k cos kα + b_k sin kα at the parameters `alpha`, (P, *rest), from `coefficients`."""
    phase = alpha[:, None] * np.arange(modes[0].shape[0])
    return jnp.tensordot(jnp.cos(phase), modes[0], 1) + jnp.tensordot(jnp.sin(phase), modes[1], 1)


def evaluate(f: Float[Array, "N *rest"], alpha: Float[Array, "P"]) -> Float[Array, "P *rest"]:
    """The trigonometric interpolant of f at the parameters `alpha`; node axis first."""
    return series(coefficients(f), alpha)


def spectral_tail(f: Float[Array, "N *rest"], cut: int) -> Scalar:
    """How much is left at the top of the spectrum: round-off for a resolved f, near 1 for an unresolved one.

    The largest amplitude among the top eighth of the modes that survive `low_pass(f, cut)`, over the
    largest of all modes but the mean; node axis first.
    """
    cosine, sine = coefficients(f)
    size = jnp.max(jnp.abs(cosine) + jnp.abs(sine), axis=tuple(range(1, f.ndim)))
    last = f.shape[0] // 2 - cut
    # at least two: a symmetric curve has no modes of one parity
    high = jnp.max(size[last - max(last // 8, 2) + 1 : last + 1])
    return high / jnp.maximum(jnp.max(size[1:]), jnp.finfo(size.dtype).tiny)
