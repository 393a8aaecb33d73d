r"""The smooth kernels between grid points, as multipliers of discrete Fourier transforms.

In a periodic cell with the lattice vectors B = [a₁ a₂], the modes are k = 2π B⁻ᵀ m, and the kernels are known in
Fourier space (`splitting`). The term k = 0 is left out: the kernels of Stokes and G have zero mean over the cell.

In the plane, the kernels are known in space. They are sampled on a grid of 4n × 4n points with spacing 1, times a
smooth cut-off from 1 at √2 n to 0 at 2n. There, the window is divided out. The middle 2n × 2n points give the sum over
a grid of n × n points exactly, by a transform of twice its size. The grid is scaled to the nodes at run time:

    Stokes(h ξ) = Stokes(ξ) - log h/4π,      ∇G(h ξ) = ∇G(ξ)/h

Components are Stokes xx, xy, yy and ∂_x G, ∂_y G, and G.
"""

import functools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..numerics.arrays import Scalar, staged
from . import splitting
from .mesh import window_transform
from .plans import Accuracy, Plan

_KEPT = 1.2  # modes that are kept, over those in which the smooth kernels are not zero


class Multipliers(eqx.Module):
    """Multipliers of `rfft2`: `stokes` is real, `gradient` imaginary and given without i; `potential` is real."""

    stokes: Float[Array, "3 K L"]
    gradient: Float[Array, "2 K L"]
    potential: Float[Array, "K L"]
    size: tuple[int, int] = eqx.field(static=True)

    def on_forces(self, grid: Float[Array, "2 n1 n2"]) -> Float[Array, "2 n1 n2"]:
        """Returns the smooth velocity on the grid from forces on it."""
        fx, fy = self._forth(grid)
        xx, xy, yy = self.stokes
        return self._back(jnp.stack([xx * fx + xy * fy, xy * fx + yy * fy]), grid.shape)

    def on_charges(self, grid: Float[Array, "1 n1 n2"]) -> Float[Array, "2 n1 n2"]:
        """Returns the smooth ∇S on the grid from charges on it."""
        return self._back(1j * self.gradient * self._forth(grid), grid.shape)

    def pressure(self, grid: Float[Array, "2 n1 n2"]) -> Float[Array, "1 n1 n2"]:
        """Returns the smooth pressure -∇G·f on the grid from forces on it."""
        return self._back(-1j * jnp.sum(self.gradient * self._forth(grid), axis=0, keepdims=True), grid.shape)

    def potentials(self, grid: Float[Array, "1 n1 n2"]) -> Float[Array, "1 n1 n2"]:
        """Returns the smooth S on the grid from charges on it."""
        return self._back(self.potential * self._forth(grid), grid.shape)

    def on_stresslets(self, kernel: Float[Array, "2 3 K L"], grid: Float[Array, "3 n1 n2"]) -> Float[Array, "2 n1 n2"]:
        """Returns the smooth velocity of a double layer on the grid, with its multipliers `kernel`."""
        return self._back(1j * jnp.sum(kernel * self._forth(grid), axis=1), grid.shape)

    def _forth(self, grid) -> Complex[Array, "k K L"]:
        return jnp.fft.rfft2(grid, s=self.size)

    def _back(self, modes, shape):
        return jnp.fft.irfft2(modes, s=self.size)[:, : shape[1], : shape[2]]


