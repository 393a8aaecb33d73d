"""The difference between two solutions that may have different nodes, for experiments that compare runs.

    shape    largest distance of a node of either solution to the other's trigonometric interpolant
    V_m, λ   largest difference between a node of the first solution and the nearest point of the second

Nearest points are found by Newton's method to round-off, so only differences normal to the membrane count. The
position of a node along the membrane has no physical meaning, because membranes are fluid.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxves.numerics import fourier

_FINER = 4  # Newton starts from the nearest point of a grid so much finer


def _slope(modes):
    """Returns the coefficients of the derivative, from those of `fourier.coefficients`."""
    cosine, sine = modes
    k = jnp.arange(cosine.shape[0]).reshape(-1, *[1] * (cosine.ndim - 1))
    return k * sine, -k * cosine


def nearest(x, other):
    """Returns the parameters (N,) of the points of the interpolant of `other` (K, 2) nearest to `x` (N, 2)."""
    grid = fourier.resample(other, _FINER * other.shape[0], axis=0)
    r2 = jnp.sum((x[:, None] - grid[None]) ** 2, axis=-1)
    spacing = 2 * np.pi / grid.shape[0]
    modes = fourier.coefficients(other)
    first = _slope(modes)
    second = _slope(first)

    def newton(alpha, _):
        apart = x - fourier.series(modes, alpha)
        tangent, bend = fourier.series(first, alpha), fourier.series(second, alpha)
        slope = jnp.sum(apart * tangent, axis=-1)
        curvature = jnp.sum(tangent**2, axis=-1) - jnp.sum(apart * bend, axis=-1)
        return alpha + jnp.clip(slope / curvature, -spacing, spacing), None

    alpha, _ = lax.scan(newton, spacing * jnp.argmin(r2, axis=1), length=8)
    return alpha


def _of_two(a, b):
    """Returns the differences of one vesicle at one time."""
    there, back = nearest(a["x"], b["x"]), nearest(b["x"], a["x"])
    one = jnp.sqrt(jnp.sum((a["x"] - fourier.evaluate(b["x"], there)) ** 2, axis=-1))
    other = jnp.sqrt(jnp.sum((b["x"] - fourier.evaluate(a["x"], back)) ** 2, axis=-1))
    out = {"shape": jnp.maximum(jnp.max(one), jnp.max(other))}
    if "V_m" in a:
        out["V_m"] = jnp.max(jnp.abs(a["V_m"] - fourier.evaluate(b["V_m"], there)))
    difference = jnp.max(jnp.abs(a["tension"] - fourier.evaluate(b["tension"], there)))
    return out | {"tension": difference / jnp.max(jnp.abs(b["tension"]))}


@jax.jit
def _of_all(a, b):
    return jax.vmap(jax.vmap(_of_two))(a, b)


def distances(rows, reference) -> dict[str, np.ndarray]:
    """Returns the largest difference of any vesicle at each saved time: "shape", "V_m" and relative "tension".

    `rows` and `reference` have `x` (T, M, N, 2), `tension` and, with a field, `V_m` (T, M, N). N may differ.
    """
    parts = [name for name in ("x", "V_m", "tension") if name in rows]
    a, b = ({name: jnp.asarray(side[name]) for name in parts} for side in (rows, reference))
    return {name: np.max(np.asarray(value), axis=1) for name, value in _of_all(a, b).items()}
