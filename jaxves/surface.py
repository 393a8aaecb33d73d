r"""The membranes at one instant, with the layer potentials that live on them.

`Surfaces` holds the geometry and the Nyström kernels of every membrane, (M, ...) arrays; its methods
apply the potentials of all membranes to densities (M, N) or (M, N, 2) and return values at all nodes.
The electric kernel is built when a field asks for it.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from . import curve as geometry
from . import fourier
from .arrays import VesicleNodes, VesiclePoints
from .curve import Curve
from .potentials import laplace, stokes
from .potentials.chords import Chords
from .potentials.stokes import StokesBlocks


class Surfaces(eqx.Module):
    """M membranes: frames, and the kernels of their self-interaction (M, N, N), which act on |x_α| times a density."""

    curves: Curve
    laplace_slp: Float[Array, "*batch N N"]
    stokes_slp: StokesBlocks
    laplace_slp_dn: Float[Array, "*batch N N"] | None

    @classmethod
    def of(cls, x: VesiclePoints, *, electric: bool) -> "Surfaces":
        """Geometry and kernels at nodes x; `electric` adds what only a field needs."""

        def one(x):
            curve = Curve.from_nodes(x)
            chords = Chords.of(curve)
            S = laplace.slp(chords)
            return cls(curve, S, stokes.slp(curve, chords, S), laplace.slp_dn(curve, chords) if electric else None)

        return jax.vmap(one)(x)

    def d_ds(self, f: Float[Array, "M N *rest"]) -> Float[Array, "M N *rest"]:
        """∂f/∂s on every membrane."""
        return jax.vmap(geometry.d_ds)(f, self.curves)

    def stokes(self, f: VesiclePoints) -> VesiclePoints:
        """Velocity S[f] at all nodes."""
        return jax.vmap(StokesBlocks.__matmul__)(self.stokes_slp, f * self.curves.speed[..., None])

    def potential(self, q: VesicleNodes, V_m: VesicleNodes) -> VesicleNodes:
        """S q - D V_m on the membranes (mean of the two sides)."""
        speed = self.curves.speed
        single = jnp.einsum("mij,mj->mi", self.laplace_slp, speed * q)
        return single - jnp.einsum("mji,mj->mi", self.laplace_slp_dn, speed * V_m)

    def dlp_dn(self, V_m: VesicleNodes) -> VesicleNodes:
        """D' V_m = ∂_s S ∂_s V_m; on the density ∂_s V_m the weight |x_α| cancels."""
        return self.d_ds(jnp.einsum("mij,mj->mi", self.laplace_slp, fourier.derivative(V_m)))
