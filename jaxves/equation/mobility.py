r"""Velocities of the membranes from forces on the fluid.

All other files use the mobility and not the single layer. Fluids with two viscosities, or walls, can therefore be added
as another mobility.
"""

import abc

import equinox as eqx
import jax

from ..numerics import fourier
from ..numerics.arrays import VesiclePoints
from ..operators.surfaces import Surfaces
from ..potentials.self_stokes import StokesBlocks


class AbstractMobility(eqx.Module):
    """The velocities that forces and an imposed flow cause."""

    @abc.abstractmethod
    def velocity(self, surfaces: Surfaces, force: VesiclePoints, imposed: VesiclePoints | None = None) -> VesiclePoints:
        """Returns the velocity of all nodes (M, N, 2) from forces per arc length and an imposed flow at the nodes.

        It is linear in both together.
        """

    @abc.abstractmethod
    def own(self, surfaces: Surfaces) -> StokesBlocks:
        """Returns the matrices (M, N, N) from |x_α| times a force per arc length to the own velocity."""

    @abc.abstractmethod
    def own_of_derivative(self, surfaces: Surfaces) -> StokesBlocks:
        """Returns `own` times ∂_α (M, N, N): from a density g to the velocity that the force ∂_s g causes."""


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
            # S_yy = log + const - S_xx, and the constant times ∂ is zero, so S_yy ∂ needs no further product.
            return StokesBlocks(xx, xy, log - xx)

        return jax.vmap(of_one)(surfaces.stokes_slp, surfaces.laplace_slp)
