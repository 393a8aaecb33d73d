r"""Trigonometric interpolation on the periodic grid α_j = 2πj/N, N even.

    f(α) = Σ_k f̂_k e^{ikα},   |k| ≤ N/2

Derivatives drop the Nyquist mode k = N/2, which no odd derivative can see; what must not live in it
is filtered (`low_pass`). All functions act on the node axis `axis`.

[T] L. N. Trefethen, Spectral Methods in MATLAB, ch. 3.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .arrays import Scalar


def grid(N: int) -> Float[Array, "N"]:
    """The parameter values α_j = 2πj/N."""
    return 2 * np.pi * jnp.arange(N) / N


def wavenumbers(N: int) -> np.ndarray:
    """k = 0 … N/2, one per entry of a real FFT."""
    return np.arange(N // 2 + 1)


# Up to this many nodes a product with a constant matrix beats two small transforms (CPU).
_DENSE = 128


def _multiply(f: Float[Array, "..."], symbol: np.ndarray, axis: int) -> Float[Array, "..."]:
    if f.shape[axis] <= _DENSE:
        rows = jnp.moveaxis(f, axis, -1)
        return jnp.moveaxis(rows @ circulant(symbol, f.shape[axis]).T, -1, axis)
    shape = [1] * f.ndim
    shape[axis] = -1
    return jnp.fft.irfft(jnp.fft.rfft(f, axis=axis) * symbol.reshape(shape), f.shape[axis], axis=axis)


def derivative_symbol(N: int, order: int = 1) -> np.ndarray:
    """(ik)^order, zero at Nyquist."""
    symbol = (1j * wavenumbers(N)) ** order
    symbol[-1] = 0
    return symbol


def derivative(f: Float[Array, "..."], order: int = 1, axis: int = -1) -> Float[Array, "..."]:
    """d^order f / dα^order at the nodes."""
    return _multiply(f, derivative_symbol(f.shape[axis], order), axis)


def circulant(symbol: np.ndarray, N: int) -> np.ndarray:
    """The matrix (N, N) that multiplies mode k of a grid function by symbol[k], k = 0 … N/2."""
    column = np.fft.irfft(symbol, N)
    j = np.arange(N)
    return column[(j[:, None] - j[None, :]) % N]


def derivative_matrix(N: int) -> np.ndarray:
    """The matrix of `derivative`."""
    return circulant(derivative_symbol(N), N)


def low_pass_symbol(N: int, cut: int) -> np.ndarray:
    """One for |k| ≤ N/2 - cut, zero above: cut = 1 removes Nyquist alone."""
    return (wavenumbers(N) <= N // 2 - cut).astype(float)


def low_pass(f: Float[Array, "..."], cut: int, axis: int = -1) -> Float[Array, "..."]:
    """Removes the `cut` highest modes."""
    return _multiply(f, low_pass_symbol(f.shape[axis], cut), axis)


def low_pass_matrix(N: int, cut: int) -> np.ndarray:
    """The matrix of `low_pass`."""
    return circulant(low_pass_symbol(N, cut), N)


def resample(f: Float[Array, "..."], N: int, axis: int = -1) -> Float[Array, "..."]:
    """The trigonometric interpolant of f on a grid of N nodes; exact both ways for resolved f."""
    old = f.shape[axis]
    if N == old:
        return f
    f_hat = jnp.fft.rfft(f, axis=axis)
    keep = min(old, N) // 2
    f_hat = jnp.take(f_hat, jnp.arange(keep), axis=axis)  # Nyquist of the coarser grid is ambiguous: drop it
    return jnp.fft.irfft(f_hat, N, axis=axis) * (N / old)


def evaluate(f: Float[Array, "N *rest"], alpha: Float[Array, "P"]) -> Float[Array, "P *rest"]:
    """The trigonometric interpolant of f at the parameters `alpha`; node axis first."""
    N = f.shape[0]
    k = wavenumbers(N)
    weight = np.where((k == 0) | (k == N // 2), 1.0, 2.0) / N
    f_hat = jnp.fft.rfft(f, axis=0)
    phase = jnp.exp(1j * alpha[:, None] * k) * weight
    return jnp.real(jnp.tensordot(phase, f_hat, axes=1))


def spectral_tail(f: Float[Array, "..."], cut: int, axis: int = -1) -> Scalar:
    """How much is left at the top of the spectrum: round-off for a resolved f, near 1 for an unresolved one.

    The largest amplitude among the top eighth of the modes that survive `low_pass(f, cut)`, over the
    largest of all modes but the mean.
    """
    N = f.shape[axis]
    size = jnp.moveaxis(jnp.abs(jnp.fft.rfft(f, axis=axis)), axis, -1)
    size = size.reshape(-1, size.shape[-1]).max(axis=0)
    last = N // 2 - cut
    high = size[last - last // 8 + 1 : last + 1].max()
    return high / jnp.maximum(size[1:].max(), jnp.finfo(size.dtype).tiny)


def high_modes(N: int, cut: int) -> np.ndarray:
    """Orthonormal basis (N, 2·cut - 1) of the modes that `low_pass` removes."""
    j, k = np.arange(N), np.arange(N // 2 - cut + 1, N // 2)
    phase = 2 * np.pi * np.outer(j, k) / N
    pairs = np.concatenate([np.cos(phase), np.sin(phase)], axis=1) * np.sqrt(2 / N)
    return np.concatenate([pairs, ((-1.0) ** j)[:, None] / np.sqrt(N)], axis=1)
