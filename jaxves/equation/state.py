"""What evolves, and what holds at one instant."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..base import status
from ..numerics.arrays import Scalar, Status, VesicleNodes, VesiclePoints
from ..operators.surfaces import Surfaces
from ..physics.electric import SurfaceFields


class Unknowns(eqx.Module):
    """What evolves: nodes (M, N, 2), transmembrane potential (M, N), and running time integrals."""

    x: VesiclePoints
    V_m: VesicleNodes | None = None
    integrals: dict[str, Array] | None = None


class Motion(eqx.Module):
    """Everything that holds at one instant, forces and fields included."""

    surfaces: Surfaces
    velocity: VesiclePoints
    sigma: VesicleNodes
    f_hd: VesiclePoints
    f_el: VesiclePoints | None
    V_rate: VesicleNodes | None
    w: VesicleNodes | None
    fields: SurfaceFields | None
    residual: Scalar  # worst true relative residual of the linear solves; infinite when interactions are crowded
    iterations: Array


def verdict(residual: Scalar) -> Status:
    """RUNNING, or what the residual of a `Motion` says against it."""
    code = jnp.where(residual < 1e-6, status.RUNNING, status.SOLVE_FAILED)
    return jnp.where(jnp.isposinf(residual), status.CROWDED, code)
