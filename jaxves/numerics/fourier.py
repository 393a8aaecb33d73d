r"""Trigonometric interpolation on the periodic grid α_j = 2πj/N, N even.

    f(α) = Σ_k f̂_k e^{ikα},   |k| ≤ N/2

Odd derivatives of the Nyquist mode k = N/2 vanish at the nodes, so `derivative` drops this mode. `low_pass` removes it
from functions that must not contain it. All functions act on the node axis `axis`.

XLA's fast Fourier transform can deadlock on CPUs inside compiled loops. Only grids with more than `_LARGEST` nodes use
it; no compiled loop uses such grids. On small grids, every operation is a product with one constant matrix. On larger
grids it consists of three products: a transform over blocks of nodes makes the matrix block diagonal (`_blocks`). For
matrices this is faster from 128 nodes on. On one core a matrix of 1024 nodes takes 7.8 ms instead of 54 ms, and with
XLA's transform 9.0 ms.

Matrices with more than `_CONSTANT`² entries are built inside the compiled program from one of their columns. As
constants they would fill the text of the program: 115 MB with 512 nodes, and sixteen times as much with 2048.

[T] L. N. Trefethen, Spectral Methods in MATLAB, ch. 3.
"""

import functools
import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .arrays import CONSTANT, Scalar, picked, staged

_LARGEST = 2048
_WIDE = 128  # nodes from which three products are faster for matrices
_NARROW = 512  # the same for vectors


def grid(N: int) -> Float[Array, "N"]:
    """Returns the parameter values α_j = 2πj/N."""
    return 2 * np.pi * jnp.arange(N) / N


