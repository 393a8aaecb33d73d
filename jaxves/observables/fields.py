r"""Velocity, pressure, potential and electric field at any points, at one instant of a run.

    u = v_∞ + S_Stokes[f_hd],   p = P_Stokes[f_hd]       φ = -E_∞·x + S q - D V_m,   E = -∇φ       of all membranes

With two viscosities D_Stokes[(1 - ν) v] is added to u and its pressure to p, and u is divided by ν inside. For the
rigid part of v this potential is known, so that large ν do not multiply its quadrature error.

Points may be at any distance from the membranes. On a membrane, fields that jump have the limit from the side of the
point. Near a membrane, close evaluation is used. Farther away, the trapezoidal rule on four times as many nodes
is exact to round-off and several times cheaper; the limit is the paper's 5h rule. Points are sorted by the membrane
they are near. Each chunk of points chooses the rule for each membrane at run time. Under `vmap` both rules are
computed.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..base.arguments import refusal
from ..equation.equation import Equation
from ..equation.state import Unknowns
from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import Points, Scalar, ScalarLike, as_float
from ..physics.rigid import RigidMotion
from ..potentials import close_laplace, close_stokes, far
from ..potentials.close_laplace import CloseGeometry

_UPSAMPLE = 4  # source nodes of the trapezoidal rule per node of the run
_STRIP = 5.0 / _UPSAMPLE + 0.5  # node spacings; half a spacing is added because the curve passes between nodes
_CHUNK = 256  # points evaluated at once; this limits the memory to about ten MB for any number of vesicles


class Surroundings(eqx.Module):
    """Fields at P points; `potential` and `electric_field` are None without an electric field.

    The potential is also None in a field of the user's own, of which only the gradient is known.
    `velocity` is in a/t_κ, `pressure` in κ_B/a³ (zero far away), `potential` in a|E_∞|, `electric_field` in |E_∞|.
    `inside` is the number of the vesicle that encloses the point, -1 in the outer fluid. For a point on a membrane,
    round-off decides the side, and the other fields are those of this side.
    """

    velocity: Points
    pressure: Float[Array, "P"]
    potential: Float[Array, "P"] | None
    electric_field: Points | None
    inside: Int[Array, "P"]


class _Membrane(eqx.Module):
    """One membrane with its densities; with a leading axis, all of them. A density that is absent is None."""

    curve: Curve
    f_hd: Float[Array, "*batch N 2"]
    q: Float[Array, "*batch N"] | None
    V_m: Float[Array, "*batch N"] | None
    u: Float[Array, "*batch N 2"] | None = None  # (1 - ν) times the velocity without its rigid part


def fields_at(equation: Equation, t: ScalarLike, y: Unknowns, points: Points) -> Surroundings:
    """Returns velocity, pressure, potential and electric field at `points` (P, 2), for the state `y` at time `t`.

    The result is differentiable, forward and reverse, except `inside`.

    Raises:
        ValueError: the vesicles are in a periodic cell, for which fields between them are not computed.
    """
    if equation.scene.cell is not None:
        raise refusal(
            "equation.scene.cell", equation.scene.cell, "no periodic cell where fields at points are asked for"
        )
    return _around(equation, as_float(t), y, points)


@eqx.filter_jit
def _around(equation: Equation, t: Scalar, y: Unknowns, points: Points) -> Surroundings:
    scene = equation.scene
    motion = equation.motion(t, y)
    q = V_m = None
    if motion.electric is not None:
        q, V_m = motion.electric.charge, motion.electric.potential(y.scalars)
    ratio, curves, u = scene.viscosity_ratio, motion.surfaces.curves, None
    if ratio is not None:
        # Not the filtered velocity of the nodes, whose error would be multiplied by 1/ν inside and by ν outside.
        imposed = None if scene.flow is None else scene.flow.velocity(y.x, t)
        moving = equation.mobility.at(motion.surfaces).velocity(motion.f_hd, imposed)
        turning = jax.vmap(RigidMotion.nearest)(curves, moving)
        u = (1 - ratio)[:, None, None] * (moving - jax.vmap(RigidMotion.at)(turning, curves.x))
    membranes = _Membrane(curves, motion.f_hd, q, V_m, u)

    M, P = y.x.shape[0], points.shape[0]
    is_near, enclosed = jax.lax.map(lambda point: _place(membranes.curve, point), points, batch_size=_CHUNK)
    order = jnp.argsort(jnp.where(jnp.any(is_near, axis=1), jnp.argmax(is_near, axis=1), M))
    size = min(_CHUNK, P)
    chunks = jnp.pad(order, (0, -P % size), mode="edge").reshape(-1, size)

    def of_chunk(some):
        return _disturbance(membranes, points[some], is_near[some], enclosed[some])

    place = jnp.argsort(order)
    sums, enclosed = jax.tree.map(lambda leaf: leaf.reshape(-1, *leaf.shape[2:])[place], jax.lax.map(of_chunk, chunks))
    velocity, pressure, *electric = sums
    if scene.flow is not None:
        velocity = velocity + scene.flow.velocity(points[None], t)[0]
    potential = electric_field = None
    if scene.field is not None:
        E_inf = scene.field.at(points, t)
        potential, electric_field = (
            electric[0] - points @ E_inf if scene.field.is_uniform() else None,
            E_inf - electric[1],
        )
    inside = jnp.where(jnp.any(enclosed, axis=1), jnp.argmax(enclosed, axis=1), -1)
    if ratio is not None:
        rigid = jax.vmap(RigidMotion.at, in_axes=(0, None))(turning, points)
        within = (velocity + jnp.einsum("m,mpa,pm->pa", ratio - 1, rigid, enclosed)) / ratio[inside][:, None]
        velocity = jnp.where((inside >= 0)[:, None], within, velocity)
    return Surroundings(velocity, pressure, potential, electric_field, inside)


def _place(curves: Curve, point: Float[Array, "2"]) -> tuple[Bool[Array, "M"], Bool[Array, "M"]]:
    """Returns which membranes `point` is near, and which polygons of nodes enclose it.

    Far from a membrane, its polygon of nodes encloses the same points as the membrane. The winding number is computed
    by counting how the polygon crosses the ray to the right of the point.
    """
    start = jax.lax.stop_gradient(far.separations(curves, point[None])[0])
    end = jnp.roll(start, -1, axis=1)
    # With r = point - node, the edge from r0 to r1 crosses the level of the point, to its right.
    cross = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
    up = (start[..., 1] >= 0) & (end[..., 1] < 0) & (cross > 0)
    down = (start[..., 1] < 0) & (end[..., 1] >= 0) & (cross < 0)
    enclosed = jnp.sum(up, axis=1) > jnp.sum(down, axis=1)
    strip = _STRIP * jnp.max(jax.vmap(lambda curve: curve.weights)(curves), axis=1)
    return jnp.min(jnp.sum(start**2, axis=-1), axis=1) < strip**2, enclosed


def _disturbance(membranes: _Membrane, targets: Points, is_near: Bool[Array, "P M"], enclosed: Bool[Array, "P M"]):
    """Returns the fields of `_closely`, summed over all membranes, and which membranes enclose the targets."""

    def of_one(args):
        membrane, is_near, enclosed = args
        return jax.lax.cond(
            jnp.any(is_near),
            lambda: _closely(membrane, targets),
            # This branch is for targets that are all far. Under `vmap` it is computed for near targets as well. They
            # are moved away, so that 0/0 does not enter the derivative.
            lambda: (_widely(membrane, jnp.where(is_near[:, None], _elsewhere(membrane), targets)), enclosed),
        )

    fields, enclosed = jax.lax.map(of_one, (membranes, is_near.T, enclosed.T))
    return jax.tree.map(lambda field: jnp.sum(field, axis=0), fields), enclosed.T


def _elsewhere(membrane: _Membrane) -> Float[Array, "2"]:
    return 1.0 + 2.0 * jnp.max(jnp.abs(membrane.curve.x), axis=0)


def _closely(membrane: _Membrane, targets: Points):
    """Returns the fields of one membrane by close evaluation, and which targets it encloses.

    The fields are velocity, pressure and, with an electric field, S q - D V_m and its gradient.
    """
    close = CloseGeometry.of(membrane.curve, targets)
    q, V_m = membrane.q, membrane.V_m
    fields = close_stokes.stokes_slp(close, membrane.f_hd), close_stokes.stokes_slp_pressure(close, membrane.f_hd)
    if membrane.u is not None:
        double = close_stokes.stokes_dlp(close, membrane.u), close_stokes.stokes_dlp_pressure(close, membrane.u)
        fields = fields[0] + double[0], fields[1] + double[1]
    if q is not None:
        potential = close_laplace.laplace_slp(close, q) - close_laplace.laplace_dlp(close, V_m)
        gradient = close_laplace.laplace_slp_gradient(close, q) - close_laplace.laplace_dlp_gradient(close, V_m)
        fields = *fields, potential, gradient
    return fields, close.inside


def _widely(membrane: _Membrane, targets: Points):
    """Returns the same fields by the trapezoidal rule."""
    K = _UPSAMPLE * membrane.curve.x.shape[0]

    def finer(density):
        return fourier.resample(density, K, axis=0)[None]

    curves = jax.vmap(Curve.from_nodes)(finer(membrane.curve.x))
    f_hd = finer(membrane.f_hd)
    fields = far.stokes_slp(curves, f_hd, targets), far.stokes_slp_pressure(curves, f_hd, targets)
    if membrane.u is not None:
        u = finer(membrane.u)
        double = far.stokes_dlp(curves, u, targets), far.stokes_dlp_pressure(curves, u, targets)
        fields = fields[0] + double[0], fields[1] + double[1]
    if membrane.q is not None:
        q, V_m = finer(membrane.q), finer(membrane.V_m)
        potential = far.laplace_slp(curves, q, targets) - far.laplace_dlp(curves, V_m, targets)
        gradient = far.laplace_slp_gradient(curves, q, targets) - far.laplace_dlp_gradient(curves, V_m, targets)
        fields = *fields, potential, gradient
    return fields
