r"""Velocity, potential and electric field away from the membranes, at one instant of a run.

    u = v_∞ + S_Stokes[f_hd]        φ = -E_∞·x + S q - D V_m        E = -∇φ        S, D of all membranes

The trapezoidal rule is used where it holds to round-off: no nearer to a node than five times the node
spacing (the paper's 5h rule). Points nearer are marked and come back as NaN rather than wrong. Finer
nodes, by trigonometric interpolation of curve and densities, narrow that strip.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from . import fourier
from .arrays import Points, ScalarLike, VesicleNodes, VesiclePoints, as_float
from .curve import Curve
from .equation import Equation, Unknowns
from .potentials import far

_STRIP = 5.0  # node spacings about a membrane in which the trapezoidal rule fails
_CHUNK = 512  # points evaluated at once: bounds the memory to tens of MB per vesicle


class Surroundings(eqx.Module):
    """Fields at P points; NaN where `valid` is False, `None` where there is no field.

    `potential` in units of a|E_∞|, `electric_field` in |E_∞|, `velocity` in a/t_κ; `inside` is the number
    of the vesicle that encloses the point, -1 in the outer fluid, and holds at every point.
    """

    velocity: Points
    potential: Float[Array, "P"] | None
    electric_field: Points | None
    inside: Int[Array, "P"]
    valid: Bool[Array, "P"]


class _Sources(eqx.Module):
    """Membranes and their densities, on the finer nodes."""

    curves: Curve
    f_hd: VesiclePoints
    q: VesicleNodes | None
    V_m: VesicleNodes | None

    @classmethod
    def of(cls, x: VesiclePoints, f_hd, q, V_m, upsample: int) -> "_Sources":
        def finer(density):
            return None if density is None else fourier.resample(density, upsample * x.shape[1], axis=1)

        return cls(jax.vmap(Curve.from_nodes)(finer(x)), finer(f_hd), finer(q), finer(V_m))


def around(equation: Equation, t: ScalarLike, y: Unknowns, points: Points, *, upsample: int = 4) -> Surroundings:
    """What the fluid does and which field there is at `points`, with state `y` at time `t`.

    `upsample` (static): source nodes per node of the run; the strip without values is 5/`upsample` of the
    run's node spacings wide. Differentiable in everything but `inside` and `valid`.
    """
    scene = equation.scene
    t = as_float(t)
    motion = equation.motion(t, y)
    q = None if scene.field is None else scene.field.contrast()[:, None] * motion.w
    sources = _Sources.of(y.x, motion.f_hd, q, y.V_m, upsample)
    # Any point off the membranes will do in place of those without a value: 0/0 has no derivative.
    elsewhere = 1.0 + 2.0 * jnp.max(jnp.abs(sources.curves.x))

    def at(point):
        inside, valid = _place(sources.curves, point)
        target = jnp.where(valid, point, elsewhere)[None]
        velocity = far.stokes_slp(sources.curves, sources.f_hd, target)[0]
        potential = electric_field = None
        if scene.field is not None:
            potential, electric_field = _electric(sources, scene.field.E_inf(t), target)
        fields = jax.tree.map(lambda f: jnp.where(valid, f, jnp.nan), (velocity, potential, electric_field))
        return *fields, inside, valid

    velocity, *rest = jax.lax.map(at, points, batch_size=_CHUNK)
    if scene.flow is not None:
        velocity = velocity + scene.flow.velocity(points[None], t)[0]
    return Surroundings(velocity, *rest)


def _electric(sources: _Sources, E_inf: Float[Array, "2"], target: Float[Array, "1 2"]):
    curves, q, V_m = sources.curves, sources.q, sources.V_m
    potential = far.laplace_slp(curves, q, target) - far.laplace_dlp(curves, V_m, target)
    gradient = far.laplace_slp_gradient(curves, q, target) - far.laplace_dlp_gradient(curves, V_m, target)
    return potential[0] - target[0] @ E_inf, E_inf - gradient[0]


def _place(curves: Curve, point: Float[Array, "2"]) -> tuple[Int[Array, ""], Bool[Array, ""]]:
    """Number of the vesicle around `point`, or -1, and whether the trapezoidal rule holds there.

    Inside by the winding number of the polygon of nodes, counted in crossings of the ray to the right: unlike
    D[1] it is exact at any distance that the polygon resolves.
    """
    start = jax.lax.stop_gradient(far.separations(curves, point[None])[0])
    end = jnp.roll(start, -1, axis=1)
    # With r = point - node, the edge from r0 to r1 crosses the level of the point, to its right.
    cross = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
    up = (start[..., 1] >= 0) & (end[..., 1] < 0) & (cross > 0)
    down = (start[..., 1] < 0) & (end[..., 1] >= 0) & (cross < 0)
    enclosed = jnp.sum(up, axis=1) > jnp.sum(down, axis=1)
    inside = jnp.where(jnp.any(enclosed), jnp.argmax(enclosed), -1)
    spacing = jax.vmap(lambda curve: curve.weights)(curves)
    return inside, jnp.all(jnp.sum(start**2, axis=-1) >= (_STRIP * spacing) ** 2)
