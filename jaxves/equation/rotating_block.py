r"""The linear part A for the shape of one membrane with many nodes, as a system of N + 2 unknowns.

A velocity v that does not stretch the membrane has ∂_α v = β n + ν t. β is the rate at which the tangent turns. ν has
the two modes that the tension does not control: the Nyquist mode and, on a circle, the mean. With ζ = (β, ν) and
Pᵀ ζ = β n + ν t this is

    v = ∂_α⁻¹ Pᵀ ζ + mean

The response P G of `shape_block` is symmetric. A step with A d = P G K d then solves

    (1 - c M B) ζ = c M g,     d = r + ∂_α⁻¹ Pᵀ ζ + mean,     M = P ∂_α (P G) ∂_αᵀ Pᵀ

for N + 2 rates instead of 2N displacements. With the elastic operator K = -κ_B ∂_s⁴ + ∂_s σ ∂_s, two derivatives of K
cancel against ∂_α⁻¹ on both sides, so that B = P (κ_B ∂_s² - σ) Pᵀ up to a factor, and g = P (κ_B ∂_s³ - σ ∂_s) r.

These are the discretised operators of `shape_block` without any approximation, so that d is the same to round-off. Its
cost is 7 N³ operations instead of 29 N³. Two viscosities have a response that is not symmetric.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier, linear
from ..numerics.arrays import NodePoints, Nodes, Scalar
from ..potentials.self_stokes import StokesBlocks
from .inextensible import Constraint
from .mobility import own_spread


class Rotations(eqx.Module):
    """The frame of one membrane, with the elastic operator on it."""

    curve: Curve
    sigma: Nodes
    bending: Scalar
    cut: int = eqx.field(static=True)
    surface_cut: int = eqx.field(static=True)

    def free(self) -> Float[Array, "N m"]:
        """Returns an orthonormal basis of the modes that the tension does not control."""
        N = self.sigma.shape[0]
        return jnp.concatenate([fourier.high_modes(N, self.surface_cut), jnp.full((N, 1), N**-0.5)], axis=1)

    def along(self, rates: Float[Array, "n k"]) -> Float[Array, "N 2 k"]:
        """Returns Pᵀ ζ = β n + ν t for k columns ζ."""
        N = self.sigma.shape[0]
        nu = self.free() @ rates[N:]
        return self.curve.normal[..., None] * rates[:N, None] + self.curve.tangent[..., None] * nu[:, None]

    def across(self, vectors: Float[Array, "N 2 k"]) -> Float[Array, "n k"]:
        """Returns P applied to k vectors at the nodes, the transpose of `along`."""
        tangential = _product(self.curve.tangent, vectors)
        return jnp.concatenate([_product(self.curve.normal, vectors), self.free().T @ tangential])

    def _symbols(self):
        N = self.sigma.shape[0]
        slope, kept = fourier.derivative_symbol(N), fourier.low_pass_symbol(N, self.cut)
        return slope, kept, jnp.mean(self.curve.speed)

    def bent(self, rates: Float[Array, "n k"], *, transposed: bool = False) -> Float[Array, "n k"]:
        """Returns B ζ, or Bᵀ ζ, for k columns."""
        slope, kept, speed = self._symbols()
        moving = kept * (slope != 0)  # without the mean
        vectors = self.along(rates)
        stretched = self.sigma[:, None, None]
        if transposed:
            pulled = fourier.multiply(stretched * _inner(vectors), moving, axis=0)
        else:
            pulled = _inner(stretched * fourier.multiply(vectors, moving, axis=0))
        bent = fourier.multiply(vectors, slope**2 * kept, axis=0)
        return self.across((self.bending / speed**3) * bent - pulled / speed)

    def loaded(self, r: NodePoints) -> Float[Array, "n"]:
        """Returns g from displacements r."""
        slope, kept, speed = self._symbols()
        bent = fourier.multiply(r, slope**3 * kept, axis=0)
        pulled = _inner(self.sigma[:, None] * fourier.multiply(r, slope * kept, axis=0))
        return self.across(((self.bending / speed**3) * bent - pulled / speed)[..., None])[:, 0]


def _product(d: NodePoints, f: Float[Array, "N 2 k"]) -> Float[Array, "N k"]:
    return d[:, :1] * f[:, 0] + d[:, 1:] * f[:, 1]


def _inner(f: Float[Array, "N *rest"]) -> Float[Array, "N *rest"]:
    """Removes the mean and the Nyquist mode along the first axis."""
    even, odd = jnp.mean(f[::2], axis=0), jnp.mean(f[1::2], axis=0)
    pairs = f.reshape(-1, 2, *f.shape[1:]) - jnp.stack([even, odd])
    return pairs.reshape(f.shape)


class RotatingBlock(eqx.Module):
    """A of one membrane: M as `response`, M B as `product`, and `mean` (2, n), which gives the mean of v."""

    rotations: Rotations
    response: Float[Array, "*batch n n"]
    product: Float[Array, "*batch n n"]
    mean: Float[Array, "*batch 2 n"]

    @classmethod
    def of(
        cls,
        curve: Curve,
        stokes_slp: StokesBlocks,
        laplace_slp: Float[Array, "N N"],
        sigma: Nodes,
        bending: Scalar,
        constraint: Constraint,
        *,
        cut: int,
        surface_cut: int,
    ) -> "RotatingBlock":
        """Computes A from the kernels of the single layer, with the factors of `constraint` for the tension."""
        frame = Rotations(curve, sigma, bending, cut, surface_cut)
        # the velocity from the force densities ∂_α (Pᵀ ζ)
        moved = jnp.concatenate(
            [own_spread(curve.normal, stokes_slp, laplace_slp), constraint.spread @ frame.free()], axis=2
        )
        slopes = jnp.stack([fourier.derivative(part, axis=0) for part in moved], axis=1)
        stretch = fourier.low_pass_rows(_product(curve.tangent, slopes), surface_cut)
        tension = constraint.tension.solve_columns(stretch)
        response = -frame.across(slopes) - stretch.T @ tension
        mean = -jnp.mean(moved, axis=1) - jnp.mean(constraint.spread, axis=1) @ tension
        return cls(frame, response, frame.bent(response.T, transposed=True).T, mean)

    def factored(self, c: Scalar) -> "FactoredRotations":
        """Factorises 1 - c A."""
        operator = linear.LinearOperator(jnp.eye(self.product.shape[0]) - c * self.product)
        return FactoredRotations(self, linear.Dense().factor(operator), c)


class FactoredRotations(eqx.Module):
    """The factorised 1 - c A of one membrane."""

    block: RotatingBlock
    factors: linear.AbstractFactoredDense
    c: Scalar

    def solve(self, r: NodePoints) -> NodePoints:
        """Returns (1 - c A)⁻¹ r."""
        frame = self.block.rotations
        load = frame.loaded(r)
        rates = self.factors.solve_columns(self.c * (self.block.response @ load)[:, None])
        mean = self.c * (self.block.mean @ (load + frame.bent(rates)[:, 0]))
        moved = fourier.low_pass(fourier.antiderivative(frame.along(rates)[..., 0], axis=0), frame.cut, axis=0)
        return r + moved + mean
