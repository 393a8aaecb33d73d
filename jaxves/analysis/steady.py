r"""States whose shape stands still, by Newton's method, and their derivatives without a history.

A tank-treading vesicle is no fixed point of y' = F(y): its nodes move along the outline, and it may drift. Its shape
is one. With v̄ the mean velocity, n and t the frame, the shape and the potential on it stand still when

    (v - v̄)·n = 0,        dV_m/dt - ((v - v̄)·t) ∂_s V_m = 0

Whatever these leave open is fixed by what a run keeps: area, uniform metric and with it the perimeter, ∮ V_m ds = 0;
and by a gauge: centroid and first node stay where the start has them. More equations than unknowns, but consistent
ones: Gauss and Newton's step with the pseudo-inverse converges quadratically, and the implicit function theorem reads

    dy = -R_y⁺ R_p dp

Directions that nothing fixes, like the direction of a vesicle in a fluid at rest, stay as they are.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..equation.equation import Equation, equation_for
from ..equation.state import Motion, Unknowns
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import Scalar
from ..numerics.linear import AbstractSolver
from ..observables import diagnostics
from ..physics.scene import Scene

_SETTLED = 1e-8  # last changes below this change nothing that matters
_LOST = 10.0  # and above this nothing is found any more
_LOOSE = 1e-9  # singular values below this, relative to the largest, belong to directions that nothing fixes


class Steady(eqx.Module):
    """A state whose shape stands still, what is found there, and how well it solves the equations."""

    y: Unknowns
    diagnostics: dict[str, Array]
    residual: Scalar  # largest velocity, relative stretch or rate of V_m left
    last_step: Scalar  # largest change of the last iteration

    @property
    def converged(self) -> Array:
        """Whether the last iteration changed nothing that matters; diagnostics are NaN otherwise."""
        return self.last_step < _SETTLED


def _along_outline(motion: Motion, y: Unknowns):
    """(normal velocity (N,), rate of V_m (N,) or None) at fixed places on the outline of the one vesicle."""
    curves = motion.surfaces.curves
    weights = curves.weights[..., None] / jnp.sum(curves.weights)
    relative = motion.velocity - jnp.sum(weights * motion.velocity, axis=1, keepdims=True)
    normal = jnp.sum(relative * curves.normal, axis=-1)
    if y.V_m is None:
        return normal[0], None
    carried = jnp.sum(relative * curves.tangent, axis=-1) * motion.surfaces.d_ds(y.V_m)
    return normal[0], (motion.V_rate - carried)[0]


def _residual(equation: Equation, y: Unknowns, anchor: Curve) -> Float[Array, "R"]:
    """All equations; `anchor` is the outline from which the gauge is taken."""
    filter = equation.filter
    motion = equation.motion(jnp.zeros(()), y)
    outline = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
    normal, V_rate = _along_outline(motion, y)
    x, N = y.x[0], y.x.shape[1]
    slip = jnp.mean(jnp.sum((x - anchor.x) * anchor.tangent, axis=-1))
    parts = [
        fourier.low_pass(normal, filter.x),
        fourier.low_pass(outline.speed / equation.speed[0] - 1, filter.surface),
        jnp.ravel(fourier.high_modes(N, filter.x).T @ x),
        geometry.area(outline) / equation.area - 1,
        geometry.centroid(outline) - geometry.centroid(anchor),
        slip[None],
    ]
    if V_rate is not None:
        parts += [
            fourier.low_pass(V_rate, filter.surface),
            fourier.high_modes(N, filter.surface).T @ y.V_m[0],
            jnp.mean(y.V_m[0])[None],
        ]
    return jnp.concatenate(parts)


def steady_shape(scene: Scene, start: Unknowns, *, most: int = 30, solver: AbstractSolver | None = None) -> Steady:
    """The steady shape near `start`, of the area and perimeter of `scene.x`; field and flow as they are at t = 0.

    Pure: under `jit`, and differentiable once, in either mode and in whatever the scene depends on, at the cost of
    one linear solve (a second derivative would need that of the pseudo-inverse, which is taken as constant). `start`
    has no derivative: take the end of a run. Stable or not, a nearby steady shape is found; where Newton's method does
    not converge, diagnostics are NaN.

    Raises:
        ValueError: the scene has several vesicles, which do not come to rest relative to each other in general.
    """
    if scene.x.shape[0] != 1:
        raise ValueError(f"A steady shape is sought of one vesicle, but the scene has {scene.x.shape[0]}.")
    return _by_newton(scene, start, most, solver)


@eqx.filter_jit
def _by_newton(scene: Scene, start: Unknowns, most: int, solver: AbstractSolver | None) -> Steady:
    equation = equation_for(scene, solver=solver)
    start = jax.lax.stop_gradient(Unknowns(start.x, start.V_m))
    anchor = Curve.from_nodes(start.x[0])
    flat, unflatten = ravel_pytree(start)
    fixed = jax.lax.stop_gradient(equation)

    def residual(equation, u):
        return _residual(equation, unflatten(u), anchor)

    def newton(u):
        matrix = jax.jacfwd(lambda u: residual(fixed, u))(u)
        step = -jnp.linalg.pinv(matrix, rtol=_LOOSE) @ residual(equation, u)
        return u + step, jnp.max(jnp.abs(step))

    def unsettled(carry):
        _, change, count = carry
        return (change > 0.1 * _SETTLED) & (change < _LOST) & (count < most)

    def iterate(carry):
        u, _, count = carry
        return *jax.lax.stop_gradient(newton(u)), count + 1

    u, *_ = jax.lax.while_loop(unsettled, iterate, (flat, jnp.asarray(1.0), jnp.int32(1)))
    # One more, from a constant: its derivative is the implicit one.
    u, change = newton(jax.lax.stop_gradient(u))
    y = unflatten(u)
    found = diagnostics.diagnose(equation, jnp.zeros(()), y, equation.motion(jnp.zeros(()), y))
    left = jnp.max(jnp.abs(residual(fixed, jax.lax.stop_gradient(u))))
    last = jax.lax.stop_gradient(change)
    found = jax.tree.map(lambda value: jnp.where(last < _SETTLED, value, jnp.nan), found)
    return Steady(y, found, left, last)
