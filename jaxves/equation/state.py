"""The unknowns of the equation of motion, and all quantities at one instant."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..base import status
from ..numerics.arrays import Scalar, Status, VesicleNodes, VesiclePoints
from ..operators.interactions import AbstractCoupling
from ..operators.surfaces import Surfaces
from .electrics import AbstractElectric

_LARGEST = 1e-6  # residual of a solution that is accepted in any case


class Unknowns(eqx.Module):
    """The unknowns.

    `x` are the nodes (M, N, 2). `scalars` have one number for each node, (M, N), by name. With a field this is the
    transmembrane potential "V_m"; without a field there are none. `integrals` are running time integrals by name.
    """

    x: VesiclePoints
    scalars: dict[str, VesicleNodes] = eqx.field(default_factory=dict)
    integrals: dict[str, Array] = eqx.field(default_factory=dict)

    @classmethod
    def of(cls, x: VesiclePoints, V_m: VesicleNodes | None = None) -> "Unknowns":
        """Returns the unknowns with nodes (M, N, 2) and, if there is a field, the transmembrane potential (M, N)."""
        return cls(x, {} if V_m is None else {"V_m": V_m})

    def shapes_and_scalars(self) -> tuple["Unknowns", "Unknowns"]:
        """Returns two parts whose sum this is: shapes and integrals, and the scalars alone. The rest is zero."""
        zero = jax.tree.map(jnp.zeros_like, self)
        return Unknowns(self.x, zero.scalars, self.integrals), Unknowns(zero.x, self.scalars, zero.integrals)

    @property
    def V_m(self) -> VesicleNodes | None:
        """The transmembrane potential, (M, N) in units of a |E_inf|; None without a field."""
        return self.scalars.get("V_m")


class Motion(eqx.Module):
    """All quantities at one instant, with forces and fields.

    `electric` is None without a field. `residual` is the largest true relative residual of all linear solves. It is
    infinite if there was no room for all near pairs. `iterations` is the number of iterations of the solves.
    """

    surfaces: Surfaces
    velocity: VesiclePoints
    sigma: VesicleNodes
    f_hd: VesiclePoints
    electric: AbstractElectric | None
    rates: dict[str, VesicleNodes]  # time derivatives of the scalars
    residual: Scalar
    iterations: Array


def verdict(residual: Scalar, coupling: AbstractCoupling | None) -> Status:
    """Returns RUNNING, or the status for a residual that is infinite, or ten times larger than `coupling` asks for."""
    limit = _LARGEST if coupling is None else max(_LARGEST, 10 * coupling.tolerance())
    code = jnp.where(residual < limit, status.RUNNING, status.SOLVE_FAILED)
    return jnp.where(jnp.isposinf(residual), status.CROWDED, code)
