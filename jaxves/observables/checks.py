"""Limits for results at saved times, and the conditions that end a run early."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..base import status
from ..equation.equation import Equation
from ..equation.norms import ROUGH
from ..equation.state import Unknowns, verdict
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain
from ..numerics.arrays import Scalar, Status
from .crossings import collides, crosses_itself
from .outline import rates_on_outline
from .rows import Row


class Checks(eqx.Module):
    """Limits for a valid result.

    `tail` is the largest spectral tail. `film` is the largest estimated relative error of the drainage rate of a film
    that is thinner than the node spacing. `drift` is the largest relative change of area and perimeter. `steady` is the
    speed below which a run ends as steady, or None. With a viscosity ratio ν > 1 it is divided by (1 + ν)/2.
    """

    tail: float = eqx.field(static=True, default=ROUGH)
    film: float = eqx.field(static=True, default=0.1)
    drift: float = eqx.field(static=True, default=1e-2)
    steady: Scalar | None = None

    def judge(self, equation: Equation, t: Scalar, y: Unknowns, row: Row) -> Status:
        """Returns the status for one saved row: RUNNING, or why the run ends."""
        code = jnp.int32(status.RUNNING)
        if self.steady is not None:
            changes = jax.tree.leaves(rates_on_outline(equation.motion(t, y), y))
            fastest = jnp.max(jnp.stack([jnp.max(jnp.abs(change)) for change in changes]))
            ratio = equation.scene.viscosity_ratio
            if ratio is not None:
                # Shapes relax (1 + ν)/2 times as slowly.
                fastest = fastest * jnp.maximum(1.0, 0.5 * (1 + jnp.max(ratio)))
            code = jnp.where((fastest < self.steady) & (t > 0), status.STEADY, code)
        unresolved = jnp.max(row.diagnostics["spectral_tail"]) > self.tail
        # The neck or fold is too narrow for the self-interaction kernels.
        spacing = 2 * np.pi * equation.speed / y.x.shape[1]
        pinched = jnp.any(row.diagnostics["self_gap"] < equation.refinement.resolved * spacing)
        code = jnp.where(unresolved | pinched, status.UNRESOLVED, code)
        area = jnp.max(jnp.abs(row.diagnostics["area"] / equation.area - 1))
        length = jnp.max(jnp.abs(row.diagnostics["length"] / (2 * np.pi * equation.speed) - 1))
        code = jnp.where(jnp.maximum(area, length) > self.drift, status.DRIFT, code)
        solved = verdict(row.diagnostics["residual"], equation.coupling)
        code = jnp.where(solved == status.RUNNING, code, solved)
        crossed = jnp.any(jax.vmap(lambda x: crosses_itself(Curve.from_nodes(x)))(y.x))
        code = jnp.where(crossed, status.SELF_CONTACT, code)
        if "min_gap" in row.diagnostics:
            code = self._of_several(y, row, code, equation.domain.at(t))
        finite = jnp.all(jnp.isfinite(row.x)) & jnp.all(jnp.isfinite(row.tension))
        return jnp.where(finite, code, status.NOT_FINITE)

    def _of_several(self, y: Unknowns, row: Row, code: Status, domain: AbstractDomain) -> Status:
        """Returns the status after checking the films between vesicles, and whether vesicles overlap."""
        curves = jax.vmap(Curve.from_nodes)(y.x)
        thin = row.diagnostics["min_gap"] < jnp.max(jax.vmap(lambda curve: curve.weights)(curves))
        unresolved = thin & (row.diagnostics["film_error"] > self.film)
        code = jnp.where((code < status.UNRESOLVED) & unresolved, status.UNRESOLVED, code)
        return jnp.where(collides(curves, domain), status.COLLISION, code)
