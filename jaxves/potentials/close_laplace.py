r"""Laplace layer potentials of one curve at targets at any distance from it (close evaluation).

    S[q] = ∮ G(x-y) q ds,    D[V] = ∮ ∂G(x-y)/∂n_y V ds,    G(r) = -log|r|/2π,    D[1] = -1 inside, 0 outside

S is the single layer and D the double layer; n points outward.

With complex z for x and ν for n, ds = dy/iν, both are real parts of Cauchy integrals C (see `cauchy`):

    D[V]   = -Re C[V]                                           ∇D[V] ↔ -C[dV/dy]
    S[q]   =  Re C[τ] - (Q/2π) log|z - a| [z outside]           ∇S[q] ↔  C[q ν̄]
    τ      =  i ∫ (q ds - (Q/2π) dα) - (Q/2π) ℓ,    ℓ = log(y - a) - iα,    Q = ∮ q ds

where ∇u ↔ v' means u_x - i u_y = v'. τ is the density of S after one integration by parts. ℓ is the potential of a
point charge at a; subtracting it makes τ periodic. a can be any point inside. The centre of the largest inscribed
circle is used, because ℓ is smoothest there. The Stokes potentials in `close_stokes` use the same integrals.

`CloseGeometry` has the quantities that all potentials share for one curve and one set of targets. The curve, q|x_α| and
V are first interpolated to `upsample` times the nodes, because products such as τ z' have twice the bandwidth of their
factors. With the default of 2 this adds no error. Matrices act on densities at the N nodes and include the weights.
Everything is differentiable in nodes, densities and targets, forward and reverse, also at distance zero. Memory is 32
bytes per pair of fine node and target.
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
    """Returns the centre of the largest inscribed circle that touches the curve at one of a few dozen nodes."""
    some = slice(None, None, max(1, curve.x.shape[0] // 48))
    x, normal = curve.x[some], curve.normal[some]
    rx, ry = x[:, 0, None] - curve.x[:, 0], x[:, 1, None] - curve.x[:, 1]
    depth = rx * normal[:, 0, None] + ry * normal[:, 1, None]
    met = depth > 0  # a growing circle can touch this node
    radius = jnp.min(jnp.where(met, (rx**2 + ry**2) / (2 * jnp.where(met, depth, 1.0)), jnp.inf), axis=1)
    j = jnp.argmax(radius)
    return x[j] - radius[j] * normal[j]


class CloseGeometry(eqx.Module):
    """Quantities that all potentials of one curve at one set of targets share; build it with `CloseGeometry.of`.

    The fine nodes `z` and targets `target` are complex numbers, relative to the mean of the nodes.
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
        """Builds the geometry from N nodes to P targets. With `inside` None, the winding number decides the side."""
        origin = jax.lax.stop_gradient(jnp.mean(curve.x, axis=0))
        x, targets = fourier.resample(curve.x - origin, upsample * curve.x.shape[0], axis=0), targets - origin
        # S does not depend on the inner point, so neither does its derivative.
        inner = _inner_point(jax.lax.stop_gradient(curve)) - origin
        rule = CauchyRule.of(x, targets, inside=inside)
        return cls(rule, complex_of(x), complex_of(targets), complex_of(inner), curve.speed)

    @property
    def dz(self) -> Complex[Array, "K"]:
        """Returns dz/dα at the fine nodes."""
        return self.rule.dz

    @property
    def inside(self) -> Bool[Array, "P"]:
        """Returns which targets the curve encloses."""
        return self.rule.inside

    def finer(self, density: Float[Array, "N *rest"]) -> Float[Array, "K *rest"]:
        """Interpolates a density to the fine nodes."""
        return fourier.resample(density, self.dz.shape[0], axis=0)

    def flux(self, density: Float[Array, "N *rest"]) -> Float[Array, "K *rest"]:
        """Returns |x_α| times a density, interpolated to the fine nodes."""
        return self.finer(density * self.speed.reshape((-1,) + (1,) * (density.ndim - 1)))

    def coarser(self, matrix: Float[Array, "P K"]) -> TargetMatrix:
        """Returns the matrix that applies `finer` first and then `matrix`."""
        N, K = self.speed.shape[0], self.dz.shape[0]
        return matrix if N == K else matrix @ fourier.resampling(N, K)

    def on_flux(self, matrix: Float[Array, "P K"]) -> TargetMatrix:
        """Returns the matrix that applies `flux` first and then `matrix`."""
        return self.coarser(matrix) * self.speed

    def charge_log(self) -> Complex[Array, "K"]:
        """Returns ℓ at the fine nodes, up to an imaginary constant that does not change any potential."""
        angle = fourier.antiderivative(self.charge_log_slope().imag)
        return jax.lax.complex(jnp.log(jnp.abs(self.z - self.inner)), angle)

    def charge_log_slope(self) -> Complex[Array, "K"]:
        """Returns ℓ_α + i at the fine nodes; with the i, the flux in τ_α keeps its mean."""
        return self.dz / (self.z - self.inner)

    def outer_log(self) -> Float[Array, "P"]:
        """Returns log|z - a| at targets outside the curve, and 0 inside."""
        return jnp.log(jnp.abs(jnp.where(self.inside, 1.0, self.target - self.inner)))


