r"""The tension that keeps the membrane inextensible: its linear systems, and the velocity it causes.

With the single layer G, T σ = (σ x_s)_s and Q v = x_s·v_s, a velocity u has the stretch rate Q u. The tension
σ = -(Q G T)⁻¹ Q u cancels it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..geometry.curve import Curve
from ..numerics import fourier, linear
from ..numerics.arrays import VesicleNodes
from ..operators.interactions import pair_frames
from ..operators.surfaces import Surfaces
from ..physics import membrane
from ..potentials.self_stokes import StokesBlocks
from .coupled import assembled, solve_coupled


class TensionBlock(eqx.Module):
    """The response of one membrane to its own tension: `spread` = G T (2, N, N), `stiffness` = -|x_α| Q G T (N, N).

    For one viscosity the stiffness is symmetric. With 1 on the diagonal for the filtered modes of σ, it is positive
    definite.
    """

    spread: Float[Array, "2 N N"]
    stiffness: Float[Array, "N N"]

    @classmethod
    def of(
        cls, curve: Curve, spread: Float[Array, "2 N N"], is_circle, cut: int, *, symmetric: bool = True
    ) -> "TensionBlock":
        """Builds the blocks of one membrane from its `spread`; `symmetric` states that G is symmetric to round-off.

        On a circle a uniform tension is a pressure and causes no motion. The mean of σ is then set to zero.
        """
        N = curve.speed.shape[0]
        tx, ty = curve.tangent[:, 0], curve.tangent[:, 1]
        d_x, d_y = (fourier.derivative(part, axis=0) for part in spread)
        stiffness = -(tx[:, None] * d_x + ty[:, None] * d_y)
        pins = fourier.high_modes(N, cut)
        left = pins.T @ stiffness
        right = left.T if symmetric else stiffness @ pins
        stiffness = stiffness - pins @ left - right @ pins.T + pins @ (left @ pins + np.eye(pins.shape[1])) @ pins.T
        return cls(spread, stiffness + jnp.where(is_circle, 1.0 / N, 0.0))


class Constraint(eqx.Module):
    """Inextensibility at one instant, per membrane: the velocity from a tension, and the factorised stiffness."""

    spread: Float[Array, "M 2 N N"]
    tension: linear.AbstractFactoredDense

    @classmethod
    def of(
        cls, curves: Curve, spread: Float[Array, "M 2 N N"], is_circle: Bool[Array, " M"], cut: int, *, symmetric: bool
    ) -> "Constraint":
        """Builds the constraint for each membrane; `cut` modes are filtered from tensions."""
        blocks = jax.vmap(lambda *parts: TensionBlock.of(*parts, cut, symmetric=symmetric))(curves, spread, is_circle)
        return cls(blocks.spread, linear.factor_blocks(blocks.stiffness, positive_definite=symmetric))


def stretch_response(velocity: StokesBlocks, target: Curve, source: Curve, cut: int) -> Float[Array, "N N"]:
    """Returns |x_α| Q S T, from the tension of one membrane to the stretch rate of another, both filtered."""
    D = fourier.derivative_matrix(target.speed.shape[0])
    d_ds = D / source.speed[:, None]
    xx, xy, yy = velocity.xx @ d_ds, velocity.xy @ d_ds, velocity.yy @ d_ds
    tx, ty = source.tangent[:, 0], source.tangent[:, 1]
    rows = target.tangent[:, :1] * (D @ (xx * tx + xy * ty)) + target.tangent[:, 1:] * (D @ (xy * tx + yy * ty))
    return fourier.low_pass_rows(fourier.low_pass_rows(rows, cut).T, cut).T


def solve_tension(
    surfaces: Surfaces, constraint: Constraint, stretch: VesicleNodes, *, cut: int, direct: bool
) -> linear.Solution:
    """Solves for the tensions (M, N) that cancel a stretch rate; `stretch` (M, N) is |x_α| times this rate.

    `cut` modes are filtered from tensions. With `direct`, the coupled system is factorised and not solved by GMRES.
    """
    across = surfaces.interactions
    if across is None:
        return jax.vmap(lambda tension, b: tension.solve(b))(constraint.tension, stretch)
    if direct:
        tension = assembled_tension(surfaces, constraint, cut)
        return tension.solve(stretch.reshape(-1)).reshaped(*stretch.shape)

    def respond(across, sigma):
        force = jax.vmap(membrane.linear_tension_force)(surfaces.curves, fourier.low_pass(sigma, cut))
        rate = jax.vmap(membrane.stretch_rate)(surfaces.curves, across.stokes(force))
        return -fourier.low_pass(surfaces.curves.speed * rate, cut)

    return solve_coupled(constraint.tension, respond, across, stretch)


def solve_tension_near(
    surfaces: Surfaces,
    near: linear.AbstractFactoredDense,
    stretch: VesicleNodes,
    is_circle: Bool[Array, " M"],
    *,
    cut: int,
) -> linear.Solution:
    """Returns what `solve_tension` returns for membranes without interactions, by GMRES and without matrices.

    The factors `near` of the stiffness of similar shapes are the preconditioner. For the stages of a step these are
    those of its start, with which 2 to 6 iterations are enough.
    """

    def of_one(curve, slp, near, b, is_circle):
        def action(sigma):
            low = fourier.low_pass(sigma, cut)
            rate = curve.speed * membrane.stretch_rate(
                curve, slp @ (curve.speed[:, None] * membrane.linear_tension_force(curve, low))
            )
            return sigma - low - fourier.low_pass(rate, cut) + jnp.where(is_circle, jnp.mean(low), 0.0)

        operator = linear.LinearOperator(action=action, precondition=lambda v: near.solve_columns(v[:, None])[:, 0])
        return linear.GMRES().factor(operator).solve(b)

    near = jax.lax.stop_gradient(near)
    return jax.vmap(of_one)(surfaces.curves, surfaces.stokes_slp, near, stretch, is_circle)


def assembled_tension(surfaces: Surfaces, constraint: Constraint, cut: int) -> linear.AbstractFactoredDense:
    """Returns the factorised matrix from all tensions to all stretch rates, from the matrices of all pairs."""
    pairs = surfaces.interactions.matrices()

    def block(velocity, target, source):
        return -stretch_response(velocity, target, source, cut)

    coupled = pairs.scattered(jax.vmap(block)(pairs.velocity, *pair_frames(surfaces.curves)))
    return assembled(constraint.tension.operator.matrix, coupled)
