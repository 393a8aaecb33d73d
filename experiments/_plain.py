"""The paper's first-order scheme for one vesicle in a field, in plain NumPy.

`beside_others` compares jaxves with this code. It has dense matrices of Kress's rule, formed again in every step, and
one direct solve for positions and tension together. It uses nothing of jaxves. Symbols, units and signs are those of
the README.

    x₊ = x + h (S[-x₊,ssss + (σ x_s)_s - f_el] + v_∞),     x_s · (S[…])_s = 0
    χ (½ + ηS′)(V₊ - V) + h G (½ + ηS′) V₊ = h Λ/(1+Λ) (E·n + D′V₊)

Geometry, charge and electric force are those at the start of the step.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve


class Numbers(NamedTuple):
    """The numbers β, χ, Λ and G of a field along y."""

    beta: float
    chi: float
    conductivity_ratio: float
    membrane_conductance: float = 0.0


class Grid:
    """Matrices (N, N) that depend only on the number of nodes N."""

    def __init__(self, N: int):
        self.N = N
        k = np.fft.fftfreq(N, 1 / N)
        self.nyquist = np.cos(np.pi * np.arange(N)) / np.sqrt(N)
        self.derivative = self._circulant(np.where(np.abs(k) < N / 2, 1j * k, 0))
        # ∫ log(4 sin²((α-α′)/2)) e^{ikα′} dα′ = -2π/|k| e^{ikα}, and 0 for k = 0.
        self.log = self._circulant(np.where(k == 0, 0, -2 * np.pi / np.maximum(np.abs(k), 1)))
        angle = 2 * np.pi * (np.arange(N)[:, None] - np.arange(N)) / N
        self.chord2 = 4 * np.sin(angle / 2) ** 2 + np.eye(N)

    def _circulant(self, symbol):
        return np.fft.ifft(symbol[:, None] * np.fft.fft(np.eye(self.N), axis=0), axis=0).real


class Membrane:
    """A closed curve with nodes (N, 2), counter-clockwise, equispaced in a parameter, and its layer potentials."""

    def __init__(self, grid: Grid, x):
        self.grid, self.x = grid, x
        tangent = grid.derivative @ x
        self.speed = np.linalg.norm(tangent, axis=1)
        self.weights = 2 * np.pi / grid.N * self.speed
        self.tangent = tangent / self.speed[:, None]
        self.normal = self.tangent[:, ::-1] * [1, -1]
        self.curvature = -np.sum((self.d_ds @ self.tangent) * self.normal, axis=1)
        difference = x[:, None] - x[None]
        eye = np.eye(grid.N)
        distance2 = np.sum(difference**2, axis=-1) + eye
        self.unit = difference / np.sqrt(distance2)[..., None]
        smooth = np.log(distance2 / grid.chord2) + eye * 2 * np.log(self.speed)
        # ∮ log|x-y|² f(y) ds_y, the logarithm by its exact Fourier symbol
        self.log = grid.log * self.speed + smooth * self.weights
        self.gradient = -difference / (2 * np.pi * distance2[..., None])

    @cached_property
    def d_ds(self):
        return self.grid.derivative / self.speed[:, None]

    @cached_property
    def slp(self):
        return -self.log / (4 * np.pi)

    def _with_diagonal(self, kernel):
        return (kernel - np.diag(self.curvature) / (4 * np.pi)) * self.weights

    @cached_property
    def slp_dn(self):
        return self._with_diagonal(np.einsum("ijk,ik->ij", self.gradient, self.normal))

    @cached_property
    def dlp(self):
        return self._with_diagonal(-np.einsum("ijk,jk->ij", self.gradient, self.normal))

    @cached_property
    def dlp_dn(self):
        return self.d_ds @ self.slp @ self.d_ds

    @cached_property
    def stokes(self):
        """Returns the matrix (2N, 2N) from a force to the velocity at the nodes; components one after the other."""
        N = self.grid.N
        blocks = np.einsum("ijk,ijl->kilj", self.unit, self.unit)
        diagonal = np.einsum("ik,il->kil", self.tangent, self.tangent)
        blocks[:, np.arange(N), :, np.arange(N)] = np.moveaxis(diagonal, 1, 0)
        blocks *= self.weights / (4 * np.pi)
        for k in range(2):
            blocks[k, :, k] -= self.log / (8 * np.pi)
        return blocks.reshape(2 * N, 2 * N)

    def electric(self, numbers: Numbers, V_m):
        """Returns the charging matrix ½ + ηS′, and the Maxwell traction (N, 2)."""
        ratio = numbers.conductivity_ratio
        eta = (ratio - 1) / (ratio + 1)
        charging = 0.5 * np.eye(self.grid.N) + eta * self.slp_dn
        q = solve(charging, eta * (self.normal[:, 1] + self.dlp_dn @ V_m))
        potential = -self.x[:, 1] + self.slp @ q - self.dlp @ V_m
        flux = -self.normal[:, 1] + self.slp_dn @ q - self.dlp_dn @ V_m

        def stress(side):
            along = -self.d_ds @ (potential + side * V_m / 2)
            across = -(flux + side * q / 2)
            return (across**2 - along**2)[:, None] / 2 * self.normal + (across * along)[:, None] * self.tangent

        return charging, numbers.beta / numbers.chi * (stress(1) - stress(-1))


def step(grid: Grid, numbers: Numbers, x, V_m, h: float):
    """Makes one step of length h; returns positions (N, 2), V_m (N,) and the velocity (N, 2)."""
    N = grid.N
    membrane = Membrane(grid, x)
    charging, f_el = membrane.electric(numbers, V_m)
    d_ds = membrane.d_ds
    bend = d_ds @ d_ds
    bend = bend @ bend
    spread = np.concatenate([d_ds * membrane.tangent[:, k] for k in range(2)])
    stretch = np.concatenate([membrane.tangent[:, k, None] * d_ds for k in range(2)], axis=1)
    S = membrane.stokes
    bending = np.concatenate([S[:, :N] @ bend, S[:, N:] @ bend], axis=1)
    # Nothing determines the Nyquist mode of σ: it is set to zero.
    system = np.block(
        [[np.eye(2 * N) + h * bending, -S @ spread], [stretch, np.outer(grid.nyquist, grid.nyquist)]],
    )
    known = np.concatenate([-bending @ x.T.ravel() - S @ f_el.T.ravel(), np.zeros(N)])
    velocity = solve(system, known)[: 2 * N].reshape(2, N).T

    share = numbers.conductivity_ratio / (1 + numbers.conductivity_ratio)
    left = (numbers.chi + h * numbers.membrane_conductance) * charging - h * share * membrane.dlp_dn
    V_m = solve(left, numbers.chi * charging @ V_m + h * share * membrane.normal[:, 1])
    return x + h * velocity, V_m, velocity