def laplace_slp(close: CloseGeometry, q: Nodes) -> Float[Array, "P"]:
    """Returns S[q] at the targets."""
    return slp_of_flux(close, close.flux(q))


def slp_of_flux(close: CloseGeometry, flux: Float[Array, "K"]) -> Float[Array, "P"]:
    """Returns S[q] from q|x_α| at the fine nodes."""
    charge = jnp.mean(flux)  # Q/2π
    tau = 1j * fourier.antiderivative(flux) - charge * close.charge_log()
    d_tau = 1j * flux - charge * close.charge_log_slope()
    return close.rule(tau, d_tau).real - charge * close.outer_log()


def laplace_slp_matrix(close: CloseGeometry) -> TargetMatrix:
    """Returns the matrix of S."""
    return close.on_flux(slp_flux_matrix(close))


def slp_flux_matrix(close: CloseGeometry) -> Float[Array, "P K"]:
    """Returns the matrix of `slp_of_flux`. Integration is antisymmetric, so it acts on rows with the opposite sign."""
    rule, K = close.rule, close.z.shape[0]
    charge_part = rule(close.charge_log(), close.charge_log_slope()).real + close.outer_log()
    return fourier.antiderivative(rule.direct.imag) + (rule.barycentric.real - charge_part[:, None]) / K


def laplace_slp_gradient(close: CloseGeometry, q: Nodes) -> Points:
    """Returns ∇S[q] at the targets."""
    return real_of(jnp.conj(close.rule(1j * close.flux(q) / close.dz)))


def laplace_slp_gradient_matrix(close: CloseGeometry) -> Float[Array, "2 P N"]:
    """Returns the matrices of ∂_x S and ∂_y S."""
    matrix = close.rule.matrix() * (1j / close.dz)
    return jnp.stack([close.on_flux(matrix.real), close.on_flux(-matrix.imag)])


def laplace_dlp(close: CloseGeometry, V: Nodes) -> Float[Array, "P"]:
    """Returns D[V] at the targets."""
    return -close.rule(close.finer(V) + 0j).real


def laplace_dlp_matrix(close: CloseGeometry) -> TargetMatrix:
    """Returns the matrix of D."""
    return close.coarser(-close.rule.matrix().real)


def laplace_dlp_gradient(close: CloseGeometry, V: Nodes) -> Points:
    """Returns ∇D[V] at the targets."""
    return -real_of(jnp.conj(close.rule(close.rule.d_dz(close.finer(V) + 0j))))


def laplace_dlp_gradient_matrix(close: CloseGeometry) -> Float[Array, "2 P N"]:
    """Returns the matrices of ∂_x D and ∂_y D."""
    matrix = close.rule.matrix() / close.dz
    rows = [fourier.derivative(matrix.real, axis=1), fourier.derivative(-matrix.imag, axis=1)]
    return jnp.stack([close.coarser(row) for row in rows])
