r"""The frequencies at which the mean load of an AC field on a round vesicle changes its sign.

With s = iω and the Laplace transforms K_i = Λ + sχδε, K_e = 1 + sχδ of the conductivities, and Y = G + sχ of the
membrane, a circle has the normal fields c inside and 1 - b outside, over E_∞ cos θ:

    d = K_i K_e + Y (K_i + K_e),      c = 2 Y K_e/d,      b = (K_i K_e + Y (K_e - K_i))/d

The mean load that elongates a vesicle along the field is P = (β/16χ) (3 + |b|² - 3ε|c|²). Its numerator is a quadratic
polynomial of ω². Without charge relaxation and conductance there is one zero, (Λ/χ)/√(3ε - 1 - Λ - Λ²). A nearly round
vesicle is prolate below the first zero, oblate between both, and prolate again beyond the second.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float, ScalarLike


def critical_frequencies(
    conductivity_ratio: ScalarLike,
    *,
    chi: ScalarLike,
    membrane_conductance: ScalarLike = 0.0,
    delta: ScalarLike = 0.0,
    permittivity_ratio: ScalarLike = 1.0,
) -> Float[Array, "2"]:
    """Returns ω₁ and ω₂ in 1/t_κ, in ascending order, at which the mean load vanishes; differentiable.

    It is NaN in place of a frequency that does not exist, and infinity where the second moves there, as without charge
    relaxation (δ = 0).
    """
    inside = jnp.array([conductivity_ratio, chi * delta * permittivity_ratio])
    outside = jnp.array([1.0, chi * delta])
    membrane = jnp.array([membrane_conductance, chi])
    both = jnp.convolve(inside, outside)
    d = both + jnp.convolve(membrane, inside + outside)
    b, c = both + jnp.convolve(membrane, outside - inside), jnp.convolve(membrane, outside)
    constant, linear, square = 3 * _squared(d) + _squared(b) - 12 * permittivity_ratio * _squared(c)
    q = -0.5 * (linear + jnp.where(linear < 0, -1.0, 1.0) * jnp.sqrt(linear**2 - 4 * square * constant))
    small = jnp.abs(square) * jnp.abs(constant) < 1e-30 * linear**2  # there is no second zero at a finite frequency
    roots = jnp.stack([constant / q, jnp.where(small, -jnp.sign(linear) * jnp.inf, q / jnp.where(small, 1.0, square))])
    known = roots > 0
    return jnp.sort(jnp.where(known, jnp.sqrt(jnp.where(known, roots, 1.0)), jnp.nan))


def _squared(polynomial: Float[Array, "3"]) -> Float[Array, "3"]:
    """Returns the coefficients of |p(iω)|² in powers of ω², of a polynomial with real coefficients."""
    p0, p1, p2 = polynomial
    return jnp.stack([p0**2, p1**2 - 2 * p0 * p2, p2**2])
