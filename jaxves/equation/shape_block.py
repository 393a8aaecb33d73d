r"""The linear part A for the shape of one membrane, on as many unknowns as it has nodes.

    A_x = P G K,     K = -κ_B ∂_s⁴ + ∂_s σ ∂_s,     P = 1 - G T (Q G T)⁻¹ Q

G is the single layer S or, with two viscosities, A_ν⁻¹ S. P G has only velocities that do not stretch the membrane.
Such a velocity is given by its normal component u, whose mean is zero because the fluid is incompressible, and by one
uniform slip c along the membrane:

    Z(u, c) = u n + (c - ∂_s⁻¹(κ u)) t,     P G = Z M Zᵀ,     M = F₀ᵀ P G F₀

where F₀ is any matrix with F₀ᵀ Z = 1. Here F₀ᵀ v = n·v + (mean of t·v), and c takes the place of the mean of u. With
d = r + Z ζ, the system (1 - c A_x) d = r for 2N unknowns becomes (1 - c M Zᵀ K Z) ζ = c M Zᵀ K r for N unknowns.

The discretised operators have these properties to spectral accuracy, as far as the curve is resolved. The metric is
taken as uniform, because the projection keeps it so. `cut` modes are removed from x, `surface_cut` modes from tensions.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix, NodePoints, Nodes, Scalar
from ..potentials.self_stokes import StokesBlocks
from .inextensible import Constraint
from .mobility import AbstractInside


def elastic_matrix(curve: Curve, sigma: Nodes, bending: Scalar, cut: int) -> NodeMatrix:
    """Returns the matrix of -κ_B ∂_s⁴ + ∂_s σ ∂_s for one component of x."""
    speed = jnp.mean(curve.speed)
    bend, slope = fourier.elastic_matrices(sigma.shape[0], cut)
    return (-bending / speed**4) * bend + fourier.derivative((sigma / speed**2)[:, None] * slope, axis=0)


class ShapeBlock(eqx.Module):
    """A_x of one membrane: `stiffness` = |x_α| K, the mobility M, and `rates` = M Zᵀ |x_α| K Z, all (N, N).

    `frame` (2, N, 2) has the normals and the tangents, and `turn` is |x_α| κ.
    """

    frame: Float[Array, "2 N 2"]
    turn: Nodes
    stiffness: NodeMatrix
    mobility: NodeMatrix
    rates: NodeMatrix
    cut: int = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        curve: Curve,
        slp: StokesBlocks,
        sigma: Nodes,
        bending: Scalar,
        constraint: Constraint,
        inside: AbstractInside | None,
        *,
        cut: int,
        surface_cut: int,
    ) -> "ShapeBlock":
        """Builds A_x of one membrane.

        `slp` is its single layer, and `inside` the effect of the inner fluid, or None for equal viscosities.
        """
        speed = jnp.mean(curve.speed)
        K = speed * elastic_matrix(curve, sigma, bending, cut)
        M = _mobility(curve, slp, constraint, inside, surface_cut)
        frame = jnp.stack([curve.normal, curve.tangent])
        turn = speed * curve.curvature
        forces = _transposed(K[:, None, :] * jnp.einsum("pia,qja->piqj", frame, frame), turn)
        return cls(frame, turn, K, M, M @ _transposed(forces.T.swapaxes(0, 1), turn).T, cut)

    def shifted(self, c: Scalar) -> NodeMatrix:
        """Returns the matrix 1 - c M Zᵀ K Z of the system for ζ."""
        return jnp.eye(self.turn.shape[0]) - c * self.rates

    def load(self, r: NodePoints) -> Nodes:
        """Returns M Zᵀ K r."""
        return self.mobility @ _transposed(jnp.sum(self.frame * (self.stiffness @ r), axis=-1), self.turn)

    def moved(self, zeta: Nodes) -> NodePoints:
        """Returns the velocity Z ζ of the nodes, filtered."""
        slip = jnp.mean(zeta)
        u = zeta - slip
        parts = jnp.stack([u, slip - fourier.antiderivative(self.turn * u)])
        return fourier.low_pass(jnp.einsum("pi,pia->ia", parts, self.frame), self.cut, axis=0)


def _transposed(f: Float[Array, "2 N *rest"], turn: Nodes) -> Float[Array, "N *rest"]:
    """Returns Zᵀ f, from the normal and the tangential component of f."""
    normal, tangential = f
    found = normal + turn.reshape((-1,) + (1,) * (normal.ndim - 1)) * fourier.antiderivative(tangential, axis=0)
    return found + jnp.mean(tangential - found, axis=0)


def _mobility(
    curve: Curve, slp: StokesBlocks, constraint: Constraint, inside: AbstractInside | None, surface_cut: int
) -> NodeMatrix:
    """Returns M = F₀ᵀ P G F₀."""
    (nx, ny), N = curve.normal.T, curve.normal.shape[0]
    slipping = slp @ (curve.tangent / N)
    pulled = _coordinates(curve, constraint.spread)  # F₀ᵀ G T
    if inside is None:
        slip = jnp.sum(curve.normal * slipping, axis=-1) + 0.5 * jnp.sum(curve.tangent * slipping) / N
        mixed = nx[:, None] * slp.xy * ny
        free = nx[:, None] * slp.xx * nx + ny[:, None] * slp.yy * ny + mixed + mixed.T + slip[:, None] + slip
        stretch = -pulled.T  # G is symmetric, so Q G is the transpose of G T
    else:
        x = slp.xx * nx + slp.xy * ny + slipping[:, :1]
        y = slp.xy * nx + slp.yy * ny + slipping[:, 1:]
        moved = inside.solve_columns(jnp.concatenate([x, y])).reshape(2, N, N)
        free = _coordinates(curve, moved)
        stretch = jnp.einsum("ia,aij->ij", curve.tangent, fourier.derivative(moved, axis=1))
    return free + pulled @ constraint.tension.solve_columns(fourier.low_pass_rows(stretch, surface_cut))


def _coordinates(curve: Curve, v: Float[Array, "2 N k"]) -> Float[Array, "N k"]:
    """Returns F₀ᵀ v of velocities v."""
    normal = jnp.einsum("ia,aik->ik", curve.normal, v)
    return normal + jnp.einsum("ia,aik->k", curve.tangent, v) / normal.shape[0]
