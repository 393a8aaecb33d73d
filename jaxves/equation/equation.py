r"""The equation of motion F(y) of y = (x, V_m), and its constraints.

    dx/dt   = v_∞ + S[f_hd],     f_hd = -κ_B x_ssss + (σ x_s)_s - f_el,     x_s · (dx/dt)_s = 0
    dV_m/dt = (Λ/(1+Λ) w - G V_m)/χ

F eliminates the tension σ and the charge w by solving for them; what is found on the way is part of its linear part
A (`frozen`).

Spectral derivatives cannot see the Nyquist mode, so nothing would damp it: σ and V_m lose it, and x
loses a band more, because a stretching pattern just below Nyquist is invisible to a σ without it.
Nothing here knows how time is stepped.
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier, krylov, linear
from ..numerics.arrays import PerVesicle, Scalar, VesicleNodes, VesiclePoints
from ..operators.interactions import AbstractCoupling, AbstractInteractions, pair_frames
from ..operators.sums import coupling_for
from ..operators.surfaces import Surfaces
from ..physics import electric, membrane
from ..physics.rigid import holding_force, nearest_circle, rigid_part
from ..physics.scene import Scene
from . import linear_part
from .implicit import Frozen
from .inextensible import Constraint, stretch_response
from .state import Motion, Unknowns
from .symmetry import Symmetry

_COUPLED = 1e-11  # true relative residual of the systems that couple membranes


class Filter(eqx.Module):
    """How many of the highest modes are removed: from x, and from σ and V_m."""

    x: int = eqx.field(static=True)
    surface: int = eqx.field(static=True, default=1)

    @classmethod
    def for_nodes(cls, N: int) -> "Filter":
        """max(2, N/16) from x, Nyquist alone from σ and V_m."""
        return cls(max(2, N // 16))


def _solve_coupled(
    blocks: linear.AbstractFactoredDense,
    respond: Callable[[AbstractInteractions, VesicleNodes], VesicleNodes],
    across: AbstractInteractions,
    b: VesicleNodes,
) -> linear.Solution:
    """Solves (B + C) x = b by GMRES: B the factorised `blocks` of the membranes, C x = respond(across, x)."""
    M, N = b.shape
    rough = across.roughly()

    def action(v):
        v = v.reshape(M, N)
        return (jnp.einsum("mij,mj->mi", blocks.operator.matrix, v) + respond(across, v)).reshape(-1)

    def own(v):
        return linear.solve_blocks(blocks, v)

    def precondition(v):
        v = v.reshape(M, N)
        if rough is None:
            return own(v).reshape(-1)
        return krylov.chebyshev(lambda x: own(v - respond(rough, x)), own(v)).reshape(-1)

    operator = linear.LinearOperator(action=action, precondition=precondition)
    return linear.GMRES(_COUPLED).factor(operator).solve(b.reshape(-1)).reshaped(M, N)


def _assembled(blocks: Float[Array, "M N N"], coupled: Float[Array, "n n"]) -> linear.AbstractFactoredDense:
    """The factorised matrix of all membranes: `blocks` on its diagonal, `coupled` off it."""
    M, N, _ = blocks.shape
    m = np.arange(M)
    whole = coupled.reshape(M, N, M, N).at[m, :, m, :].set(blocks).reshape(M * N, M * N)
    return linear.Dense().factor(linear.LinearOperator(whole))


def _crowded(surfaces: Surfaces) -> Array | None:
    return None if surfaces.interactions is None else surfaces.interactions.crowded


class Equation(eqx.Module):
    """F, A and the constraints for one scene.

    `area` (M,) and `speed` (M,), the arc length per unit of α, are what the projection returns to.
    """

    scene: Scene
    area: PerVesicle
    speed: PerVesicle
    filter: Filter
    solver: linear.AbstractSolver  # of one membrane's charge, where its factors are not needed
    coupling: AbstractCoupling | None  # None: a lone membrane
    symmetry: Symmetry | None  # None: several
    integrands: object = eqx.field(static=True, default=None)  # (Motion, Scene, t) -> dict, or None

    def kept(self) -> dict[str, PerVesicle]:
        """The areas and perimeters that do not change, by the names of the diagnostics."""
        return {"area": self.area, "length": 2 * np.pi * self.speed}

    def is_circle(self) -> Array:
        """Which vesicles hold all the area that their perimeter allows, to rounding; (M,) booleans."""
        return self.area > (1 - 1e-10) * jnp.pi * self.speed**2

    # -- F ------------------------------------------------------------------------------------

    def motion(self, t: Scalar, y: Unknowns) -> Motion:
        """F(y) and everything found on the way."""
        return self._motion(t, y, factored=False)[0]

    def rate(self, t: Scalar, y: Unknowns) -> Unknowns:
        """F(y); NaN where crowded interactions would make it wrong in silence."""
        motion = self.motion(t, y)
        rate = self._rate(t, motion)
        if _crowded(motion.surfaces) is None:
            return rate
        return jax.tree.map(lambda leaf: jnp.where(jnp.isposinf(motion.residual), jnp.nan, leaf), rate)

    def rate_of(self, frozen: Frozen, t: Scalar) -> Unknowns:
        """F(y) at the instant at which `frozen` was frozen."""
        return self._rate(t, frozen.motion)

    def _rate(self, t: Scalar, motion: Motion) -> Unknowns:
        integrals = None if self.integrands is None else self.integrands(motion, self.scene, t)
        return Unknowns(motion.velocity, motion.V_rate, integrals)

    def _constraint(self, surfaces: Surfaces) -> Constraint:
        return Constraint.of(surfaces, self.is_circle(), self.filter.surface)

    def _motion(self, t: Scalar, y: Unknowns, *, factored: bool):
        """F, and the factorised parts that A and the constraints are made of (of the charge when `factored`)."""
        scene = self.scene
        surfaces = Surfaces.of(y.x, electric=scene.field is not None, coupling=self.coupling)
        curves = surfaces.curves
        force = jax.vmap(membrane.linear_bending_force)(curves, scene.bending)
        residual, iterations = jnp.zeros(()), jnp.int32(0)

        f_el = V_rate = w = fields = charge = None
        if scene.field is not None:
            with jax.named_scope("electric"):
                solution, charge = self._charge(t, surfaces, y.V_m, factored)
                w = solution.value
                residual = jnp.maximum(residual, jnp.max(solution.residual))
                iterations = iterations + jnp.max(solution.iterations)
                V_rate = fourier.low_pass(scene.field.charging_rate(y.V_m, w), self.filter.surface)
                f_el, fields = self._traction(t, surfaces, y.V_m, w)
                force = force - f_el

        velocity = surfaces.stokes(force)
        if scene.flow is not None:
            velocity = velocity + scene.flow.velocity(y.x, t)

        constraint = self._constraint(surfaces)
        stretch = curves.speed * jax.vmap(membrane.stretch_rate)(curves, velocity)
        stretch = fourier.low_pass(stretch, self.filter.surface)
        solution = self._tension(surfaces, constraint, stretch)
        sigma = solution.value
        residual = jnp.maximum(residual, jnp.max(solution.residual))
        iterations = iterations + jnp.max(solution.iterations)
        if (crowded := _crowded(surfaces)) is not None:
            residual = jnp.where(crowded, jnp.inf, residual)
        f_tension = jax.vmap(membrane.linear_tension_force)(curves, sigma)
        velocity = velocity + surfaces.stokes(f_tension)
        velocity = fourier.low_pass(velocity, self.filter.x, axis=1)
        f_hd = force + f_tension
        if surfaces.interactions is None:
            sigma, f_hd, velocity = jax.lax.cond(
                jnp.any(self.is_circle()),
                lambda: self._held(curves, sigma, f_hd, velocity),
                lambda: (sigma, f_hd, velocity),
            )
        motion = Motion(surfaces, velocity, sigma, f_hd, f_el, V_rate, w, fields, residual, iterations)
        return motion, constraint, charge

    def _held(self, curves: Curve, sigma: VesicleNodes, f_hd: VesiclePoints, velocity: VesiclePoints):
        """What a circle keeps of its motion, and the force and tension that hold its shape; others as they are."""
        round_ = self.is_circle()
        rigid = jax.vmap(rigid_part)(curves, velocity)
        holding = jax.vmap(holding_force)(curves, rigid - velocity)
        along = jnp.sum(holding * curves.tangent, axis=-1) * curves.speed
        return (
            sigma + jnp.where(round_[:, None], fourier.antiderivative(along), 0.0),
            f_hd + jnp.where(round_[:, None, None], holding, 0.0),
            jnp.where(round_[:, None, None], rigid, velocity),
        )

    def _tension(self, surfaces: Surfaces, constraint: Constraint, stretch: VesicleNodes) -> linear.Solution:
        across = surfaces.interactions
        if across is None:
            return jax.vmap(lambda tension, b: tension.solve(b))(constraint.tension, stretch)
        cut = self.filter.surface
        if not self.coupling.direct:

            def respond(across, sigma):
                force = jax.vmap(membrane.linear_tension_force)(surfaces.curves, fourier.low_pass(sigma, cut))
                rate = jax.vmap(membrane.stretch_rate)(surfaces.curves, across.stokes(force))
                return -fourier.low_pass(surfaces.curves.speed * rate, cut)

            return _solve_coupled(constraint.tension, respond, across, stretch)

        tension = self._assembled_tension(surfaces, constraint)
        return tension.solve(stretch.reshape(-1)).reshaped(*stretch.shape)

    def _assembled_tension(self, surfaces: Surfaces, constraint: Constraint) -> linear.AbstractFactoredDense:
        """The factorised stretch of all membranes that all their tensions cause."""
        across = surfaces.interactions

        def block(velocity, target, source):
            return -stretch_response(velocity, target, source, self.filter.surface)

        coupled = across.scattered(jax.vmap(block)(across.velocity, *pair_frames(surfaces.curves)))
        return _assembled(constraint.tension.operator.matrix, coupled)

    def _charge(self, t: Scalar, surfaces: Surfaces, V_m: VesicleNodes, factored: bool):
        field = self.scene.field
        curves = surfaces.curves
        mean = 1.0 / jnp.sum(curves.speed, axis=1, keepdims=True)
        kernel = surfaces.laplace_slp_dn * field.contrast()[:, None, None] + mean[:, None]
        matrices = 0.5 * np.eye(V_m.shape[1]) + kernel * curves.speed[:, None, :]
        flux = curves.normal @ field.E_inf(t) + surfaces.dlp_dn(V_m)
        across = surfaces.interactions
        # A and GMRES need the factors themselves; a lone solve may be iterative.
        solver = self.solver if across is None and not factored else linear.Dense()
        charge = jax.vmap(lambda matrix: solver.factor(linear.LinearOperator(matrix)))(matrices)
        if across is None:
            return jax.vmap(lambda charge, b: charge.solve(b))(charge, flux), charge
        if not self.coupling.direct:

            def respond(across, w):
                return jnp.sum(curves.normal * across.slp_gradient(field.contrast()[:, None] * w), axis=-1)

            return _solve_coupled(charge, respond, across, flux), charge
        target, _ = pair_frames(curves)
        normal = jnp.moveaxis(target.normal, -1, 1)[..., None]
        eta = jnp.repeat(field.contrast(), V_m.shape[1])
        coupled = across.scattered(jnp.sum(normal * across.gradient, axis=1)) * eta
        return _assembled(matrices, coupled).solve(flux.reshape(-1)).reshaped(*flux.shape), charge

    def _traction(self, t: Scalar, surfaces: Surfaces, V_m: VesicleNodes, w: VesicleNodes):
        field = self.scene.field
        slope = surfaces.potential_slope(field.contrast()[:, None] * w, V_m)
        fields = jax.vmap(electric.surface_fields, in_axes=(0, None, 0, 0, 0, 0))(
            surfaces.curves, field.E_inf(t), field.conductivity_ratio, w, V_m, slope
        )
        traction = jax.vmap(electric.maxwell_traction)(surfaces.curves, fields, field.permittivity_ratio)
        return field.stress_scale() * traction, fields

    # -- A ------------------------------------------------------------------------------------

    def freeze(self, t: Scalar, y: Unknowns) -> Frozen:
        """A(y), together with F(y)."""
        motion, constraint, charge = self._motion(t, y, factored=True)
        surfaces = motion.surfaces
        shape = functools.partial(linear_part.frozen_shape, cut=self.filter.x, surface_cut=self.filter.surface)
        A_x = jax.vmap(shape)(surfaces.curves, surfaces.stokes_slp, motion.sigma, self.scene.bending, constraint)
        A_all = None
        if self.coupling is not None and self.coupling.together:
            A_all = self._frozen_together(motion, constraint)
        A_V = None
        if self.scene.field is not None:
            field = self.scene.field
            A_V = jax.vmap(functools.partial(linear_part.frozen_potential, surface_cut=self.filter.surface))(
                surfaces.curves,
                surfaces.laplace_slp,
                charge,
                electric.inner_share(field.conductivity_ratio),
                field.membrane_conductance,
                field.membrane_chi,
            )
        return Frozen(motion, constraint, A_x, A_all, A_V)

    def _frozen_together(self, motion: Motion, constraint: Constraint) -> Float[Array, "n n"]:
        """A_x of all membranes while any are near, else zero."""
        surfaces = motion.surfaces

        def near():
            tension = self._assembled_tension(surfaces, constraint)
            cuts = dict(cut=self.filter.x, surface_cut=self.filter.surface)
            return linear_part.frozen_shapes(surfaces, tension, motion.sigma, self.scene.bending, **cuts)

        size = 2 * motion.sigma.size
        return jax.lax.cond(surfaces.interactions.any_near, near, lambda: jnp.zeros((size, size)))

    # -- constraints --------------------------------------------------------------------------

    def filtered(self, y: Unknowns) -> Unknowns:
        """y without the modes that nothing damps."""
        V_m = None if y.V_m is None else fourier.low_pass(y.V_m, self.filter.surface)
        return Unknowns(fourier.low_pass(y.x, self.filter.x, axis=1), V_m, y.integrals)

    def project(self, y: Unknowns, constraint: Constraint) -> Unknowns:
        """Filter, then one Newton step back to uniform metric and own area, with the operators of `constraint`.

        Quadratic: what a step of order p leaves, of size h^p, comes back as its square. Then the start's symmetries.
        """
        y = self.filtered(y)
        x = y.x + jax.vmap(self._correction)(y.x, self.area, self.speed, constraint)
        if x.shape[0] == 1:
            circles = jax.vmap(nearest_circle)(y.x, self.speed)
            x = jnp.where(self.is_circle()[:, None, None], circles, x)
        return self._symmetric(Unknowns(x, y.V_m, y.integrals))

    def _symmetric(self, y: Unknowns) -> Unknowns:
        """y with the symmetries that a lone vesicle has had from the start."""
        if self.symmetry is None:
            return y
        x, V_m = jax.tree.map(lambda leaf: leaf[0], (y.x, y.V_m))
        x, V_m = jax.tree.map(lambda leaf: leaf[None], self.symmetry.restored(x, V_m))
        return Unknowns(x, V_m, y.integrals)

    def _correction(self, x, area, speed, constraint):
        curve = Curve.from_nodes(x)
        dx = ((area - geometry.area(curve)) / geometry.length(curve)) * curve.normal
        stretch = curve.speed * (membrane.stretch_rate(curve, dx) - (speed - curve.speed) / speed)
        mu = constraint.tension.solve(fourier.low_pass(stretch, self.filter.surface)).value
        return fourier.low_pass(dx + jnp.einsum("aij,j->ia", constraint.spread, mu), self.filter.x, axis=0)

    def settled(self, y: Unknowns) -> Unknowns:
        """y filtered, then projected until metric and area hold to round-off."""

        def once(y, _):
            return self.project(y, self._constraint(Surfaces.of(y.x, electric=False))), None

        return jax.lax.scan(once, self.filtered(y), length=4)[0]

    def with_nodes(self, N: int) -> "Equation":
        """The same with N nodes a membrane, which return to the same areas and perimeters."""
        x = fourier.resample(self.scene.x, N, axis=1)
        scene = eqx.tree_at(lambda s: (s.x, s.V_m), self.scene, (x, None), is_leaf=lambda leaf: leaf is None)
        cut = Filter.for_nodes(N)
        return Equation(scene, self.area, self.speed, cut, self.solver, self.coupling, self.symmetry, self.integrands)

    def start(self) -> Unknowns:
        """The starting state, settled."""
        scene = self.scene
        V_m = None
        if scene.field is not None:
            V_m = jnp.zeros(scene.x.shape[:2]) if scene.V_m is None else scene.V_m
        y = self.settled(Unknowns(scene.x, V_m))
        if self.integrands is not None:
            shapes = jax.eval_shape(lambda y: self.rate(jnp.zeros(()), y), y).integrals
            y = Unknowns(y.x, y.V_m, jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), shapes))
        return y


def equation_for(
    scene: Scene,
    *,
    filter: Filter | None = None,
    solver: linear.AbstractSolver | None = None,
    coupling: AbstractCoupling | None = None,
    integrands=None,
) -> Equation:
    """The equation of a scene; areas and perimeters are those of its starting curves.

    `solver` and `coupling` are chosen by size where they are not given.
    """
    curves = jax.vmap(Curve.from_nodes)(scene.x)
    M, N, _ = scene.x.shape
    if M == 1 or coupling is None:
        coupling = coupling_for(M, N)
    return Equation(
        scene,
        jax.vmap(geometry.area)(curves),
        jax.vmap(geometry.length)(curves) / (2 * np.pi),
        Filter.for_nodes(N) if filter is None else filter,
        linear.for_second_kind(N) if solver is None else solver,
        coupling,
        Symmetry.of(scene) if M == 1 else None,
        integrands,
    )
