r"""The membranes at one instant, with the layer potentials that live on them.

`Surfaces` holds the geometry and the Nyström kernels of every membrane, (M, ...) arrays; its methods
apply the potentials of all membranes to densities (M, N) or (M, N, 2) and return values at all nodes.
A lone membrane has no `interactions`: nothing of them is traced.
The electric kernel is built when a field asks for it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..numerics import fourier
from ..numerics.arrays import VesicleNodes, VesiclePoints
from ..potentials.self_refined import Refinement, self_kernels
from ..potentials.self_stokes import StokesBlocks
from .interactions import AbstractCoupling, AbstractInteractions


class Surfaces(eqx.Module):
    """M membranes: frames, and the kernels of their self-interaction (M, N, N), which act on |x_α| times a density."""

    curves: Curve
    laplace_slp: Float[Array, "*batch N N"]
    stokes_slp: StokesBlocks
    laplace_slp_dn: Float[Array, "*batch N N"] | None
    interactions: AbstractInteractions | None = None

    @classmethod
    def of(
        cls,
        x: VesiclePoints,
        *,
        electric: bool,
        coupling: AbstractCoupling | None = None,
        refinement: Refinement | None = None,
    ) -> "Surfaces":
        """Geometry and kernels at nodes x; `electric` adds what only a field needs, `coupling` the interactions."""
        curves, own = self_kernels(x, electric=electric, refinement=refinement)
        interactions = None
        if coupling is not None:
            with jax.named_scope("interactions"):
                interactions = coupling.between(curves, electric=electric)
        return cls(curves, own.laplace_slp, own.stokes_slp, own.laplace_slp_dn, interactions)

    def d_ds(self, f: Float[Array, "M N *rest"]) -> Float[Array, "M N *rest"]:
        """∂f/∂s on every membrane."""
        return jax.vmap(geometry.d_ds)(f, self.curves)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Velocity S[f] at all nodes."""
        velocity = jax.vmap(StokesBlocks.__matmul__)(self.stokes_slp, f * self.curves.speed[..., None])
        return velocity if self.interactions is None else velocity + self.interactions.stokes(f)

    def dlp_dn(self, V_m: VesicleNodes) -> VesicleNodes:
        """D' V_m = ∂_s S ∂_s V_m; on the density ∂_s V_m the weight |x_α| cancels."""
        slope = fourier.derivative(V_m)
        value = self.d_ds(jnp.einsum("mij,mj->mi", self.laplace_slp, slope))
        if self.interactions is not None:
            across = self.interactions.slp_gradient(slope / self.curves.speed)
            value = value + jnp.sum(across * self.curves.tangent, axis=-1)
        return value

    def potential_slope(self, q: VesicleNodes, V_m: VesicleNodes) -> VesicleNodes:
        """∂_s (S q - D V_m) along the membranes (mean of the two sides)."""
        speed = self.curves.speed
        single = jnp.einsum("mij,mj->mi", self.laplace_slp, speed * q)
        double = jnp.einsum("mji,mj->mi", self.laplace_slp_dn, speed * V_m)
        slope = self.d_ds(single - double)
        if self.interactions is not None:
            conjugate = self.interactions.slp_gradient(self.d_ds(V_m))
            rotated = jnp.stack([conjugate[..., 1], -conjugate[..., 0]], axis=-1)
            slope = slope + jnp.sum((self.interactions.slp_gradient(q) - rotated) * self.curves.tangent, axis=-1)
        return slope
