r"""Steady shapes by Newton's method, and their derivatives by the implicit function theorem.

A tank-treading vesicle is not a fixed point of y' = F(y), because its nodes move along the outline and it may drift.
Its shape is steady. With the mean velocity v̄ and the frame n, t, the shape and the potential on it are steady if

    (v - v̄)·n = 0,        dV_m/dt - ((v - v̄)·t) ∂_s V_m = 0

Further equations are the quantities that a run conserves: the area, the uniform metric (and with it the perimeter), and
∮ V_m ds = 0. The centroid and the first node are kept at their positions in the start, and so is the direction in a
fluid at rest without a field. A circle, which cannot deform, has the equation of its outline instead of the first one.
There are more equations than unknowns, but they are consistent: combinations of them that hold for every shape only up
to the discretisation error are left out. The Gauss-Newton step with the pseudo-inverse then converges quadratically,
and the implicit function theorem is

    dy = -R_y⁺ R_p dp

Directions that no equation fixes stay unchanged.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..equation.equation import Equation, equation_for
from ..equation.state import Unknowns
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import Scalar
from ..numerics.linear import AbstractSolver
from ..observables import diagnostics
from ..observables.outline import rates_on_outline
from ..physics.scene import Scene

_SETTLED = 1e-8  # the iteration has converged if the last change is smaller
_LOST = 10.0  # the iteration has diverged if a change is larger
_LOOSE = 1e-9  # relative singular values below this belong to directions that no equation fixes


class Steady(eqx.Module):
    """A steady state, its diagnostics, and the residual of its equations."""

    y: Unknowns
    diagnostics: dict[str, Array]
    residual: Scalar  # largest remaining velocity, relative stretch or rate of V_m
    last_step: Scalar  # largest change in the last iteration

    @property
    def converged(self) -> Array:
        """Whether the iteration has converged; diagnostics are NaN otherwise."""
        return self.last_step < _SETTLED


def residuals(equation: Equation, y: Unknowns, anchor: Curve) -> Float[Array, "R"]:
    """Returns the residuals of all equations. `anchor` is the outline that defines centroid and first node."""
    filter = equation.filter
    motion = equation.motion(jnp.zeros(()), y)
    outline = jax.tree.map(lambda leaf: leaf[0], motion.surfaces.curves)
    normal, rates = rates_on_outline(motion, y)
    x, N = y.x[0], y.x.shape[1]
    slip = jnp.mean(jnp.sum((x - anchor.x) * anchor.tangent, axis=-1))
    # A circle cannot deform: its normal velocity is zero for every x. It has the equation of its outline instead.
    distance = jnp.linalg.norm(x - geometry.centroid(outline), axis=-1)
    normal = jnp.where(equation.is_circle()[:, None], distance - equation.speed[:, None], normal)
    if equation.scene.viscosity_ratio is not None:
        # The velocities of all equations then have the same size for every ν.
        normal = 0.5 * (1 + equation.scene.viscosity_ratio)[:, None] * normal
    parts = [
        _independent(fourier.low_pass(normal[0], filter.x), outline, anchor, filter.x),
        fourier.multiply(outline.speed / equation.speed[0] - 1, _independent_modes(N, filter.x)),
        jnp.ravel(fourier.high_modes(N, filter.x).T @ x),
        geometry.area(outline) / equation.area - 1,
        geometry.centroid(outline) - geometry.centroid(anchor),
        slip[None],
    ]
    if equation.scene.flow is None and equation.scene.field is None:
        # Nothing but this keeps the direction. Few nodes leave a small force that would turn the vesicle.
        around = (anchor.x - geometry.centroid(anchor)) @ jnp.array([[0.0, 1.0], [-1.0, 0.0]])
        parts.append(jnp.mean(jnp.sum((x - anchor.x) * around, axis=-1))[None])
    for name, scalar in y.scalars.items():
        parts += [
            fourier.low_pass(rates[name][0], filter.surface),
            fourier.high_modes(N, filter.surface).T @ scalar[0],
            jnp.mean(scalar[0])[None],
        ]
    return jnp.concatenate(parts)


def _independent(normal: Float[Array, "N"], outline: Curve, anchor: Curve, cut: int) -> Float[Array, "N"]:
    """Returns normal velocities relative to v̄ without the parts that are zero for every shape.

    An inextensible membrane with a constant area has w = (v - v̄)·n with ∮ w ds = ∮ κ w ds = ∮ (n + κx) w ds = 0. At the
    nodes this holds up to the discretisation error only, and would give four equations too many. What is zero where w
    is a combination of 1, κ and n + κx stays orthogonal to those of `anchor`, so that four equations are absent.
    """
    bases, fixed = _dependent(outline, cut), _dependent(anchor, cut)
    gram = fixed.T @ bases
    # A circle has a constant κ.
    parts = jnp.linalg.solve(gram + 1e-12 * jnp.trace(gram) * jnp.eye(4), fixed.T @ normal)
    return normal - bases @ parts


def _dependent(outline: Curve, cut: int) -> Float[Array, "N 4"]:
    curvature = outline.curvature[:, None]
    bases = jnp.concatenate([jnp.ones_like(curvature), curvature, outline.normal + curvature * outline.x], axis=1)
    return fourier.low_pass(bases, cut, axis=0)


def _independent_modes(N: int, cut: int) -> np.ndarray:
    """Returns the symbol (N/2 + 1,) of the modes of the metric that nodes with modes up to K = N/2 - `cut` determine.

    A node mode k changes normal velocity and metric in the modes |k - 1| of one turn of the tangent. With the modes of
    the normal velocity up to K, there are as many equations as unknowns, also for centrally symmetric shapes alone,
    if the metric has the modes up to K - 1 and K + 1.
    """
    modes, highest = np.arange(N // 2 + 1), N // 2 - cut
    return ((modes <= highest + 1) & (modes != highest)).astype(float)


def steady_shape(scene: Scene, start: Unknowns, *, most: int = 30, solver: AbstractSolver | None = None) -> Steady:
    """Returns the steady shape near `start`, with the area and perimeter of `scene.x`, and field and flow at t = 0.

    The function is pure. It is differentiable once, forward or reverse, in everything the scene depends on; this costs
    one linear solve. Second derivatives are wrong, because the pseudo-inverse is taken as constant. `start` has no
    derivative; the end of a run is a good choice. The steady shape may be unstable. If Newton's method does not
    converge, the diagnostics are NaN.

    Raises:
        ValueError: the scene has several vesicles. In general they do not come to rest relative to each other.
    """
    if scene.x.shape[0] != 1:
        raise ValueError(f"A steady shape needs one vesicle, but the scene has {scene.x.shape[0]}.")
    return _by_newton(scene, start, most, solver)


@eqx.filter_jit
def _by_newton(scene: Scene, start: Unknowns, most: int, solver: AbstractSolver | None) -> Steady:
    equation = equation_for(scene, solver=solver)
    start = jax.lax.stop_gradient(Unknowns(start.x, start.scalars))
    anchor = Curve.from_nodes(start.x[0])
    flat, unflatten = ravel_pytree(start)
    fixed = jax.lax.stop_gradient(equation)

    def residual(equation, u):
        return residuals(equation, unflatten(u), anchor)

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
    # One more step from a constant state. Its derivative is that of the implicit function theorem.
    u, change = newton(jax.lax.stop_gradient(u))
    y = unflatten(u)
    found = diagnostics.diagnose(equation, jnp.zeros(()), y, equation.motion(jnp.zeros(()), y))
    left = jnp.max(jnp.abs(residual(fixed, jax.lax.stop_gradient(u))))
    last = jax.lax.stop_gradient(change)
    found = jax.tree.map(lambda value: jnp.where(last < _SETTLED, value, jnp.nan), found)
    return Steady(y, found, left, last)
