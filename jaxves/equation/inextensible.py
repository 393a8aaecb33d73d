r"""Tension as what keeps the length of every piece of membrane: the stretch it causes, and how it moves the nodes.

With G the single layer, T σ = (σ x_s)_s and Q v = x_s·v_s, a stretch Q u is undone by σ = -(Q G T)⁻¹ Q u.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..geometry.curve import Curve
from ..numerics import fourier, linear
from ..operators.surfaces import Surfaces
from ..potentials.self_stokes import StokesBlocks


class TensionBlock(eqx.Module):
    """One membrane's response to its own tension: G T (2, N, N), and -|x_α| Q G T (N, N).

    The second is symmetric and, with the modes of σ that are filtered pinned, positive definite.
    """

    spread: Float[Array, "2 N N"]
    stiffness: Float[Array, "N N"]

    @classmethod
    def of(cls, curve: Curve, laplace_slp, stokes_slp, is_circle, cut: int) -> "TensionBlock":
        """From the kernels of one membrane, whose weight |x_α| cancels that of ∂_s.

        On a circle a uniform tension is a pressure and moves nothing: the gauge is mean σ = 0.
        """
        N = curve.speed.shape[0]
        D = fourier.derivative_matrix(N)
        xx, xy, log = stokes_slp.xx @ D, stokes_slp.xy @ D, laplace_slp @ D
        # G_yy = S + const - G_xx, and ∂ leaves no mean: G_yy ∂ needs no product of its own.
        yy = log - xx
        tx, ty = curve.tangent[:, 0], curve.tangent[:, 1]
        spread = jnp.stack([xx * tx + xy * ty, xy * tx + yy * ty])
        stiffness = -(tx[:, None] * (D @ spread[0]) + ty[:, None] * (D @ spread[1]))
        pins = fourier.high_modes(N, cut)
        left = pins.T @ stiffness
        stiffness = stiffness - pins @ left - left.T @ pins.T + pins @ (left @ pins + np.eye(pins.shape[1])) @ pins.T
        return cls(spread, stiffness + jnp.where(is_circle, 1.0 / N, 0.0))


class Constraint(eqx.Module):
    """Inextensibility at one instant, per membrane: how tension moves it, and the factorised stretch it causes."""

    spread: Float[Array, "M 2 N N"]
    tension: linear.AbstractFactored

    @classmethod
    def of(cls, surfaces: Surfaces, is_circle: Bool[Array, " M"], cut: int) -> "Constraint":
        """Of each membrane by itself; `cut` modes are filtered from tensions."""
        blocks = jax.vmap(lambda *parts: TensionBlock.of(*parts, cut))(
            surfaces.curves, surfaces.laplace_slp, surfaces.stokes_slp, is_circle
        )
        return cls(blocks.spread, linear.factor_blocks(blocks.stiffness, positive_definite=True))


def stretch_response(velocity: StokesBlocks, target: Curve, source: Curve, cut: int) -> Float[Array, "N N"]:
    """|x_α| Q S T from the tension of one membrane to the stretch of another, without the modes filtered from both."""
    D = fourier.derivative_matrix(target.speed.shape[0])
    d_ds = D / source.speed[:, None]
    xx, xy, yy = velocity.xx @ d_ds, velocity.xy @ d_ds, velocity.yy @ d_ds
    tx, ty = source.tangent[:, 0], source.tangent[:, 1]
    rows = target.tangent[:, :1] * (D @ (xx * tx + xy * ty)) + target.tangent[:, 1:] * (D @ (xy * tx + yy * ty))
    return fourier.low_pass_rows(fourier.low_pass_rows(rows, cut).T, cut).T
