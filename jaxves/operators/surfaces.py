r"""All membranes at one instant, with their layer potentials.

`Surfaces` has the geometry and the Nyström kernels of every membrane, as (M, ...) arrays. Its methods apply the
potentials of all membranes to densities (M, N) or (M, N, 2), and return values at all nodes. A single membrane has no
`interactions`, so their code is not compiled. The electric kernel is computed only if there is a field, and the Stokes
double layer only if there are two viscosities.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Free
from ..numerics import fourier
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..potentials.self_refined import Refinement, self_kernels
from ..potentials.self_stokes import StokesBlocks
from .double_layers import AbstractDoubleLayers
from .interactions import AbstractCoupling, AbstractInteractions
from .sums import double_layers_of


class Surfaces(eqx.Module):
    """M membranes with their self-interaction kernels (M, N, N), which act on |x_α| times a density."""

    curves: Curve
    laplace_slp: Float[Array, "*batch N N"]
    stokes_slp: StokesBlocks
    laplace_slp_dn: Float[Array, "*batch N N"] | None
    interactions: AbstractInteractions | None = None
    stokes_dlp: StokesBlocks | None = None
    double_layers: AbstractDoubleLayers | None = None

    @classmethod
    def of(
        cls,
        x: VesiclePoints,
        *,
        electric: bool,
        contrast: bool = False,
        coupling: AbstractCoupling | None = None,
        domain: AbstractDomain | None = None,
        refinement: Refinement | None = None,
    ) -> "Surfaces":
        """Computes geometry and kernels at nodes x.

        `electric` adds the kernel for a field, `contrast` that for two viscosities, `coupling` the interactions, and
        `refinement` sets the finer grids.
        """
        curves, own = self_kernels(x, electric=electric, contrast=contrast, refinement=refinement)
        interactions = double_layers = None
        domain = Free() if domain is None else domain
        if coupling is not None:
            with jax.named_scope("interactions"):
                interactions = coupling.between(curves, domain, electric=electric, contrast=contrast)
                if contrast:
                    double_layers = double_layers_of(curves, interactions, coupling, domain)
        kernels = own.laplace_slp, own.stokes_slp, own.laplace_slp_dn
        return cls(curves, *kernels, interactions, own.stokes_dlp, double_layers)

    def d_ds(self, f: Float[Array, "M N *rest"]) -> Float[Array, "M N *rest"]:
        """Returns ∂f/∂s on every membrane."""
        return jax.vmap(geometry.d_ds)(f, self.curves)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Returns the velocity S[f] at all nodes."""
        velocity = jax.vmap(StokesBlocks.__matmul__)(self.stokes_slp, f * self.curves.speed[..., None])
        return velocity if self.interactions is None else velocity + self.interactions.stokes(f)

    def dlp_dn(self, V_m: VesicleNodes) -> VesicleNodes:
        """Returns D' V_m = ∂_s S ∂_s V_m. For the density ∂_s V_m the weight |x_α| cancels.

        In a periodic cell, n·Σ ∮ V_m n ds over the area of the cell is subtracted.
        """
        slope = fourier.derivative(V_m)
        value = self.d_ds(jnp.einsum("mij,mj->mi", self.laplace_slp, slope))
        if self.interactions is not None:
            across = self.interactions.slp_gradient(slope / self.curves.speed)
            value = value + jnp.sum(across * self.curves.tangent, axis=-1)
            mean = self.interactions.mean_dipole(V_m)
            if mean is not None:
                value = value - self.curves.normal @ mean
        return value

    def potential_slope(self, q: VesicleNodes, V_m: VesicleNodes) -> VesicleNodes:
        """Returns ∂_s (S q - D V_m) along the membranes, the mean of the two sides."""
        speed = self.curves.speed
        single = jnp.einsum("mij,mj->mi", self.laplace_slp, speed * q)
        double = jnp.einsum("mji,mj->mi", self.laplace_slp_dn, speed * V_m)
        slope = self.d_ds(single - double)
        if self.interactions is not None:
            conjugate = self.interactions.slp_gradient(self.d_ds(V_m))
            rotated = jnp.stack([conjugate[..., 1], -conjugate[..., 0]], axis=-1)
            slope = slope + jnp.sum((self.interactions.slp_gradient(q) - rotated) * self.curves.tangent, axis=-1)
            mean = self.interactions.mean_dipole(V_m)
            if mean is not None:
                slope = slope + self.curves.tangent @ mean
        return slope
