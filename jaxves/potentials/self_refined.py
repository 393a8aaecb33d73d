r"""Kernels of a membrane on itself, also where it comes near itself: in the neck of a bud, inside a kidney.

Kress's rule treats the singularity of log|x(α) - x(α')| at α' = α. Where another part of the same curve passes at
a distance of d node spacings, the kernel varies over that distance, and the rule, which is trapezoidal there, errs
by e^{-2πd}. With density and curve resolved, that is the only error: on a grid p times finer it is e^{-2πpd}. So
the kernels are formed there, by the same rule, between all fine nodes, and brought back to the N nodes:

    k = (1/p) Rᵀ k_fine R,        R the trigonometric interpolation from N to pN nodes

Rᵀ/p takes the N resolved modes of a potential, so that symmetric kernels stay symmetric (sampling the potential at
the nodes would lose that, and with it the Cholesky factors of the tension). p = 2, 4 or 8 follows the distance at
run time such that p d ≥ 4, an error of 1e-11; while d ≥ 4 for all membranes, nothing is refined nor paid for.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix, NodePoints, VesiclePoints, staged
from ..numerics.batching import greatest
from . import self_laplace, self_stokes
from .chords import Chords
from .self_stokes import StokesBlocks

FAR = 4.0  # fine node spacings
FACTORS = (1, 2, 4, 8)
RESOLVED = 0.25  # node spacings: narrower, the finest grid is left with an error above e^{-4π} = 3e-6


class SelfKernels(eqx.Module):
    """S, Stokes S and, for a field, S' of one membrane, acting on |x_α| times a density; symmetric but for S'."""

    laplace_slp: Float[Array, "*batch N N"]
    stokes_slp: StokesBlocks
    laplace_slp_dn: Float[Array, "*batch N N"] | None

    @classmethod
    def of(cls, curve: Curve, chords: Chords, *, electric: bool) -> "SelfKernels":
        """By Kress's rule on the nodes as they are."""
        S = self_laplace.slp(chords)
        S_dn = self_laplace.slp_dn(curve, chords) if electric else None
        return cls(S, self_stokes.slp(curve, chords, S), S_dn)

    @classmethod
    def refined(cls, x: NodePoints, factor: int, *, electric: bool) -> "SelfKernels":
        """By Kress's rule on a grid `factor` times finer."""
        R = staged(fourier.resampling_matrix(x.shape[0], factor * x.shape[0]))

        def coarser(kernel: Float[Array, "K K"]) -> NodeMatrix:
            return R.T @ (kernel @ (R / factor))

        # The curve has no finer modes than its nodes: they give its derivatives too.
        d1 = fourier.derivative(x, axis=0)
        fine = R @ jnp.concatenate([x, d1, fourier.derivative(d1, axis=0)], axis=1)
        curve = Curve.from_derivatives(fine[:, :2], fine[:, 2:4], fine[:, 4:])
        return jax.tree.map(coarser, cls.of(curve, Chords.of(curve), electric=electric))


def level(curve: Curve) -> Int[Array, ""]:
    """Which of `FACTORS` the distance between parts of the curve asks for.

    Parts are nodes between which the membrane is at least twice as long as the chord.
    """
    weights = curve.weights
    place = jnp.cumsum(weights)
    along = jnp.abs(place[:, None] - place[None, :])
    along = jnp.minimum(along, place[-1] - along)
    r2 = (curve.x[:, None, 0] - curve.x[None, :, 0]) ** 2 + (curve.x[:, None, 1] - curve.x[None, :, 1]) ** 2
    apart = (along > 0) & (along**2 >= 4 * r2)
    spacing2 = jnp.max(weights) ** 2
    nearest2 = jnp.min(jnp.where(apart, r2, jnp.inf)) / spacing2
    # The curve passes between nodes: they may be half a spacing further apart, along it, than it is from itself.
    return sum(jnp.int32(nearest2 - 0.25 < (FAR / factor) ** 2) for factor in FACTORS[:-1])


def self_kernels(x: VesiclePoints, *, electric: bool) -> tuple[Curve, SelfKernels]:
    """Curves and kernels of all membranes, refined as the nearest parts of any of them ask for."""
    curves = jax.vmap(Curve.from_nodes)(x)

    def plain(curves, x):
        return jax.vmap(lambda curve: SelfKernels.of(curve, Chords.of(curve), electric=electric))(curves)

    def finer(factor: int):
        # One by one, for memory; recomputed when differentiated, since what a branch keeps is kept by all of them.
        kernels = jax.checkpoint(lambda x: SelfKernels.refined(x, factor, electric=electric))
        return lambda curves, x: jax.lax.map(kernels, x)

    branches = [plain, *(finer(factor) for factor in FACTORS[1:])]
    return curves, jax.lax.switch(greatest(jnp.max(jax.vmap(level)(curves))), branches, curves, x)
