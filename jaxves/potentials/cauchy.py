r"""Cauchy integrals of densities on a closed curve at any distance from it, and holomorphic continuation.

    C[τ](z) = (1/2πi) ∮ τ(y) dy/(y-z)           counter-clockwise; C[1] = 1 inside, 0 outside
    C[τ]'   = C[dτ/dy]                          so that no kernel has to be differentiated

Let z_k = Z(2πk/K) be the nodes, h = 2π/K, c_k = h z'_k/(z_k - z) and W = Σ c_k. Let v be a function that is holomorphic
inside the curve, or outside and zero at infinity. Its boundary values v_k give its value at z by the compensated
trapezoidal rule [I, H]:

    v(z) = Σ b_k v_k,    b_k = c_k / (W - 2πi [z outside])

The boundary values of v = C[τ] are sums over the nodes as well, after their singular integral is compensated [H].
Exchanging the two sums and splitting c_j c_k into partial fractions gives a single sum, with the same accuracy and
cost:

    C[τ](z) = (1/2πi) Σ { c_k (1 - b_k) τ_k + h b_k (τ z')'_k / z'_k }

The code multiplies this by the distance δ to the nearest node, so that nothing is divided by δ. Values and all
derivatives are then accurate up to the node itself, where v is the one-sided limit. [B] uses this for layer potentials.

[I] N. I. Ioakimidis, K. E. Papadakis, E. A. Perdios, Numerical evaluation of analytic functions by Cauchy's
    theorem, BIT 31 (1991) 276-285.
[H] J. Helsing, R. Ojala, On the evaluation of layer potentials close to their sources, J. Comput. Phys. 227 (2008).
[B] A. H. Barnett, B. Wu, S. Veerapaneni, Spectrally accurate quadratures for evaluation of layer potentials close
    to the boundary for the 2D Stokes and Laplace equations, SIAM J. Sci. Comput. 37 (2015) B519-B542.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float, Int

from ..numerics import fourier
from ..numerics.arrays import NodePoints, Points


def complex_of(x: Float[Array, "*batch 2"]) -> Complex[Array, "*batch"]:
    """Converts points to complex numbers."""
    return jax.lax.complex(x[..., 0], x[..., 1])


def real_of(z: Complex[Array, "*batch"]) -> Float[Array, "*batch 2"]:
    """Converts complex numbers to points."""
    return jnp.stack([z.real, z.imag], axis=-1)


def derivative(f: Complex[Array, "..."], axis: int = 0) -> Complex[Array, "..."]:
    """Returns df/dα of a complex function on the grid."""
    return jax.lax.complex(fourier.derivative(f.real, axis=axis), fourier.derivative(f.imag, axis=axis))


def _argmin(rows: Float[Array, "P K"]) -> Int[Array, "P"]:
    """Returns the index of the first minimum of each row.

    On a CPU it is four times as fast as `jnp.argmin`, which is not vectorised there.
    """
    K = rows.shape[1]
    return jnp.min(jnp.where(rows == jnp.min(rows, axis=1, keepdims=True), np.arange(K), K - 1), axis=1)


class CauchyRule(eqx.Module):
    """The rules C[τ] = direct τ + (h/2πi) barycentric τ_α and v(z) = barycentric v, from K nodes to P targets.

    `inside` says which targets are enclosed by the curve. Build it with `CauchyRule.of`.
    """

    direct: Complex[Array, "P K"]
    barycentric: Complex[Array, "P K"]
    inside: Bool[Array, "P"]
    dz: Complex[Array, "K"]

    @classmethod
    def of(cls, x: NodePoints, targets: Points, *, inside: Bool[Array, "P"] | bool | None = None) -> "CauchyRule":
        """Builds the rule for the trigonometric interpolant of the counter-clockwise nodes `x`.

        `inside` says on which side the targets are, one value for all or one for each. If it is None, the winding
        number decides, and a target on a node counts as outside. The decision is as accurate as the rule itself: W =
        2πi/(1 - e^{iKα}) for Z(α) = z, up to the error of the rule.
        """
        z, t = complex_of(x), complex_of(targets)
        K = z.shape[0]
        h = 2 * np.pi / K
        dz = derivative(z)
        stretch = derivative(dz) / dz
        r2 = (x[:, 0] - targets[:, 0, None]) ** 2 + (x[:, 1] - targets[:, 1, None]) ** 2
        index = _argmin(jax.lax.stop_gradient(r2))
        nearest = np.arange(K) == index[:, None]
        # The nearest node enters only through δ. Replacing its distance by 1 keeps the quotient and its gradient
        # finite.
        inverse_r2 = 1 / jnp.where(nearest, 1.0, r2)
        others = jnp.where(nearest, 0.0, (h * dz) * jnp.conj(z - t[:, None]) * inverse_r2)
        delta, weight = z[index] - t, h * dz[index]
        rest = jnp.sum(others, axis=1)
        if inside is None:
            # Re W/2πi > ½, multiplied by |δ|²
            inside = ((weight + delta * rest) * jnp.conj(delta)).imag > np.pi * (delta * jnp.conj(delta)).real
        inside = jnp.broadcast_to(jnp.asarray(inside), t.shape)
        rest = jnp.where(inside, rest, rest - 2j * np.pi)
        inverse = 1 / (weight + delta * rest)
        barycentric = jnp.where(nearest, (weight * inverse)[:, None], (delta * inverse)[:, None] * others)
        ordinary = jnp.where(nearest, (weight * inverse * rest)[:, None], others * (1 - barycentric))
        direct = (ordinary + barycentric * (h * stretch)) * (-0.5j / np.pi)
        # C[1] is known exactly. Correcting the weight of the nearest node accordingly removes most of the noise of z''.
        missing = jnp.where(inside, 1.0, 0.0) - jnp.sum(direct, axis=1)
        return cls(direct + jnp.where(nearest, missing[:, None], 0.0), barycentric, inside, dz)

    @property
    def _slope(self) -> complex:
        return -1j / self.dz.shape[0]  # h/2πi

    def __call__(
        self, density: Complex[Array, "K *rest"], d_dalpha: Complex[Array, "K *rest"] | None = None
    ) -> Complex[Array, "P *rest"]:
        """Returns C[τ]. `d_dalpha` is τ_α, if it is known more accurately than by differentiating τ."""
        if d_dalpha is None:
            d_dalpha = derivative(density)
        return self.direct @ density + self.barycentric @ (self._slope * d_dalpha)

    def matrix(self) -> Complex[Array, "P K"]:
        """Returns the matrix of C. Differentiation is antisymmetric, so it acts on the rows with the opposite sign."""
        return self.direct - self._slope * derivative(self.barycentric, axis=1)

    def d_dz(self, density: Complex[Array, "K *rest"]) -> Complex[Array, "K *rest"]:
        """Returns dτ/dy along the curve. Then C[τ]' = C[dτ/dy], and dv/dy are the boundary values of v'."""
        return derivative(density) / self.dz.reshape((-1,) + (1,) * (density.ndim - 1))

    def continued(self, v: Complex[Array, "K *rest"]) -> Complex[Array, "P *rest"]:
        """Returns the holomorphic function with boundary values v, on each target's side; outside it decays."""
        return self.barycentric @ v
