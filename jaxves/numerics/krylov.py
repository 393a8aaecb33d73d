r"""Restarted GMRES with right preconditioning, in the form that updates the residual in every step (GCR [E]).

    p = M r,  q = A p,  both orthogonalised so that the q are orthonormal;   α = q·r,  x += α p,  r -= α q

The iterates are those of GMRES for A M as long as no α vanishes. No α vanishes if the symmetric part of A M is
definite. The residual is known in every step, so the iteration stops as soon as the tolerance is met. Each cycle ends
by computing b - A x again. The returned residual is therefore the true one, and it is NaN if anything was NaN.

`chebyshev` applies a fixed number of Chebyshev steps [G]. It turns an approximate operator into a preconditioner. It is
linear, so JAX can transpose it.

[E] S. C. Eisenstat, H. C. Elman, M. H. Schultz, Variational iterative methods for nonsymmetric systems of linear
    equations, SIAM J. Numer. Anal. 20 (1983) 345-357.
[G] G. H. Golub, R. S. Varga, Chebyshev semi-iterative methods, Numer. Math. 3 (1961) 147-168.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from .arrays import Scalar

Vector = Float[Array, "n"]
_STEPS = 5
_SPREAD = 0.75  # eigenvalues within this distance of 1 are damped equally; others are damped less, or grow slowly
_PROGRESS = 0.5  # a cycle must reduce the residual by this factor; otherwise further cycles would not help


def relative_residual(r: Vector, b: Vector) -> Scalar:
    """Returns |r|/|b| in the maximum norm, 0 for b = r = 0."""
    size = jnp.max(jnp.abs(b))
    return jnp.max(jnp.abs(r)) / jnp.where(size > 0, size, 1.0)


def gmres(
    mv: Callable[[Vector], Vector],
    precondition: Callable[[Vector], Vector],
    b: Vector,
    *,
    tol: float,
    restart: int,
    max_cycles: int,
) -> tuple[Vector, Scalar, Int[Array, ""]]:
    """Solves A x = b from x = 0; returns x, its true relative residual and the number of iterations."""

    def direction(carry):
        k, x, r, P, Q = carry
        p = precondition(r)
        q = mv(p)
        for _ in range(2):  # after one pass an error of round-off times the condition number remains
            shared = Q @ q
            p, q = p - shared @ P, q - shared @ Q
        size = jnp.sqrt(jnp.sum(q**2))
        p, q = p / size, q / size
        alpha = jnp.sum(q * r)
        return k + 1, x + alpha * p, r - alpha * q, P.at[k].set(p), Q.at[k].set(q)

    def unfinished(carry):
        k, _, r, _, _ = carry
        return (k < restart) & (relative_residual(r, b) > 0.5 * tol)

    def cycle(carry):
        x, r, last, _, cycles, count = carry
        empty = jnp.zeros((restart, b.size))
        k, x, _, _, _ = lax.while_loop(unfinished, direction, (jnp.int32(0), x, r, empty, empty))
        r = b - mv(x)
        return x, r, relative_residual(r, b), last, cycles + 1, count + k

    def unconverged(carry):
        _, _, residual, last, cycles, _ = carry
        return (residual > tol) & (cycles < max_cycles) & (residual < _PROGRESS * last)

    # A NaN in b or A ends the loop and appears in the residual.
    start = jnp.zeros_like(b), b, relative_residual(b, b), jnp.asarray(jnp.inf), jnp.int32(0), jnp.int32(0)
    x, _, residual, _, _, count = lax.while_loop(unconverged, cycle, start)
    return x, residual, count


def chebyshev(sweep: Callable[[Array], Array], x: Array) -> Array:
    """Approaches the fixed point of the affine map `sweep` [G] from x = sweep(0).

    The result is linear in the inhomogeneous part of `sweep`.
    """
    last, omega = jnp.zeros_like(x), 2.0
    for _ in range(_STEPS - 1):
        omega = 1 / (1 - 0.25 * _SPREAD**2 * omega)
        last, x = x, last + omega * (sweep(x) - last)
    return x
