r"""Small disturbances of a steady state of one vesicle: their rates, those left out, the symmetries that they break.

A disturbance z = (h, w) moves the outline by h along the normal, and changes the scalars on it, such as V_m, by w.
Outline and scalars of a steady state do not change (`steady`). To first order therefore

    dz/dt = L z,     L = ∂(normal velocity, rates of the scalars at fixed places on the outline)/∂(h, w)

In h and w the motion along the outline does not appear, and with it the phase of tank-treading.

The area, the perimeter and the net charge do not change. L maps disturbances that keep them to disturbances that keep
them. These are orthogonal to (1, 0), (κ, 0) and, for each scalar V, (Vκ, 1). A translation changes nothing, nor does a
rotation in a fluid at rest without a field. With the displacement d of these motions they are z = (d·n, -d·t V_s), and
L maps them to zero. The other eigenvalues of L are therefore those of P L P with the orthogonal projection P on what
remains. The highest modes, which the equation filters, are left out as well. A circle cannot deform, and has
disturbances of its scalars only.
"""

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float, Inexact

from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier
from ..observables.outline import rates_on_outline

CENTER, AXIS = "about its centre", "in its axis"
_AT_ONCE = 64  # columns of L that are computed together
_DEPENDENT = 1e-9  # relative singular values below this belong to directions that are left out twice
_SYMMETRIC = 1e-5  # a state that deviates by less, relative to its size, has the symmetry


def linearisation(equation: Equation, y: Unknowns) -> Float[Array, "n n"]:
    """Returns L at the steady state y, for h and then the scalars in the order of their names, with all modes."""
    outline = Curve.from_nodes(y.x[0])
    zero, unflatten = ravel_pytree((jnp.zeros_like(outline.speed), jax.tree.map(jnp.zeros_like, y.scalars)))

    def rates(z):
        h, w = unflatten(z)
        scalars = jax.tree.map(jnp.add, y.scalars, w)
        moved = equation.filtered(Unknowns(y.x + (h[:, None] * outline.normal)[None], scalars))
        normal, found = rates_on_outline(equation.motion(jnp.zeros(()), moved), moved)
        return ravel_pytree((normal[0], found))[0]

    _, along = jax.linearize(rates, zero)
    return jax.lax.map(along, jnp.eye(len(zero)), batch_size=_AT_ONCE).T


def remaining(equation: Equation, y: Unknowns, *, rotation: bool) -> Float[Array, "n n"]:
    """Returns P. `rotation` tells whether a rotation changes nothing."""
    outline, cut = Curve.from_nodes(y.x[0]), equation.filter
    scalars = [y.scalars[name][0] for name in sorted(y.scalars)]
    N, circle = outline.speed.shape[0], equation.is_circle()[0]
    zero, one, curvature = jnp.zeros(N), jnp.ones(N), outline.curvature
    # The curvature of a circle is constant, and all its normal displacements are left out below.
    kept = [[one], [jnp.where(circle, jnp.cos(2 * fourier.grid(N)), curvature)]]
    kept = [column + [zero] * len(scalars) for column in kept]
    for m, V in enumerate(scalars):
        own = [one if k == m else zero for k in range(len(scalars))]
        kept.append([jnp.where(circle, 0.0, V * curvature), *own])
    x = outline.x - geometry.centroid(outline)
    motions = [jnp.broadcast_to(unit, (N, 2)) for unit in jnp.eye(2)]
    if rotation:
        motions.append(jnp.stack([-x[:, 1], x[:, 0]], axis=1))
    slopes = [fourier.derivative(V) / outline.speed for V in scalars]
    for d in motions:
        along = jnp.where(circle, 0.0, jnp.sum(d * outline.tangent, axis=1))
        kept.append([jnp.sum(d * outline.normal, axis=1), *(-along * slope for slope in slopes)])
    columns = jnp.stack([jnp.concatenate(column) for column in kept], axis=1)
    high = [fourier.high_modes(N, c) for c in (cut.x, *[cut.surface] * len(scalars))]
    columns = jnp.concatenate([columns, jax.scipy.linalg.block_diag(*high)], axis=1)
    projection = jnp.eye(len(columns)) - columns @ jnp.linalg.pinv(columns, rtol=_DEPENDENT)
    deformable = jnp.where(circle & (jnp.arange(len(columns)) < N), 0.0, 1.0)
    return projection * deformable * deformable[:, None]


def broken(equation: Equation, y: Unknowns, shapes: Array, scalars: dict[str, Array]) -> dict[str, Float[Array, "K"]]:
    """Returns the share of the square of each disturbance that breaks each symmetry of the steady state.

    `shapes` (K, N) are normal displacements, `scalars` (K, N) changes by name. The symmetries are those of
    `equation/symmetry.py`. A share is NaN where the state does not have the symmetry.
    """
    x = y.x[0] - jnp.mean(y.x[0], axis=0)
    size, axis = jnp.linalg.norm(x[0]), x[0] / jnp.linalg.norm(x[0])
    parity = 1.0
    if equation.scene.field is not None:
        direction = equation.scene.field.unit_direction()
        parity = jnp.where(jnp.abs(axis @ direction) > jnp.sqrt(0.5), 1.0, -1.0)
    reflection = 2 * jnp.outer(axis, axis) - jnp.eye(2)
    images = {
        CENTER: (_opposite, -jnp.eye(2), -1.0),
        AXIS: (_backwards, reflection, parity),
    }
    total = _square(shapes) + sum(map(_square, scalars.values()))
    shares = {}
    for name, (at, turned, sign) in images.items():
        lacking = [x - at(x.T).T @ turned, *(V[0] - sign * at(V[0]) for V in y.scalars.values())]
        has = jnp.max(jnp.stack([jnp.max(jnp.abs(part)) for part in lacking])) < _SYMMETRIC * size
        lost = _square(shapes - at(shapes)) + sum(_square(w - sign * at(w)) for w in scalars.values())
        shares[name] = jnp.where(has, 0.25 * lost / total, jnp.nan)
    return shares


def _opposite(f: Inexact[Array, "*K N"]) -> Inexact[Array, "*K N"]:
    """Returns f(α + π)."""
    return jnp.roll(f, f.shape[-1] // 2, axis=-1)


def _backwards(f: Inexact[Array, "*K N"]) -> Inexact[Array, "*K N"]:
    """Returns f(-α)."""
    return jnp.roll(f[..., ::-1], 1, axis=-1)


def _square(f: Inexact[Array, "K N"]) -> Float[Array, "K"]:
    return jnp.sum(jnp.abs(f) ** 2, axis=-1)
