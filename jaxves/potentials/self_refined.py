r"""Self-interaction kernels of a membrane, also where it comes close to itself, as in a neck or a fold.

Kress's rule integrates the singularity of log|x(α) - x(α')| at α' = α. If another part of the same curve is at a
distance of d node spacings, the kernel varies over that distance. The rule is trapezoidal there, and its error is
e^{-2πd}. If density and curve are resolved, this is the only error. On a grid that is p times finer it is e^{-2πpd}.
The kernels are therefore computed between all fine nodes by the same rule, and reduced to the N nodes:

    k = (1/p) Rᵀ k_fine R,        R the trigonometric interpolation from N to pN nodes

Rᵀ/p keeps the N resolved modes of a potential, so symmetric kernels stay symmetric. Sampling the potential at the nodes
would destroy the symmetry, which the Cholesky factorisation for the tension needs. p = 2, 4 or 8 is chosen at run time
such that p d ≥ 4, which gives an error of 1e-11, and the fine grid has at most 2048 nodes. If d ≥ 4 for all membranes,
nothing is refined and nothing is added to the cost.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import NodeMatrix, NodePoints, VesiclePoints, staged
from ..numerics.batching import greatest
from . import self_laplace, self_stokes, self_stokes_dlp
from .chords import Chords
from .self_stokes import StokesBlocks

FAR = 4.0  # required distance in spacings of the fine grid
RESOLVED = 0.25  # node spacings; at shorter distances the error of the finest grid exceeds e^{-4π} = 3e-6
FINEST = 2048  # nodes of the finest grid, unless the membrane itself has more; matrices of finer ones take gigabytes
_FACTORS = (1, 2, 4, 8)


class SelfKernels(eqx.Module):
    """Kernels of S, Stokes S and, where needed, S' and Stokes D of one membrane; they act on |x_α| times a density.

    S' is there with a field, and Stokes D with two viscosities. The first two are symmetric.
    """

    laplace_slp: Float[Array, "*batch N N"]
    stokes_slp: StokesBlocks
    laplace_slp_dn: Float[Array, "*batch N N"] | None
    stokes_dlp: StokesBlocks | None = None

    @classmethod
    def of(cls, curve: Curve, chords: Chords, *, electric: bool, contrast: bool = False) -> "SelfKernels":
        """Computes the kernels by Kress's rule on the given nodes."""
        S = self_laplace.slp(chords)
        S_dn = self_laplace.slp_dn(curve, chords) if electric else None
        D = self_stokes_dlp.dlp(curve, chords) if contrast else None
        return cls(S, self_stokes.slp(curve, chords, S), S_dn, D)

    @classmethod
    def refined(cls, x: NodePoints, factor: int, *, electric: bool, contrast: bool = False) -> "SelfKernels":
        """Computes the kernels by Kress's rule on a grid that is `factor` times finer."""
        R = staged(fourier.resampling(x.shape[0], factor * x.shape[0]))

        def coarser(kernel: Float[Array, "K K"]) -> NodeMatrix:
            return R.T @ (kernel @ (R / factor))

        # The interpolant has only the modes of the N nodes, so these give its derivatives exactly.
        d1 = fourier.derivative(x, axis=0)
        fine = R @ jnp.concatenate([x, d1, fourier.derivative(d1, axis=0)], axis=1)
        curve = Curve.from_derivatives(fine[:, :2], fine[:, 2:4], fine[:, 4:])
        return jax.tree.map(coarser, cls.of(curve, Chords.of(curve), electric=electric, contrast=contrast))


class Refinement(eqx.Module):
    """The refinement factors of the grids to choose from. The first is 1, for the given nodes.

    At distances below `resolved` node spacings the finest grid is not accurate.
    """

    factors: tuple[int, ...] = eqx.field(static=True, default=_FACTORS)
    resolved: float = eqx.field(static=True, default=RESOLVED)

    @classmethod
    def for_nodes(cls, N: int) -> "Refinement":
        """Returns the default for N nodes: grids up to 8 times finer, with at most `FINEST` nodes."""
        factors = tuple(factor for factor in _FACTORS if factor == 1 or factor * N <= FINEST)
        return cls(factors, RESOLVED * _FACTORS[-1] / factors[-1])

    def level(self, curve: Curve) -> Int[Array, ""]:
        """Returns the index into `factors` that the least distance between parts of the curve requires."""
        nearest2 = _nearest2(curve)
        return sum((jnp.int32(nearest2 < (FAR / factor) ** 2) for factor in self.factors[:-1]), start=jnp.int32(0))


def _nearest2(curve: Curve) -> Float[Array, ""]:
    """Returns the square of the least distance between parts of a curve, in node spacings.

    Two nodes belong to different parts if the membrane between them is at least twice as long as their chord.
    """
    weights = curve.weights
    place = jnp.cumsum(weights)
    along = jnp.abs(place[:, None] - place[None, :])
    along = jnp.minimum(along, place[-1] - along)
    r2 = (curve.x[:, None, 0] - curve.x[None, :, 0]) ** 2 + (curve.x[:, None, 1] - curve.x[None, :, 1]) ** 2
    apart = (along > 0) & (along**2 >= 4 * r2)
    spacing2 = jnp.max(weights) ** 2
    nearest2 = jnp.min(jnp.where(apart, r2, jnp.inf)) / spacing2
    # Nodes can be offset by half a spacing along the curve, so their distance exceeds that of the two parts.
    return nearest2 - 0.25


def self_kernels(
    x: VesiclePoints, *, electric: bool, contrast: bool = False, refinement: Refinement | None = None
) -> tuple[Curve, SelfKernels]:
    """Returns curves and kernels of all membranes. All use the refinement that the narrowest distance requires.

    `electric` adds the kernel of S', `contrast` that of the Stokes double layer.
    `refinement` has the grids to choose from; the default is `Refinement.for_nodes`.
    """
    refinement = Refinement.for_nodes(x.shape[1]) if refinement is None else refinement
    which = dict(electric=electric, contrast=contrast)
    curves = jax.vmap(Curve.from_nodes)(x)

    def plain(curves, x):
        return jax.vmap(lambda curve: SelfKernels.of(curve, Chords.of(curve), **which))(curves)

    def finer(factor: int):
        # One membrane at a time, to save memory. The kernels are recomputed for derivatives, because all branches of a
        # switch would store what one of them stores.
        kernels = jax.checkpoint(lambda x: SelfKernels.refined(x, factor, **which))
        return lambda curves, x: jax.lax.map(kernels, x)

    branches = [plain, *(finer(factor) for factor in refinement.factors[1:])]
    return curves, jax.lax.switch(greatest(jnp.max(jax.vmap(refinement.level)(curves))), branches, curves, x)
