r"""The mobility of two viscosities: the fluid inside a membrane is ν times as viscous as the fluid outside.

    A_ν v = v_∞ + S[f],      A_ν = (1 + ν)/2 - (1 - ν) D,      ν = μ_i/μ_e

D is the Stokes double layer with v on the membrane as its density, S the single layer with the outer viscosity. A_ν⁻¹ S
takes the place of the single layer in all forces, and A_ν⁻¹ v_∞ that of the flow.

A_ν has the eigenvalue 1 on rigid motions, but about (1 + ν)/2 on deformations, and ν on the flux. The code therefore
solves for another velocity z, with the projection P on the rigid motions and m = (1 + ν)/2:

    (1 + γ D°) z = v_∞ + S[f],      v = P z + (z - P z)/m,      γ = 2 (ν - 1)/(ν + 1),      D° = `deflated_dlp`

This is the same equation, because D is -½ on rigid motions and the flux of every solution is zero. γ is between -2 and
2, and the eigenvalues of D° are between -½ and ½. No ν multiplies the errors of the quadrature or round-off.

With several membranes, the double layers of the others, D_j[(1 - ν_j) (v - P v)_j], are added to the right-hand side.
Each membrane then moves, with its own tension, in the flow that the others cause:

    c = C(v, σ),   (v, σ) = own(v_∞ + S[f] + c)

`own` is the motion of every membrane alone, and C the velocity that its motion and its tension cause at the others.
This is one linear system for c, with all velocities and tensions, which GMRES solves. It is preconditioned by the
factors of every membrane, which `own` contains, and by Chebyshev steps with the double layers of near pairs. A very
viscous inside makes these the strongest interactions, and the eigenvalues of C spread from -0.9 to 0.9.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier, krylov, linear
from ..numerics.arrays import PerVesicle, Scalar, VesicleNodes, VesiclePoints
from ..operators.surfaces import Surfaces
from ..physics import membrane
from ..potentials.self_stokes import StokesBlocks
from ..potentials.self_stokes_dlp import RigidPart, deflated_dlp
from .inextensible import Constraint
from .mobility import AbstractInside, AbstractMobility, AbstractResponse, Moved, own_spread


class ViscosityContrast(AbstractMobility):
    """Two viscosities; `ratio` is ν of each vesicle, (M,)."""

    ratio: PerVesicle
    needs_dlp = True

    def at(self, surfaces: Surfaces) -> "ContrastResponse":
        return ContrastResponse(surfaces, jax.vmap(Inside.of)(surfaces.curves, surfaces.stokes_dlp, self.ratio))


class Inside(AbstractInside):
    """The factorised 1 + γ D° of one membrane, its rigid motions, and m."""

    factors: linear.AbstractFactoredDense
    rigid: RigidPart
    slowing: Scalar

    @classmethod
    def of(cls, curve: Curve, stokes_dlp: StokesBlocks, ratio: Scalar) -> "Inside":
        """Factorises for one curve with the kernel of its double layer and ν."""
        rigid = RigidPart.of(curve)
        gamma = 2 * (ratio - 1) / (ratio + 1)
        matrix = jnp.eye(2 * curve.speed.shape[0]) + gamma * deflated_dlp(curve, stokes_dlp, rigid)
        return cls(linear.Dense().factor(linear.LinearOperator(matrix)), rigid, 0.5 * (1 + ratio))

    def slowed(self, z: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Returns P z + (z - P z)/m."""
        rigid = self.rigid(z)
        return rigid + (z - rigid) / self.slowing

    def solve_columns(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        return self.slowed(self.factors.solve_columns(b))


class ContrastResponse(AbstractResponse):
    """The response for two viscosities."""

    surfaces: Surfaces
    inside: Inside

    def velocity(self, force: VesiclePoints, imposed: VesiclePoints | None = None) -> VesiclePoints:
        return self._together(None, self._given(force, imposed), 1)[0]

    def spread(self) -> Float[Array, "M 2 N N"]:
        surfaces = self.surfaces

        def of_one(curve, stokes_slp, laplace_slp, inside):
            spread = own_spread(curve.tangent, stokes_slp, laplace_slp)
            return inside.solve_columns(spread.reshape(-1, spread.shape[-1])).reshape(spread.shape)

        return jax.vmap(of_one)(surfaces.curves, surfaces.stokes_slp, surfaces.laplace_slp, self.inside)

    def moved(self, force, imposed, is_circle, *, cut, direct) -> Moved:
        constraint, given = self.constraint(is_circle, cut), self._given(force, imposed)
        velocity, sigma, solution = self._together(constraint, given, cut)
        f_tension = jax.vmap(membrane.linear_tension_force)(self.surfaces.curves, sigma)
        return Moved(velocity, sigma, f_tension, constraint, [solution])

    def _given(self, force: VesiclePoints, imposed: VesiclePoints | None) -> VesiclePoints:
        """Returns v_∞ + S[f]."""
        velocity = self.surfaces.stokes(force)
        return velocity if imposed is None else velocity + imposed

    def _together(self, constraint: Constraint | None, given: VesiclePoints, cut: int):
        """Returns the velocities, the tensions and the linear solution for `given`; without a constraint σ is zero."""
        if self.surfaces.interactions is None:
            velocity, solution = self._alone(constraint, given, cut)
            return velocity, solution.value, solution

        def own(given):
            velocity, solution = self._alone(constraint, given, cut)
            return velocity, solution.value

        def action(c):
            return c - self._at_others(*own(c.reshape(given.shape))).reshape(-1)

        def precondition(c):
            c, near = c.reshape(given.shape), self.surfaces.double_layers.of_near
            return krylov.chebyshev(lambda x: c + near(self._density(own(x)[0])), c).reshape(-1)

        solver = linear.GMRES(self.surfaces.interactions.tolerance())
        factored = solver.factor(linear.LinearOperator(action=action, precondition=precondition))
        solution = factored.solve(self._at_others(*own(given)).reshape(-1))
        return *own(given + solution.value.reshape(given.shape)), solution

    def _alone(
        self, constraint: Constraint | None, given: VesiclePoints, cut: int
    ) -> tuple[VesiclePoints, linear.Solution]:
        """Returns velocity and tension of every membrane without the others, where S[f] and the flow give `given`."""

        def of_one(inside, given):
            v = inside.solve_columns(given.T.reshape(-1, 1))[:, 0]
            return jnp.stack(jnp.split(v, 2), axis=-1)

        velocity = jax.vmap(of_one)(self.inside, given)
        if constraint is None:
            return velocity, linear.Solution(jnp.zeros(velocity.shape[:2]), jnp.zeros(()), jnp.int32(0))

        def held(curve, velocity, tension, spread):
            stretch = fourier.low_pass(curve.speed * membrane.stretch_rate(curve, velocity), cut)
            solution = tension.solve(stretch)
            return velocity + jnp.einsum("aij,j->ia", spread, solution.value), solution

        return jax.vmap(held)(self.surfaces.curves, velocity, constraint.tension, constraint.spread)

    def _at_others(self, velocity: VesiclePoints, sigma: VesicleNodes) -> VesiclePoints:
        """Returns the velocity that moving membranes with these tensions cause at the nodes of the others."""
        surfaces = self.surfaces
        force = jax.vmap(membrane.linear_tension_force)(surfaces.curves, sigma)
        return surfaces.double_layers(self._density(velocity)) + surfaces.interactions.stokes(force)

    def _density(self, velocity: VesiclePoints) -> VesiclePoints:
        """Returns (1 - ν) (v - P v), the density of the double layers of moving membranes."""

        def of_one(inside, v):
            v = v.T.reshape(-1, 1)
            u = 2 * (1 - inside.slowing) * (v - inside.rigid(v))[:, 0]
            return jnp.stack(jnp.split(u, 2), axis=-1)

        return jax.vmap(of_one)(self.inside, velocity)
