r"""The equation of motion dy/dt = F(t, y) for y = (x, scalars), its linear part A for implicit steps, its constraints.

    dx/dt   = v_∞ + S[f_hd],     f_hd = -κ_B x_ssss + (σ x_s)_s - f_el,     x_s · (dx/dt)_s = 0

With two viscosities the velocity is A_ν⁻¹ times this sum (`contrast`).
The electric model gives the rates of the scalars, such as dV_m/dt. F solves for the tension σ and the charge at every
evaluation. The factors of these systems are also used in A.

Spectral derivatives of the Nyquist mode vanish, so nothing would damp this mode. It is removed from σ and the scalars.
A wider band is removed from x, because a σ without the Nyquist mode cannot prevent stretching just below it. This file
does not depend on the time stepping.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Free
from ..numerics import fourier, linear
from ..numerics.arrays import PerVesicle, Scalar
from ..operators.interactions import AbstractCoupling
from ..operators.surfaces import Surfaces
from ..physics import membrane, rigid
from ..physics.scene import Scene
from ..potentials.self_refined import Refinement
from . import cells, linear_part, projection
from .averaged_charging import electrics_for
from .contrast import ViscosityContrast
from .coupled import worst
from .electrics import AbstractElectrics
from .implicit import Frozen, Implicit
from .inextensible import Constraint, assembled_tension
from .mobility import AbstractMobility, EqualViscosities
from .projection import Filter
from .shape_block import shape_blocks
from .staged_charging import AbstractStagedCharging
from .state import Motion, Unknowns
from .symmetry import Symmetry

_MANY = 256  # nodes from which stages solve for the tension by iteration
_LARGEST = 1e-9  # residual of the tension in a stage; a step with a larger one is refused


class Equation(eqx.Module):
    """F, A and the constraints for one scene.

    The projection restores `area` (M,) and `speed` (M,), the arc length per unit of α. `electrics` is None without a
    field, `coupling` is None for a single membrane, and `symmetry` is None if no symmetry is kept. `integrands` is a
    function (Motion, Scene, t) -> dict of the integrands of running integrals, or None. `nearby` is set by `near`.
    """

    scene: Scene
    area: PerVesicle
    speed: PerVesicle
    filter: Filter
    electrics: AbstractElectrics | None
    mobility: AbstractMobility
    coupling: AbstractCoupling | None
    symmetry: Symmetry | None
    refinement: Refinement
    domain: AbstractDomain
    integrands: object = eqx.field(static=True, default=None)
    nearby: linear.AbstractFactoredDense | None = None

    @property
    def is_alone(self) -> bool:
        """Whether there is a single membrane in free space. It may be a circle, and its symmetries are kept."""
        return self.coupling is None and isinstance(self.domain, Free)

    @property
    def is_staged(self) -> bool:
        """Whether the scalars are solved for within the stages of a step, by `stage`."""
        return isinstance(self.electrics, AbstractStagedCharging)

    def kept(self) -> dict[str, PerVesicle]:
        """Returns the areas and perimeters, which are conserved, by the names of the diagnostics."""
        return {"area": self.area, "length": 2 * np.pi * self.speed}

    def is_circle(self) -> Array:
        """Returns which vesicles are circles, to round-off; (M,) booleans."""
        return self.area > (1 - 1e-10) * jnp.pi * self.speed**2

    # -- F ------------------------------------------------------------------------------------

    def motion(self, t: Scalar, y: Unknowns) -> Motion:
        """Returns F(y) together with all quantities at this instant."""
        return self._motion(t, y, factored=False)[0]

    def rate(self, t: Scalar, y: Unknowns) -> Unknowns:
        """Returns F(y). It is NaN if there are too many near pairs, or if `nearby` shapes are not near enough."""
        return self._sound_rate(t, self.motion(t, y))

    def _sound_rate(self, t: Scalar, motion: Motion) -> Unknowns:
        rate = self._rate(t, motion)
        across = motion.surfaces.interactions
        if self.nearby is None and (across is None or across.crowded is None):
            return rate
        limit = jnp.inf if self.nearby is None else _LARGEST
        return jax.tree.map(lambda leaf: jnp.where(motion.residual < limit, leaf, jnp.nan), rate)

    def near(self, frozen: Frozen) -> "Equation":
        """Returns the same equation for shapes near that of `frozen`, whose factors help to solve for the tension.

        A single membrane with many nodes and one viscosity then needs no matrix for its tension.
        """
        if self.scene.x.shape[1] < _MANY or self.coupling is not None or self.mobility.needs_dlp:
            return self
        return eqx.tree_at(lambda e: e.nearby, self, frozen.constraint.tension, is_leaf=lambda leaf: leaf is None)

    def rate_of(self, frozen: Frozen, t: Scalar) -> Unknowns:
        """Returns F(y) at the instant of `frozen`, without computing it again."""
        return self._rate(t, frozen.motion)

    def stage(self, solver: Implicit, t: Scalar, y: Unknowns, r: Unknowns, c: Scalar) -> tuple[Unknowns, Unknowns]:
        """Returns the increment d of a stage at time t, and F(y + d), for an equation that `is_staged`.

        The shapes have d = r + c A d, by `solver`. The scalars have d = r + c F(y + d).
        """
        dx = solver.x.solve(r.x)
        start = jax.tree.map(jnp.add, y.scalars, r.scalars)
        motion, *_ = self._motion(t, Unknowns(y.x + dx, start), factored=False, c=c)
        scalars = jax.tree.map(lambda r, rate: r + c * rate, r.scalars, motion.rates)
        return Unknowns(dx, scalars, r.integrals), self._sound_rate(t, motion)

    def _rate(self, t: Scalar, motion: Motion) -> Unknowns:
        integrals = {} if self.integrands is None else self.integrands(motion, self.scene, t)
        return Unknowns(motion.velocity, motion.rates, integrals)

    def _surfaces(self, t: Scalar, y: Unknowns) -> Surfaces:
        how = dict(coupling=self.coupling, domain=self.domain.at(t), refinement=self.refinement)
        return Surfaces.of(y.x, electric=self.electrics is not None, contrast=self.mobility.needs_dlp, **how)

    def _motion(self, t: Scalar, y: Unknowns, *, factored: bool, c: Scalar | None = None):
        """Returns F, and what A needs: the constraint, the factors of A_ν, those of the charge (only if `factored`).

        Given c, the scalars of y are those from which the scalars s of a stage are solved for, s = y + c s'.
        """
        scene, surfaces = self.scene, self._surfaces(t, y)
        curves = surfaces.curves
        direct = self.coupling is not None and self.coupling.direct
        solutions = []

        force = jax.vmap(membrane.linear_bending_force)(curves, scene.bending)
        electric = charge = None
        if self.electrics is not None:
            with jax.named_scope("electric"):
                if c is None:
                    electric, solution, charge = self.electrics.solve(
                        t, surfaces, y.scalars, direct=direct, factored=factored
                    )
                else:
                    electric, solution = self.electrics.solve_stage(t, surfaces, y.scalars, c, direct=direct)
                solutions.append(solution)
                force = force - electric.traction
        imposed = None if scene.flow is None else scene.flow.velocity(y.x, t)
        response = self.mobility.at(surfaces)
        near = {} if factored or self.nearby is None else {"near": self.nearby}
        moved = response.moved(force, imposed, self.is_circle(), cut=self.filter.surface, direct=direct, **near)
        solutions += moved.solutions
        sigma, f_tension = moved.sigma, moved.f_tension
        velocity = fourier.low_pass(moved.velocity, self.filter.x, axis=1)
        f_hd = force + f_tension
        if self.is_alone:
            sigma, f_hd, velocity = jax.lax.cond(
                jnp.any(self.is_circle()),
                lambda *found: jax.vmap(rigid.held)(curves, *found, scene.viscosity_ratio),
                lambda *found: found,
                sigma,
                f_hd,
                velocity,
            )
        rates = {} if electric is None else self.electrics.rates(electric, y.scalars, velocity)
        residual, iterations = worst(solutions, surfaces)
        motion = Motion(surfaces, velocity, sigma, f_hd, electric, rates, residual, iterations)
        return motion, moved.constraint, response.inside, charge

    # -- A ------------------------------------------------------------------------------------

    def freeze(self, t: Scalar, y: Unknowns) -> Frozen:
        """Returns A(y) together with F(y)."""
        motion, constraint, inside, charge = self._motion(t, y, factored=True)
        surfaces = motion.surfaces
        A_x = shape_blocks(surfaces, motion.sigma, self.scene.bending, constraint, inside, self.filter)
        A_all = None
        # With two viscosities the interactions are not part of A: one matrix for all shapes would need D of all pairs.
        if self.coupling is not None and self.coupling.together and inside is None:
            A_all = self._all_shapes(motion, constraint)
        if self.electrics is None:
            return Frozen(motion, constraint, A_x, A_all, None)
        A_scalars = self.electrics.linear_part(surfaces, charge)
        below = self.electrics.shape_part(surfaces, motion.electric, y.scalars, charge)
        return Frozen(motion, constraint, A_x, A_all, A_scalars, below)

    def _all_shapes(self, motion: Motion, constraint: Constraint) -> Float[Array, "n n"]:
        """Returns A_x of all membranes as one matrix if any are near, otherwise zero."""
        surfaces = motion.surfaces

        def near():
            tension = assembled_tension(surfaces, constraint, self.filter.surface)
            cuts = dict(cut=self.filter.x, surface_cut=self.filter.surface)
            return linear_part.shape_matrix(surfaces, tension, motion.sigma, self.scene.bending, **cuts)

        size = 2 * motion.sigma.size
        return jax.lax.cond(surfaces.interactions.any_near(), near, lambda: jnp.zeros((size, size)))

    # -- constraints --------------------------------------------------------------------------

    def filtered(self, y: Unknowns) -> Unknowns:
        """Returns y without the modes that nothing damps."""
        return projection.filtered(y, self.filter)

    def project(self, y: Unknowns, constraint: Constraint) -> Unknowns:
        """Filters, and makes one Newton step to uniform metric and conserved area, with the operators of `constraint`.

        It converges quadratically: an error of size h^p after a step of order p becomes its square. A single circle,
        and the symmetries of a single vesicle, are restored exactly.
        """
        y = self.filtered(y)
        x = projection.corrected(y.x, self.area, self.speed, constraint, self.filter)
        if self.is_alone:
            circles = jax.vmap(rigid.nearest_circle)(y.x, self.speed)
            x = jnp.where(self.is_circle()[:, None, None], circles, x)
        return projection.symmetric(Unknowns(x, y.scalars, y.integrals), self.symmetry)

    def settled(self, y: Unknowns) -> Unknowns:
        """Filters y, and projects it until metric and area are right to round-off.

        The operators of the projection decide how fast it converges, not the result. Grids are therefore not refined.
        """

        def once(y, _):
            needs_dlp = self.mobility.needs_dlp
            surfaces = Surfaces.of(y.x, electric=False, contrast=needs_dlp, refinement=Refinement((1,)))
            constraint = self.mobility.at(surfaces).constraint(self.is_circle(), self.filter.surface)
            return self.project(y, constraint), None

        return jax.lax.scan(once, self.filtered(y), length=4)[0]

    def with_nodes(self, N: int) -> "Equation":
        """Returns the same equation with N nodes per membrane, with the same areas and perimeters."""
        x = fourier.resample(self.scene.x, N, axis=1)
        scene = eqx.tree_at(lambda s: (s.x, s.V_m), self.scene, (x, None), is_leaf=lambda leaf: leaf is None)
        parts = scene, Filter.for_nodes(N), Refinement.for_nodes(N)
        return eqx.tree_at(lambda e: (e.scene, e.filter, e.refinement), self, parts)

    def start(self) -> Unknowns:
        """Returns the starting state, filtered and projected."""
        scene = self.scene
        scalars = {}
        if self.electrics is not None:
            scalars = self.electrics.start(scene, lambda: self._surfaces(jnp.zeros(()), Unknowns(scene.x)))
        y = self.settled(Unknowns(scene.x, scalars))
        if self.integrands is not None:
            shapes = jax.eval_shape(lambda y: self.rate(jnp.zeros(()), y), y).integrals
            y = Unknowns(y.x, y.scalars, jax.tree.map(lambda leaf: jnp.zeros(leaf.shape), shapes))
        return y


def equation_for(
    scene: Scene,
    *,
    filter: Filter | None = None,
    solver: linear.AbstractSolver | None = None,
    coupling: AbstractCoupling | None = None,
    refinement: Refinement | None = None,
    keep_symmetry: bool = True,
    integrands=None,
) -> Equation:
    """Builds the equation of a scene. Areas and perimeters are those of its starting curves.

    Args:
        scene: the scene.
        filter: the modes that are removed; the default depends on the number of nodes.
        solver: solver for the charge of one membrane; the default depends on the number of nodes.
        coupling: interactions of several membranes; the default depends on their size (`cells.coupling_of`).
        refinement: finer grids where a membrane comes close to itself; the default depends on the number of nodes.
        keep_symmetry: whether a single vesicle that starts symmetric is kept symmetric (`cells.may_keep_symmetry`).
        integrands: integrands of running integrals, a function (Motion, Scene, t) -> dict.
    """
    curves = jax.vmap(Curve.from_nodes)(scene.x)
    M, N, _ = scene.x.shape
    filter = Filter.for_nodes(N) if filter is None else filter
    solver = linear.for_second_kind(N) if solver is None else solver
    return Equation(
        scene,
        jax.vmap(geometry.area)(curves),
        jax.vmap(geometry.length)(curves) / (2 * np.pi),
        filter,
        electrics_for(scene, solver, filter.surface),
        EqualViscosities() if scene.viscosity_ratio is None else ViscosityContrast(scene.viscosity_ratio),
        cells.coupling_of(scene, coupling),
        Symmetry.of(scene) if M == 1 and keep_symmetry and cells.may_keep_symmetry(scene) else None,
        Refinement.for_nodes(N) if refinement is None else refinement,
        cells.domain_of(scene),
        integrands,
    )
