r"""Stokes layer potentials of one curve at targets at any distance from it (close evaluation, viscosity 1).

    S[f]_a = ∮ (-log|r| δ_ab + r_a r_b/|r|²) f_b ds / 4π          D[u]_a = ∮ r_a r_b (r·n) u_b ds / π|r|⁴
    p[f]   = ∮ r·f ds / 2π|r|²                                    T[f]_ab = -∮ r_a r_b (r·f) ds / π|r|⁴

r = x - y, D[1] = -1 inside. With complex f = f_1 + i f_2, g = f ν̄, C from `cauchy`, S and D from `close_laplace`:

    S[f]                 = ½ S_Laplace[f] + ∮ f ds/8π + ¼ conj C[(ȳ - z̄) g]
    D[u]                 = D_Laplace[u] + ½ conj C[(z̄ - ȳ) du/dy]
    p[f]                 = -Re C[g],               p[u] = 2 Re C[du/dy], the pressure of D[u]
    ½(T_11 - T_22) + i T_12 = ½ conj C[f̄ ν̄ - f ν̄³ - (z̄ - ȳ) dg/dy],        T_11 + T_22 = -2p

They follow from r r·f = ½ (|r|² f + r² f̄) and ∮ f ds/(y - z) = 2π C[f ν̄]. These are the combinations of Laplace
potentials in [B], except that ȳ - z̄ is not split.

[B] A. H. Barnett, B. Wu, S. Veerapaneni, SIAM J. Sci. Comput. 37 (2015) B519-B542.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from ..numerics.arrays import NodePoints, Points
from .cauchy import complex_of, derivative, real_of
from .close_laplace import CloseGeometry, slp_flux_matrix, slp_of_flux
from .self_stokes import StokesBlocks


def _g(close: CloseGeometry, flux: Float[Array, "K 2"]) -> Complex[Array, "K"]:
    """Returns the density g = f ν̄ = i f|x_α| / z'."""
    return 1j * complex_of(flux) / close.dz


def _against_distance(close: CloseGeometry, g: Complex[Array, "K"]) -> Complex[Array, "P"]:
    """Returns C[(ȳ - z̄) g]."""
    values = close.rule(jnp.stack([jnp.conj(close.z) * g, g], axis=-1))
    return values[:, 0] - jnp.conj(close.target) * values[:, 1]


def stokes_slp(close: CloseGeometry, f: NodePoints) -> Points:
    """Returns the velocity S[f] at the targets."""
    flux = close.flux(f)
    equal = 0.5 * jax.vmap(slp_of_flux, in_axes=(None, 1), out_axes=1)(close, flux) + 0.25 * jnp.mean(flux, axis=0)
    return equal + 0.25 * real_of(jnp.conj(_against_distance(close, _g(close, flux))))


def stokes_slp_matrix(close: CloseGeometry) -> StokesBlocks:
    """Returns the blocks of the matrix of S."""
    distance = jnp.conj(close.z - close.target[:, None])
    cross = close.rule.matrix() * (distance * (0.25j / close.dz))
    equal = 0.5 * slp_flux_matrix(close) + 0.25 / close.z.shape[0]
    blocks = equal + cross.real, -cross.imag, equal - cross.real
    return StokesBlocks(*(close.on_flux(block) for block in blocks))


def stokes_slp_pressure(close: CloseGeometry, f: NodePoints) -> Float[Array, "P"]:
    """Returns the pressure of S[f] at the targets."""
    return -close.rule(_g(close, close.flux(f))).real


def stokes_slp_stress(close: CloseGeometry, f: NodePoints) -> Float[Array, "P 2 2"]:
    """Returns the stress T = -p δ + ∇u + ∇uᵀ of S[f] at the targets. The traction is T·n."""
    flux = close.flux(f)
    g = _g(close, flux)
    # ν̄² = -conj(z')/z'
    local = close.rule(1j * jnp.conj(complex_of(flux)) / close.dz + g * jnp.conj(close.dz) / close.dz)
    shear = 0.5 * (local + _against_distance(close, close.rule.d_dz(g)))
    pressure = -close.rule(g).real
    normal, tangential = shear.real, -shear.imag
    rows = [[normal - pressure, tangential], [tangential, -normal - pressure]]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)


def stokes_dlp(close: CloseGeometry, u: NodePoints) -> Points:
    """Returns the velocity D[u] at the targets."""
    u = close.finer(u)
    du = close.rule.d_dz(complex_of(u))
    return -close.rule(u + 0j).real - 0.5 * real_of(jnp.conj(_against_distance(close, du)))


def stokes_dlp_pressure(close: CloseGeometry, u: NodePoints) -> Float[Array, "P"]:
    """Returns the pressure of D[u] at the targets."""
    return 2 * close.rule(close.rule.d_dz(complex_of(close.finer(u)))).real


def stokes_dlp_matrix(close: CloseGeometry) -> StokesBlocks:
    """Returns the blocks of the matrix of D, which act on velocities at the nodes."""
    rule = close.rule
    equal = -rule.matrix().real
    # Differentiation along the curve is antisymmetric, so it acts on rows with the opposite sign.
    cross = -derivative(rule.matrix() * (jnp.conj(close.z - close.target[:, None]) / close.dz), axis=1)
    blocks = equal - 0.5 * cross.real, 0.5 * cross.imag, equal + 0.5 * cross.real
    return StokesBlocks(*(close.coarser(block) for block in blocks))