def periodic(plan: Plan, lattice: Float[Array, "2 2"], r_c: Scalar) -> Multipliers:
    """Returns the multipliers of a cell. `lattice` has the vectors as rows, and r_c is that of `cut_off`."""
    (n1, n2), accuracy = plan.grid, plan.accuracy
    kx, ky, area = _modes(plan, lattice)
    k2 = kx**2 + ky**2
    safe = k2.at[0, 0].set(1.0)
    gamma, stokes = splitting.blob_transforms(k2 * r_c**2, accuracy)
    window = window_transform(n1, accuracy.width)[:, None] * window_transform(n2, accuracy.width)[: n2 // 2 + 1]
    scale = (n1 * n2 / area) / window**2
    gamma, stokes = gamma * scale / safe, stokes * scale / safe**2
    mean = -splitting.local_mean(r_c, accuracy) * scale[0, 0]
    return Multipliers(
        jnp.stack([ky**2 * stokes, -kx * ky * stokes, kx**2 * stokes]),
        jnp.stack([kx * gamma, ky * gamma]),
        gamma.at[0, 0].set(mean),
        plan.grid,
    )


def _modes(plan: Plan, lattice: Float[Array, "2 2"]):
    """Returns both components of k, and the area of the cell."""
    n1, n2 = plan.grid
    m1, m2 = np.fft.fftfreq(n1, 1 / n1)[:, None], np.arange(n2 // 2 + 1.0)
    (ax, ay), (bx, by) = lattice
    area = ax * by - ay * bx
    return (2 * np.pi / area) * (by * m1 - ay * m2), (2 * np.pi / area) * (ax * m2 - bx * m1), area


def free(plan: Plan) -> Multipliers:
    """Returns the multipliers of the plane, for a grid with spacing 1."""
    n, _ = plan.grid
    return Multipliers(*(staged(part) for part in _sampled(n, plan.accuracy)), (2 * n, 2 * n))


def stresslets_in_cell(base: Multipliers, plan: Plan, lattice: Float[Array, "2 2"]) -> Float[Array, "2 3 K L"]:
    """Returns the multipliers of the double layer in a cell from those of G and S, without i.

    They are from n_x u_x, n_x u_y + n_y u_x and n_y u_y to both components of the velocity. The mode k = 0 is left out.
    """
    kx, ky, _ = _modes(plan, lattice)
    (gx, gy), (xx, xy, yy) = base.gradient, base.stokes
    rows = [
        [-gx - 2 * kx * xx, -kx * xy - ky * xx, -gx - 2 * ky * xy],
        [-gy - 2 * kx * xy, -kx * yy - ky * xy, -gy - 2 * ky * yy],
    ]
    return jnp.stack([jnp.stack(row) for row in rows])


def stresslets_free(plan: Plan) -> Float[Array, "2 3 K L"]:
    """Returns the same multipliers of the plane, for a grid with spacing 1."""
    n, _ = plan.grid
    return staged(_sampled_stresslets(n, plan.accuracy))


def _places(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns x, y and r² at the samples, and the smooth cut-off."""
    from scipy.special import erfc  # every run imports this file, and few need sums in the plane

    place = np.fft.fftfreq(4 * n, 1 / (4 * n))
    x, y = place[:, None], place[None, : 2 * n + 1]  # only half of the grid: all kernels are even or odd in y
    r2 = x**2 + y**2
    middle, steepness = 0.5 * (np.sqrt(2) + 2) * n, 10 / ((2 - np.sqrt(2)) * n)
    return x, y, r2, 0.5 * erfc(steepness * (np.sqrt(r2) - middle))


@functools.lru_cache(maxsize=4)
def _sampled(n: int, accuracy: Accuracy) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x, y, r2, cut = _places(n)
    A, B = splitting.smooth_on_host(r2, 2 * accuracy.shape / np.pi, accuracy)
    A, B = A * cut, B * cut
    xx = _multiplier(A + B * x**2, n, accuracy, 1, 1)
    xy = _multiplier(B * x * y, n, accuracy, -1, -1)
    gx = _multiplier(-2 * B * x, n, accuracy, -1, 1)
    potential = _multiplier(2 * (A + B * r2) - cut / (2 * np.pi), n, accuracy, 1, 1)
    # xx and gx are even in k_y; yy and gy are the same with the axes exchanged
    yy, gy = (_exchanged(part, 1) for part in (xx, gx))
    return np.stack([xx, xy, yy]), np.stack([gx, gy]), potential


@functools.lru_cache(maxsize=4)
def _sampled_stresslets(n: int, accuracy: Accuracy) -> np.ndarray:
    x, y, r2, cut = _places(n)
    C, Q = (part * cut for part in splitting.smooth_stresslet(r2, 2 * accuracy.shape / np.pi, accuracy))
    xxx = _multiplier(x * (2 * C + Q * x**2), n, accuracy, -1, 1)
    xxy = _multiplier(y * (C + Q * x**2), n, accuracy, 1, -1)
    xyy = _multiplier(Q * x * y**2, n, accuracy, -1, 1)
    rows = [[xxx, xxy, xyy], [_exchanged(xyy, 1), _exchanged(xxy, -1), _exchanged(xxx, 1)]]
    return np.stack([np.stack(row) for row in rows])


def _exchanged(part: np.ndarray, in_y: int) -> np.ndarray:
    """Returns a multiplier (2n, n + 1) that is even (1) or odd (-1) in k_y with the axes exchanged."""
    return np.concatenate([part, in_y * part[:, -2:0:-1]], axis=1).T[:, : part.shape[1]]


def _multiplier(half: np.ndarray, n: int, accuracy: Accuracy, in_x: int, in_y: int) -> np.ndarray:
    """Returns the multiplier (2n, n + 1) from samples (4n, 2n + 1) of a kernel that is even (1) or odd (-1) in x and y.

    The multiplier of an odd kernel is imaginary and returned without i.
    """
    from scipy import fft

    kernel = np.concatenate([half, in_y * half[:, -2:0:-1]], axis=1)
    if in_x < 0:
        kernel[2 * n] = 0
    if in_y < 0:
        kernel[:, 2 * n] = 0
    window = window_transform(4 * n, accuracy.width)
    frequency = np.abs(np.fft.fftfreq(4 * n))
    keep = np.where(frequency <= 0.25 * _KEPT, 1 / window**2, 0.0)
    modes = fft.rfft2(kernel) * keep[:, None] * keep[: 2 * n + 1]
    space = fft.irfft2(modes, s=(4 * n, 4 * n))
    middle = np.concatenate([space[:n], space[-n:]])
    middle = np.concatenate([middle[:, :n], middle[:, -n:]], axis=1)
    middle[n] = middle[:, n] = 0
    found = fft.rfft2(middle)
    return found.imag if in_x * in_y < 0 else found.real


def cut_off(plan: Plan, lattice: Float[Array, "2 2"]) -> Scalar:
    """Returns r_c for a cell, for which the modes of the smooth kernels fit in half of the grid."""
    lengths = jnp.sqrt(jnp.sum(lattice**2, axis=1))
    return (2 * plan.accuracy.shape / np.pi) * jnp.max(lengths / np.array(plan.grid))
