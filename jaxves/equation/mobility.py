r"""From forces on the fluid to velocities of the membranes.

Everything else asks the mobility and not the single layer, so that fluids of two viscosities, or walls, are another
mobility.
"""

import abc

import equinox as eqx
import jax

from ..numerics import fourier
from ..numerics.arrays import VesiclePoints
from ..operators.surfaces import Surfaces
from ..potentials.self_stokes import StokesBlocks


class AbstractMobility(eqx.Module):
    """Velocities that forces and an imposed flow cause."""

    @abc.abstractmethod
    def velocity(self, surfaces: Surfaces, force: VesiclePoints, imposed: VesiclePoints | None = None) -> VesiclePoints:
        """Velocity of all nodes, (M, N, 2), from forces per arc length on the fluid and an imposed flow at the nodes.

        It is linear in both together.
        """

    @abc.abstractmethod
    def own(self, surfaces: Surfaces) -> StokesBlocks:
        """Of every membrane by itself, (M, N, N): from |x_α| times a force per arc length to its velocity."""

    @abc.abstractmethod
    def own_of_derivative(self, surfaces: Surfaces) -> StokesBlocks:
        """`own` times ∂_α: from a density g to the velocity that the force ∂_s g causes, (M, N, N)."""


class EqualViscosities(AbstractMobility):
    """One viscosity inside and outside: the velocity is v_∞ + S[f], without a system to solve."""

    def velocity(self, surfaces: Surfaces, force: VesiclePoints, imposed: VesiclePoints | None = None) -> VesiclePoints:
        velocity = surfaces.stokes(force)
        return velocity if imposed is None else velocity + imposed

    def own(self, surfaces: Surfaces) -> StokesBlocks:
        return surfaces.stokes_slp

    def own_of_derivative(self, surfaces: Surfaces) -> StokesBlocks:
        D = fourier.derivative_matrix(surfaces.curves.speed.shape[1])

        def of_one(stokes_slp, laplace_slp):
            xx, xy, log = stokes_slp.xx @ D, stokes_slp.xy @ D, laplace_slp @ D
            # S_yy = log + const - S_xx, and ∂ leaves no mean: S_yy ∂ needs no product of its own.
            return StokesBlocks(xx, xy, log - xx)

        return jax.vmap(of_one)(surfaces.stokes_slp, surfaces.laplace_slp)
