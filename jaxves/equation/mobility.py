r"""Velocities of the membranes from forces on the fluid.

All other files use the mobility and not the single layer. `EqualViscosities` is the mobility of one viscosity;
`contrast` has that of two. Walls can be added as another one.
"""

import abc
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..numerics import fourier, linear
from ..numerics.arrays import NodePoints, VesicleNodes, VesiclePoints
from ..operators.surfaces import Surfaces
from ..physics import membrane
from ..potentials.self_stokes import StokesBlocks
from .inextensible import Constraint, solve_tension, solve_tension_near

_TRANSPOSED = 128  # nodes


class Moved(eqx.Module):
    """The velocity (M, N, 2) of membranes that do not stretch, with the tension σ (M, N) and its force.

    `constraint` has the factors for the tension if they were computed, and `solutions` are the linear solutions.
    """

    velocity: VesiclePoints
    sigma: VesicleNodes
    f_tension: VesiclePoints
    constraint: Constraint | None
    solutions: list[linear.Solution]


class AbstractInside(eqx.Module):
    """The effect of the inner fluid on the motion of one membrane, for a viscosity that differs."""

    @abc.abstractmethod
    def solve_columns(self, b: Float[Array, "n k"]) -> Float[Array, "n k"]:
        """Returns the velocities of the nodes for the velocities b that equal viscosities would give.

        Both have 2N rows, ordered by component, node.
        """


class AbstractResponse(eqx.Module):
    """The velocities that forces and an imposed flow cause at one instant.

    `inside` has the effect of the inner fluid on each membrane; it is None for equal viscosities.
    """

    surfaces: eqx.AbstractVar[Surfaces]
    inside: eqx.AbstractVar[AbstractInside | None]

    @abc.abstractmethod
    def velocity(self, force: VesiclePoints, imposed: VesiclePoints | None = None) -> VesiclePoints:
        """Returns the velocity of all nodes (M, N, 2) from forces per arc length and an imposed flow at the nodes.

        It is linear in both together.
        """

    @abc.abstractmethod
    def spread(self) -> Float[Array, "M 2 N N"]:
        """Returns the matrices from the tension σ of each membrane to its own velocity."""

    def constraint(self, is_circle: Bool[Array, " M"], cut: int) -> Constraint:
        """Returns the constraint of every membrane; `cut` modes are filtered from tensions."""
        return Constraint.of(self.surfaces.curves, self.spread(), is_circle, cut, symmetric=self.inside is None)

    def moved(
        self,
        force: VesiclePoints,
        imposed: VesiclePoints | None,
        is_circle: Bool[Array, " M"],
        *,
        cut: int,
        direct: bool,
        near: linear.AbstractFactoredDense | None = None,
    ) -> Moved:
        """Returns the velocity with the tension that keeps the membranes from stretching; see `solve_tension`.

        Given the factors `near` for the tension of a similar shape, a membrane without interactions uses them to
        iterate (`solve_tension_near`), and there is no constraint in the result.
        """
        curves = self.surfaces.curves
        velocity = self.velocity(force, imposed)
        stretch = fourier.low_pass(curves.speed * jax.vmap(membrane.stretch_rate)(curves, velocity), cut)
        if near is None:
            constraint = self.constraint(is_circle, cut)
            solution = solve_tension(self.surfaces, constraint, stretch, cut=cut, direct=direct)
        else:
            constraint = None
            solution = solve_tension_near(self.surfaces, near, stretch, is_circle, cut=cut)
        f_tension = jax.vmap(membrane.linear_tension_force)(curves, solution.value)
        return Moved(velocity + self.velocity(f_tension), solution.value, f_tension, constraint, [solution])


class AbstractMobility(eqx.Module):
    """The law of motion. `needs_dlp` says whether it needs the Stokes double layer of the membranes."""

    needs_dlp: ClassVar[bool] = False

    @abc.abstractmethod
    def at(self, surfaces: Surfaces) -> AbstractResponse:
        """Returns the response of the membranes at one instant."""


class EqualViscosities(AbstractMobility):
    """One viscosity inside and outside: the velocity is v_∞ + S[f], without a system to solve."""

    def at(self, surfaces: Surfaces) -> "EqualResponse":
        return EqualResponse(surfaces)


class EqualResponse(AbstractResponse):
    """The response for one viscosity."""

    surfaces: Surfaces
    inside: None = None

    def velocity(self, force: VesiclePoints, imposed: VesiclePoints | None = None) -> VesiclePoints:
        velocity = self.surfaces.stokes(force)
        return velocity if imposed is None else velocity + imposed

    def spread(self) -> Float[Array, "M 2 N N"]:
        surfaces = self.surfaces
        return jax.vmap(own_spread)(surfaces.curves.tangent, surfaces.stokes_slp, surfaces.laplace_slp)


def own_spread(
    direction: NodePoints, stokes_slp: StokesBlocks, laplace_slp: Float[Array, "N N"]
) -> Float[Array, "2 N N"]:
    """Returns the matrices from σ to the velocity S[∂_s (σ d)] for directions d (N, 2) at the nodes of one membrane.

    With the tangents this is S T, the velocity from a tension. The weight |x_α| cancels that of ∂_s.
    """
    kernels = stokes_slp.xx, stokes_slp.xy, laplace_slp
    if direction.shape[0] < _TRANSPOSED:
        # ∂_α is antisymmetric, so the rows of S ∂ are minus the derivatives of the rows of S.
        xx, xy, log = (-fourier.derivative(kernel, axis=1) for kernel in kernels)
        tx, ty = direction[:, 0], direction[:, 1]
    else:  # S is symmetric, so that its columns can be used instead, which are faster to transform
        xx, xy, log = (-fourier.derivative(kernel, axis=0) for kernel in kernels)
        tx, ty = direction[:, :1], direction[:, 1:]
    # S_yy = log + const - S_xx, and the constant times ∂ is zero, so S_yy ∂ needs no further product.
    yy = log - xx
    spread = jnp.stack([xx * tx + xy * ty, xy * tx + yy * ty])
    return spread if direction.shape[0] < _TRANSPOSED else jnp.swapaxes(spread, 1, 2)
