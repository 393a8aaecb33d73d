r"""Laplace layer potentials of one curve at targets anywhere, as near to the curve as one likes.

    S[q] = ∮ G(x-y) q ds,    D[V] = ∮ ∂G(x-y)/∂n_y V ds,    G(r) = -log|r|/2π,    D[1] = -1 inside, 0 outside

With complex z for x and ν for n, ds = dy/iν, both are real parts of Cauchy integrals C (`cauchy`):

    D[V]   = -Re C[V]                                           ∇D[V] ↔ -C[dV/dy]
    S[q]   =  Re C[τ] - (Q/2π) log|z - a| [z outside]           ∇S[q] ↔  C[q ν̄]
    τ      =  i ∫ (q ds - (Q/2π) dα) - (Q/2π) ℓ,    ℓ = log(y - a) - iα,    Q = ∮ q ds

where ∇u ↔ v' means u_x - i u_y = v'. τ is the density of S after one integration by parts; ℓ, the log of a
charge at a, makes it periodic, and a is any point inside: the centre of the largest inscribed circle, where ℓ
is smoothest. The Stokes potentials in `near_stokes` are built from the same integrals.

What all of them share is `CloseGeometry`, formed once per (curve, targets). The curve, q|x_α| and V are first
interpolated to `upsample` times the nodes, since products such as τ z' have twice the bandwidth of their factors:
what N nodes resolve, 2 treats without further error. Matrices act on densities at the N nodes and include the
weights. Everything is differentiable, forward and reverse, in nodes, densities and targets down to distance
zero. Memory is 32 bytes per (fine node, target).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Complex, Float

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import Nodes, Points
from .cauchy import CauchyRule, complex_of, real_of

TargetMatrix = Float[Array, "P N"]


def _inner_point(curve: Curve) -> Float[Array, "2"]:
    """Centre of the largest circle inside that touches the curve at one of a few dozen nodes."""
    some = slice(None, None, max(1, curve.x.shape[0] // 48))
    x, normal = curve.x[some], curve.normal[some]
    rx, ry = x[:, 0, None] - curve.x[:, 0], x[:, 1, None] - curve.x[:, 1]
    depth = rx * normal[:, 0, None] + ry * normal[:, 1, None]
    met = depth > 0  # by a growing circle
    radius = jnp.min(jnp.where(met, (rx**2 + ry**2) / (2 * jnp.where(met, depth, 1.0)), jnp.inf), axis=1)
    j = jnp.argmax(radius)
    return x[j] - radius[j] * normal[j]


class CloseGeometry(eqx.Module):
    """What all potentials of one curve at one set of targets share; build with `CloseGeometry.of`.

    Fine nodes `z` and targets `target` are complex, about an origin within the curve.
    """

    rule: CauchyRule
    z: Complex[Array, "K"]
    target: Complex[Array, "P"]
    inner: Complex[Array, ""]
    speed: Nodes

    @classmethod
    def of(
        cls, curve: Curve, targets: Points, *, inside: Bool[Array, "P"] | bool | None = None, upsample: int = 2
    ) -> "CloseGeometry":
        """From N nodes to P targets; `inside` as for `CauchyRule.of`, where None lets the geometry decide."""
        origin = jax.lax.stop_gradient(jnp.mean(curve.x, axis=0))
        x, targets = fourier.resample(curve.x - origin, upsample * curve.x.shape[0], axis=0), targets - origin
        # S does not depend on the inner point, so neither does its derivative.
        inner = _inner_point(jax.lax.stop_gradient(curve)) - origin
        rule = CauchyRule.of(x, targets, inside=inside)
        return cls(rule, complex_of(x), complex_of(targets), complex_of(inner), curve.speed)

    @property
    def dz(self) -> Complex[Array, "K"]:
        """dz/dα at the fine nodes."""
        return self.rule.dz

    @property
    def inside(self) -> Bool[Array, "P"]:
        """Which targets the curve encloses."""
        return self.rule.inside

    def finer(self, density: Float[Array, "N *rest"]) -> Float[Array, "K *rest"]:
        """A density at the fine nodes."""
        return fourier.resample(density, self.dz.shape[0], axis=0)

    def flux(self, density: Float[Array, "N *rest"]) -> Float[Array, "K *rest"]:
        """|x_α| times a density at the fine nodes."""
        return self.finer(density * self.speed.reshape((-1,) + (1,) * (density.ndim - 1)))

    def coarser(self, matrix: Float[Array, "P K"]) -> TargetMatrix:
        """`matrix` after `finer`."""
        N, K = self.speed.shape[0], self.dz.shape[0]
        return matrix if N == K else matrix @ fourier.resampling_matrix(N, K)

    def on_flux(self, matrix: Float[Array, "P K"]) -> TargetMatrix:
        """`matrix` after `flux`."""
        return self.coarser(matrix) * self.speed

    def charge_log(self) -> Complex[Array, "K"]:
        """ℓ, up to an imaginary constant, which no potential sees."""
        angle = fourier.antiderivative(self.charge_log_slope().imag)
        return jax.lax.complex(jnp.log(jnp.abs(self.z - self.inner)), angle)

    def charge_log_slope(self) -> Complex[Array, "K"]:
        """ℓ_α + i: beside it, the flux in τ_α keeps its mean."""
        return self.dz / (self.z - self.inner)

    def outer_log(self) -> Float[Array, "P"]:
        """log|z - a| at the targets outside, 0 inside."""
        return jnp.log(jnp.abs(jnp.where(self.inside, 1.0, self.target - self.inner)))


def laplace_slp(close: CloseGeometry, q: Nodes) -> Float[Array, "P"]:
    """S[q]."""
    return slp_of_flux(close, close.flux(q))


def slp_of_flux(close: CloseGeometry, flux: Float[Array, "K"]) -> Float[Array, "P"]:
    """S of q given as q|x_α| at the fine nodes."""
    charge = jnp.mean(flux)  # Q/2π
    tau = 1j * fourier.antiderivative(flux) - charge * close.charge_log()
    d_tau = 1j * flux - charge * close.charge_log_slope()
    return close.rule(tau, d_tau).real - charge * close.outer_log()


def laplace_slp_matrix(close: CloseGeometry) -> TargetMatrix:
    """The matrix of S."""
    return close.on_flux(slp_flux_matrix(close))


def slp_flux_matrix(close: CloseGeometry) -> Float[Array, "P K"]:
    """The matrix of `slp_of_flux`; integration, being antisymmetric, acts on rows with the other sign."""
    rule, K = close.rule, close.z.shape[0]
    charge_part = rule(close.charge_log(), close.charge_log_slope()).real + close.outer_log()
    return fourier.antiderivative(rule.direct.imag) + (rule.barycentric.real - charge_part[:, None]) / K


def laplace_slp_gradient(close: CloseGeometry, q: Nodes) -> Points:
    """∇S[q]."""
    return real_of(jnp.conj(close.rule(1j * close.flux(q) / close.dz)))


def laplace_slp_gradient_matrix(close: CloseGeometry) -> Float[Array, "2 P N"]:
    """The matrices of ∂_x S and ∂_y S."""
    matrix = close.rule.matrix() * (1j / close.dz)
    return jnp.stack([close.on_flux(matrix.real), close.on_flux(-matrix.imag)])


def laplace_dlp(close: CloseGeometry, V: Nodes) -> Float[Array, "P"]:
    """D[V]."""
    return -close.rule(close.finer(V) + 0j).real


def laplace_dlp_matrix(close: CloseGeometry) -> TargetMatrix:
    """The matrix of D."""
    return close.coarser(-close.rule.matrix().real)


def laplace_dlp_gradient(close: CloseGeometry, V: Nodes) -> Points:
    """∇D[V]."""
    return -real_of(jnp.conj(close.rule(close.rule.d_dz(close.finer(V) + 0j))))


def laplace_dlp_gradient_matrix(close: CloseGeometry) -> Float[Array, "2 P N"]:
    """The matrices of ∂_x D and ∂_y D."""
    matrix = close.rule.matrix() / close.dz
    rows = [fourier.derivative(matrix.real, axis=1), fourier.derivative(-matrix.imag, axis=1)]
    return jnp.stack([close.coarser(row) for row in rows])
