"""The unknowns of the equation of motion, and what is known about one instant."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from ..base import status
from ..numerics.arrays import Scalar, Status, VesicleNodes, VesiclePoints
from ..operators.surfaces import Surfaces
from .electrics import AbstractElectric


class Unknowns(eqx.Module):
    """What evolves in time.

    `x`: nodes (M, N, 2). `scalars`: one number for each node, (M, N), by name; without a field there is none, with one
    it is the transmembrane potential "V_m". `integrals`: running time integrals by name, of any shape.
    """

    x: VesiclePoints
    scalars: dict[str, VesicleNodes] = eqx.field(default_factory=dict)
    integrals: dict[str, Array] = eqx.field(default_factory=dict)

    @classmethod
    def of(cls, x: VesiclePoints, V_m: VesicleNodes | None = None) -> "Unknowns":
        """Nodes (M, N, 2), and the transmembrane potential (M, N) where there is a field."""
        return cls(x, {} if V_m is None else {"V_m": V_m})

    @property
    def V_m(self) -> VesicleNodes | None:
        """The transmembrane potential, (M, N) in units of a |E_inf|; None without a field."""
        return self.scalars.get("V_m")


class Motion(eqx.Module):
    """Everything that is known about one instant, forces and fields included.

    `electric` is None without a field. `residual` is the worst true relative residual of all linear solves, and
    infinite when the interactions had too little room for near pairs; `iterations` is the largest number of any.
    """

    surfaces: Surfaces
    velocity: VesiclePoints
    sigma: VesicleNodes
    f_hd: VesiclePoints
    electric: AbstractElectric | None
    rates: dict[str, VesicleNodes]  # of the scalars
    residual: Scalar
    iterations: Array


def verdict(residual: Scalar) -> Status:
    """RUNNING, or the status that the residual of a `Motion` stands for."""
    code = jnp.where(residual < 1e-6, status.RUNNING, status.SOLVE_FAILED)
    return jnp.where(jnp.isposinf(residual), status.CROWDED, code)
