r"""The mobility of two viscosities: the fluid inside a membrane is ν times as viscous as the fluid outside.

    A_ν v = v_∞ + S[f],      A_ν = (1 + ν)/2 - (1 - ν) D,      ν = μ_i/μ_e

D is the Stokes double layer with v on the membrane as its density, S the single layer with the outer viscosity. A_ν⁻¹ S
takes the place of the single layer in all forces, and A_ν⁻¹ v_∞ that of the flow.

A_ν has the eigenvalue 1 on rigid motions, but about (1 + ν)/2 on deformations, and ν on the flux. The code therefore
solves for another velocity z, with the projection P on the rigid motions and m = (1 + ν)/2:

    (1 + γ D°) z = v_∞ + S[f],      v = P z + (z - P z)/m,      γ = 2 (ν - 1)/(ν + 1),      D° = `deflated_dlp`

This is the same equation, because D is -½ on rigid motions and the flux of every solution is zero. γ is between -2 and
2, and the eigenvalues of D° are between -½ and ½. No ν multiplies the errors of the quadrature or round-off.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import linear
from ..numerics.arrays import PerVesicle, Scalar, VesiclePoints
from ..operators.surfaces import Surfaces
from ..potentials.self_stokes import StokesBlocks
from ..potentials.self_stokes_dlp import RigidPart, deflated_dlp
from .mobility import AbstractInside, AbstractMobility, AbstractResponse, own_spread


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
        b = self._given(force, imposed)
        return _points(jax.vmap(lambda inside, b: inside.solve_columns(b[:, None])[:, 0])(self.inside, b))

    def spread(self) -> Float[Array, "M 2 N N"]:
        surfaces = self.surfaces

        def of_one(curve, stokes_slp, laplace_slp, inside):
            spread = own_spread(curve, stokes_slp, laplace_slp)
            return inside.solve_columns(spread.reshape(-1, spread.shape[-1])).reshape(spread.shape)

        return jax.vmap(of_one)(surfaces.curves, surfaces.stokes_slp, surfaces.laplace_slp, self.inside)

    def _given(self, force: VesiclePoints, imposed: VesiclePoints | None) -> Float[Array, "M n"]:
        """Returns v_∞ + S[f], ordered by component, node."""
        velocity = self.surfaces.stokes(force)
        velocity = velocity if imposed is None else velocity + imposed
        return jnp.swapaxes(velocity, 1, 2).reshape(force.shape[0], -1)


def _points(v: Float[Array, "M n"]) -> VesiclePoints:
    """Returns velocities as (M, N, 2), from the order component, node."""
    return jnp.swapaxes(v.reshape(v.shape[0], 2, -1), 1, 2)
