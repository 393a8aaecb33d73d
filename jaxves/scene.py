"""What is simulated: vesicles, and the field and flow they are in, if any.

Numbers with a meaning are arrays (traced, differentiable, batchable); sizes are shapes; absence is
`None`, decides what is traced, and costs nothing.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .arrays import PerVesicle, VesiclePoints, as_float, require_x64
from .electric import Field
from .flow import AbstractFlow


class Scene(eqx.Module):
    """The starting nodes and all physical parameters.

    `x`: nodes (M, N, 2), counter-clockwise, equispaced in arc length; `bending`: κ_B of each vesicle
    relative to the reference, (M,). The transmembrane potential starts at `V_m` (M, N), or at zero.
    """

    x: VesiclePoints = eqx.field(converter=as_float)
    bending: PerVesicle = eqx.field(converter=as_float)
    field: Field | None = None
    flow: AbstractFlow | None = None
    V_m: Float[Array, "M N"] | None = None

    def __check_init__(self):
        require_x64()
        if self.x.ndim != 3 or self.x.shape[-1] != 2 or self.x.shape[1] % 2:
            raise ValueError(f"Scene.x must have shape (M, N, 2) with N even, but has {self.x.shape}.")
        if self.bending.shape != self.x.shape[:1]:
            raise ValueError(f"Scene.bending must have shape {self.x.shape[:1]}, but has {self.bending.shape}.")
        if self.V_m is not None and self.field is None:
            raise ValueError("Scene.V_m needs Scene.field: without a field nothing charges the membrane.")


def make_scene(
    shapes: Float[Array, "N 2"] | Sequence[Float[Array, "N 2"]],
    *,
    centers=None,
    bending=1.0,
    field: Field | None = None,
    flow: AbstractFlow | None = None,
) -> Scene:
    """A scene from one curve or several, each moved to its center (default: as it lies).

    `bending` may be one number for all vesicles or one for each.
    """
    x = jnp.asarray(shapes, dtype=float)
    x = x[None] if x.ndim == 2 else x
    if centers is not None:
        x = x + jnp.reshape(as_float(centers), (-1, 1, 2))
    return Scene(x, jnp.broadcast_to(as_float(bending), x.shape[:1]), field, flow)


def dc_field(
    beta,
    *,
    conductivity_ratio,
    membrane_conductance=0.0,
    chi=0.08,
    permittivity_ratio=1.0,
    direction=(0.0, 1.0),
    vesicles: int = 1,
    history=None,
) -> Field:
    """A field along `direction`; numbers of the membrane may be one for all vesicles or one for each.

    β, Λ, G and χ are the paper's; a `chi` given per vesicle is relative to the first's as reference.
    """

    def each(value):
        return jnp.broadcast_to(as_float(value), (vesicles,))

    chi = as_float(chi)
    return Field(
        beta,
        chi if chi.ndim == 0 else chi[0],
        each(conductivity_ratio),
        each(membrane_conductance),
        each(chi),
        each(permittivity_ratio),
        direction,
        history,
    )