def wavenumbers(N: int) -> np.ndarray:
    """Returns k = 0 … N/2, one for each entry of a real Fourier transform."""
    return np.arange(N // 2 + 1)


def _along(matrix: np.ndarray | Array, f: Float[Array, "..."], axis: int) -> Float[Array, "..."]:
    """Applies `matrix` along one axis of f.

    For a few columns the transposed product is several times faster: XLA makes vectors of its last axis only.
    """
    if f.ndim == 2 and axis == 0 and f.size >= f.shape[0] ** 2:
        return staged(matrix) @ f
    return jnp.moveaxis(jnp.moveaxis(f, axis, -1) @ staged(matrix.T), -1, axis)


def multiply(f: Float[Array, "..."], symbol: np.ndarray, axis: int = -1) -> Float[Array, "..."]:
    """Multiplies mode k by symbol[k], k = 0 … N/2."""
    N = f.shape[axis]
    if N > _LARGEST:
        shape = [1] * f.ndim
        shape[axis] = -1
        return jnp.fft.irfft(jnp.fft.rfft(f, axis=axis) * symbol.reshape(shape), N, axis=axis)
    count = _block_count(N)
    if count is None or (_WIDE if f.size >= N * N else _NARROW) > N:
        return _along(circulant(symbol, N), f, axis)
    rows = jnp.moveaxis(f, axis, 0)
    return jnp.moveaxis(_by_blocks(rows.reshape(N, -1), symbol, count).reshape(rows.shape), 0, axis)


@functools.cache
def _block_count(N: int) -> int | None:
    """Returns the even number of blocks into which N nodes are divided, about √N; None if there is no such divisor."""
    return max((n for n in range(4, int(np.sqrt(2 * N)) + 1, 2) if N % n == 0), default=None)


def _by_blocks(f: Float[Array, "N k"], symbol: np.ndarray, count: int) -> Float[Array, "N k"]:
    """Returns `multiply` along the first axis, as three products."""
    N, k = f.shape
    transform = _block_transform(count)
    modes = (staged(transform) @ f.reshape(count, -1)).reshape(count // 2, -1, k)
    modes = jnp.einsum("bij,bjk->bik", staged(_blocks(symbol, N, count)), modes)
    return (staged(transform.T) @ modes.reshape(count, -1)).reshape(N, k)


def _block_transform(count: int) -> np.ndarray:
    """Returns the orthogonal real Fourier transform of `count` values.

    Its rows are the mean, the Nyquist mode, and the pairs of cosine and sine.
    """
    j, k = np.arange(count), np.arange(1, count // 2)
    phase = 2 * np.pi * np.outer(k, j) / count
    pairs = np.stack([np.cos(phase), np.sin(phase)], axis=1).reshape(-1, count) * np.sqrt(2 / count)
    return np.concatenate([np.ones((1, count)), (-1.0) ** j[None], np.sqrt(count) * pairs]) / np.sqrt(count)


def _blocks(symbol: np.ndarray, N: int, count: int) -> np.ndarray:
    """Returns the diagonal blocks (count/2, 2n, 2n), n = N/count, of a circulant matrix after `_block_transform`.

    Node j = n j₁ + j₂ is entry j₂ of block j₁. The transform over j₁ makes the matrix diagonal in its wavenumber. Each
    diagonal entry is a complex matrix for j₂, here with the real and the imaginary part of the modes as unknowns.
    """
    n = N // count
    columns = np.fft.rfft(np.fft.irfft(symbol, N).reshape(count, n), axis=0)
    wrapped = np.exp(-2j * np.pi * np.arange(count // 2 + 1) / count)[:, None] * columns
    difference = np.arange(n)[:, None] - np.arange(n)[None, :]
    C = np.where(difference >= 0, columns[:, difference], wrapped[:, difference])
    blocks = np.concatenate([np.concatenate([C.real, C.imag], 2), np.concatenate([-C.imag, C.real], 2)], 1)
    zero = np.zeros((n, n))
    blocks[0] = np.block([[C[0].real, zero], [zero, C[-1].real]])
    return blocks[:-1]


def circulant(symbol: np.ndarray, N: int) -> np.ndarray | Float[Array, "N N"]:
    """Returns the matrix (N, N) of `multiply`, in NumPy if it is small."""
    return _rotations(np.fft.irfft(symbol, N))


def _rotations(column: np.ndarray) -> np.ndarray | Float[Array, "N N"]:
    N = column.shape[0]

    def places(arange):
        j = arange(N)
        return (j[:, None] - j[None, :]) % N

    return picked(column, places, N * N)


def spread(column: np.ndarray) -> Float[Array, "N N"]:
    """Returns the circulant matrix with this first column."""
    return staged(_rotations(column))


def derivative_symbol(N: int) -> np.ndarray:
    """Returns ik, with zero for the Nyquist mode."""
    symbol = 1j * wavenumbers(N)
    symbol[-1] = 0
    return symbol


def derivative(f: Float[Array, "..."], axis: int = -1) -> Float[Array, "..."]:
    """Returns df/dα at the nodes."""
    return multiply(f, derivative_symbol(f.shape[axis]), axis)


def derivative_matrix(N: int) -> np.ndarray | Float[Array, "N N"]:
    """The matrix of `derivative`."""
    return circulant(derivative_symbol(N), N)


def elastic_matrices(N: int, cut: int) -> tuple[np.ndarray | Float[Array, "N N"], ...]:
    """Returns the matrices of d⁴/dα⁴ and d/dα after `low_pass`."""
    symbol, kept = derivative_symbol(N), low_pass_symbol(N, cut)
    return circulant(symbol**4 * kept, N), circulant(symbol * kept, N)


def antiderivative(f: Float[Array, "..."], axis: int = -1) -> Float[Array, "..."]:
    """Returns ∫ (f - mean of f) dα, with the constant for which its own mean is zero."""
    N = f.shape[axis]
    k = wavenumbers(N)
    return multiply(f, np.where((k > 0) & (k < N // 2), -1j / np.maximum(k, 1), 0), axis)


def low_pass_symbol(N: int, cut: int) -> np.ndarray:
    """Returns 1 for |k| ≤ N/2 - cut and 0 above. With cut = 1 only the Nyquist mode is removed."""
    return (wavenumbers(N) <= N // 2 - cut).astype(float)


def low_pass(f: Float[Array, "..."], cut: int, axis: int = -1) -> Float[Array, "..."]:
    """Removes the `cut` highest modes."""
    return multiply(f, low_pass_symbol(f.shape[axis], cut), axis)


def low_pass_matrix(N: int, cut: int) -> np.ndarray | Float[Array, "N N"]:
    """The matrix of `low_pass`."""
    return circulant(low_pass_symbol(N, cut), N)


def high_modes(N: int, cut: int) -> np.ndarray | Float[Array, "N n"]:
    """Returns an orthonormal basis (N, 2·cut - 1) of the modes that `low_pass` removes, in NumPy if it is small."""
    count, first = 2 * cut - 1, N // 2 - cut + 1
    if N * count <= CONSTANT:
        j, k = np.arange(N), np.arange(first, N // 2)
        phase = 2 * np.pi * np.outer(j, k) / N
        pairs = np.concatenate([np.cos(phase), np.sin(phase)], axis=1) * np.sqrt(2 / N)
        return np.concatenate([pairs, ((-1.0) ** j)[:, None] / np.sqrt(N)], axis=1)
    phase = 2 * np.pi * np.arange(N) / N
    tables = np.concatenate([np.sqrt(2) * np.cos(phase), np.sqrt(2) * np.sin(phase), np.cos(phase)]) / np.sqrt(N)

    def places(arange):
        n = arange(count)
        table = n // (cut - 1)
        k = first + n - table * (cut - 1)
        return table * N + (arange(N)[:, None] * (k + (table == 2) * (N // 2 - first))) % N

    return picked(tables, places, N * count)


def low_pass_rows(matrix: Float[Array, "N k"], cut: int) -> Float[Array, "N k"]:
    """Applies `low_pass` along the first axis of a wide matrix, as a low-rank update."""
    modes = high_modes(matrix.shape[0], cut)
    return matrix - modes @ (modes.T @ matrix)


@functools.cache
def resampling_matrix(N: int, K: int) -> np.ndarray:
    """The matrix (K, N) of `resample`, in NumPy whatever its size."""
    spectrum = np.fft.rfft(np.eye(N), axis=0)
    if K < N:
        spectrum = spectrum[: K // 2]  # drops modes that would alias, and the Nyquist mode of the coarser grid
    elif K > N:
        spectrum[-1] *= 0.5  # on the finer grid the Nyquist mode is shared between k = ±N/2
    return np.fft.irfft(spectrum, K, axis=0) * (K / N)


def resampled(f: np.ndarray, K: int, axis: int) -> np.ndarray:
    """Does the same as `resample` in NumPy, for use outside of compiled programs."""
    N = f.shape[axis]
    if N == K:
        return f
    if N * K <= CONSTANT:
        return np.moveaxis(np.moveaxis(f, axis, -1) @ resampling_matrix(N, K).T, -1, axis)
    spectrum = np.moveaxis(np.fft.rfft(f, axis=axis), axis, -1)
    spectrum = spectrum[..., : K // 2] if K < N else spectrum * np.append(np.ones(N // 2), 0.5)
    return np.moveaxis(np.fft.irfft(spectrum, K, axis=-1) * (K / N), -1, axis)


def resampling(N: int, K: int) -> np.ndarray | Float[Array, "K N"]:
    """Returns the matrix (K, N) of `resample`, in NumPy if it is small."""
    if N * K <= CONSTANT:
        return resampling_matrix(N, K)
    fine = math.lcm(N, K)  # points that include both grids
    spectrum = np.ones(K // 2 if K < N else N // 2 + 1)
    if K > N:
        spectrum[-1] = 0.5
    kernel = np.fft.irfft(spectrum, fine) * (fine / N)
    return picked(
        kernel, lambda arange: (arange(K)[:, None] * (fine // K) - arange(N)[None, :] * (fine // N)) % fine, N * K
    )


def resample(f: Float[Array, "..."], K: int, axis: int = -1) -> Float[Array, "..."]:
    """Returns the trigonometric interpolant of f on K nodes. If K is a multiple of N, values at the old nodes stay."""
    N = f.shape[axis]
    return f if K == N else _along(resampling(N, K), f, axis)


def coefficients(f: Float[Array, "N *rest"]) -> tuple[Float[Array, "k *rest"], Float[Array, "k *rest"]]:
    """Returns a_k and b_k, k = 0 … N/2, of f = Σ a_k cos kα + b_k sin kα; the node axis of f is the first."""
    cosine, sine = _transforms(f.shape[0])
    return jnp.tensordot(cosine, f, 1), jnp.tensordot(sine, f, 1)


def _transforms(N: int) -> tuple[Float[Array, "k N"], Float[Array, "k N"]]:
    """Returns the matrices of `coefficients`."""
    k = wavenumbers(N)
    weight = np.where((k == 0) | (k == N // 2), 1.0, 2.0)[:, None] / N
    entries = len(k) * N
    if entries <= CONSTANT:
        transform = np.fft.rfft(np.eye(N), axis=0)
        return staged(weight * transform.real), staged(-weight * transform.imag)

    def table(values):
        return weight * picked(values, lambda arange: (arange(len(k))[:, None] * arange(N)) % N, entries)

    phase = 2 * np.pi * np.arange(N) / N
    return table(np.cos(phase)), table(np.sin(phase))


def series(modes: tuple[Float[Array, "k *rest"], Float[Array, "k *rest"]], alpha: Float[Array, "P"]):
    """Returns Σ a_k cos kα + b_k sin kα at the parameters `alpha`, (P, *rest); `modes` comes from `coefficients`."""
    phase = alpha[:, None] * np.arange(modes[0].shape[0])
    return jnp.tensordot(jnp.cos(phase), modes[0], 1) + jnp.tensordot(jnp.sin(phase), modes[1], 1)


def evaluate(f: Float[Array, "N *rest"], alpha: Float[Array, "P"]) -> Float[Array, "P *rest"]:
    """Returns the trigonometric interpolant of f at the parameters `alpha`; the node axis is the first."""
    return series(coefficients(f), alpha)


def spectral_tail(f: Float[Array, "N *rest"], cut: int, least: float | None = None) -> Scalar:
    """Returns the relative amplitude of the highest modes: round-off if f is resolved, near 1 if it is not.

    It is the largest amplitude in the highest eighth of the modes that `low_pass(f, cut)` keeps, divided by the
    largest amplitude of all modes except the mean, or by `least` if that is more. The node axis is the first.
    """
    cosine, sine = coefficients(f)
    size = jnp.max(jnp.abs(cosine) + jnp.abs(sine), axis=tuple(range(1, f.ndim)))
    last = f.shape[0] // 2 - cut
    # At least two modes: in a symmetric curve, the even or the odd modes vanish.
    high = jnp.max(size[last - max(last // 8, 2) + 1 : last + 1])
    return high / jnp.maximum(jnp.max(size[1:]), jnp.finfo(size.dtype).tiny if least is None else least)
