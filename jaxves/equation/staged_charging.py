r"""Charging that is solved within the stages of a time step: with charge relaxation, and averaged over an AC period.

The laws of `physics/charging.py` contain rates that may be much faster than the motion: charge relaxes at 1/t_c, and
the envelope of an AC field turns at ω. A linear part that is frozen at the start of a step would lose the order of the
method there, because what remains explicit depends on geometry and time at the same fast rate. The scalars of a stage
are therefore solved for at the geometry of this stage. They are affine in the mean normal field g, so a stage costs one
integral equation for g, as the relaxed law does.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics import fourier, linear
from ..numerics.arrays import Scalar, VesicleNodes, VesiclePoints
from ..operators.surfaces import Surfaces
from ..physics import electric
from ..physics.charging import Densities, Relaxed, Relaxing
from ..physics.electric import Field, SurfaceFields
from .electrics import AbstractElectric, AbstractElectrics
from .normal_field import solve_normal_field


class StagedElectric(AbstractElectric):
    """The electric quantities with the rates of the scalars, which follow from the same fields.

    `V_m_square` is V_m². In a field averaged over its period, all quantities are means over the period. `fields` are
    then those of the mean scalars, and `envelope` has the real and the imaginary part of those that oscillate.
    """

    charge: VesicleNodes
    traction: VesiclePoints
    fields: SurfaceFields
    V_m: VesicleNodes
    V_m_square: VesicleNodes
    V_m_greatest: VesicleNodes
    found: dict[str, VesicleNodes]
    scalar_rates: dict[str, VesicleNodes]
    envelope: tuple[SurfaceFields, SurfaceFields] | None = None

    def potential(self, scalars):
        return self.V_m

    def greatest_potential(self, scalars):
        return self.V_m_greatest


class AbstractStagedCharging(AbstractElectrics):
    """An electric model whose scalars are solved for within the stages of a step."""

    cut: eqx.AbstractVar[int]

    @abc.abstractmethod
    def solve_stage(
        self, t: Scalar, surfaces: Surfaces, start: dict[str, VesicleNodes], c: Scalar, *, direct: bool
    ) -> tuple[StagedElectric, linear.Solution]:
        """Solves for the scalars s = start + c s' at time t; returns the electric quantities there, and the solution.

        With c = 0 these are the quantities for the scalars `start`.
        """

    def solve(self, t, surfaces, scalars, *, direct, factored):
        found, solution = self.solve_stage(t, surfaces, scalars, jnp.zeros(()), direct=direct)
        return found, solution, None

    def rates(self, found, scalars, velocity):
        return {name: fourier.low_pass(rate, self.cut) for name, rate in found.scalar_rates.items()}

    def linear_part(self, surfaces, factors):
        return None


class ChargeRelaxation(AbstractStagedCharging):
    """Charge on the interfaces relaxes in the time t_c = χδ, and is carried along by the membrane; scalars Q and W.

    A membrane without a given V_m starts uncharged, Q = W = 0, so that its potential jumps when a field is switched on:
    fluids and membrane are polarised at once. With a given V_m the charge of the interfaces starts relaxed.
    """

    field: Field
    cut: int = eqx.field(static=True)

    def start(self, scene, surfaces):
        zero = jnp.zeros(scene.x.shape[:2])
        if scene.V_m is None:
            return {"Q": zero, "W": zero}
        return with_potential(Relaxing(self.field), scene.V_m, surfaces(), self.field.E_inf(jnp.zeros(())))

    def solve_stage(self, t, surfaces, start, c, *, direct):
        law = Relaxing(self.field)
        densities = law.densities(start, c)
        g, solution = real_normal_field(surfaces, self.field.E_inf(t), densities, direct=direct)
        q, V = densities.q.at(g), densities.V.at(g)
        scalars = {name: scalar.at(g) for name, scalar in densities.scalars.items()}
        fields = surface_fields(surfaces, self.field.E_inf(t), g, q, V)
        traction = self.field.stress_scale() * mean_traction(surfaces, fields, self.field)
        return StagedElectric(q, traction, fields, V, V**2, V, scalars, law.rates(scalars, V, g)), solution


def with_potential(
    law: Relaxed | Relaxing, V_m: VesicleNodes, surfaces: Surfaces, E_inf: Float[Array, "2"]
) -> dict[str, VesicleNodes]:
    """Returns the scalars of `law` for this potential in the field E_inf, with relaxed charge in the fluids."""
    found = Relaxed(law.field).densities({"V_m": V_m}, jnp.zeros(()))
    g, _ = real_normal_field(surfaces, E_inf, found, direct=False)
    return law.charged(V_m, g)


def real_normal_field(
    surfaces: Surfaces, E_inf: Float[Array, "2"], densities: Densities, *, direct: bool
) -> tuple[VesicleNodes, linear.Solution]:
    """Returns the mean normal field g (M, N) of one real component, and the linear solution."""
    M = surfaces.curves.speed.shape[0]
    parts = [
        (density.value[:, None], jnp.broadcast_to(density.slope[..., None], (M, 1, 1)))
        for density in (densities.q, densities.V)
    ]
    g, solution = solve_normal_field(surfaces, E_inf[None], *parts, neutral=densities.neutral, direct=direct)
    return g[:, 0], solution


def surface_fields(
    surfaces: Surfaces, E_inf: Float[Array, "2"], g: VesicleNodes, q: VesicleNodes, V_m: VesicleNodes
) -> SurfaceFields:
    """Returns the fields (M, N) on both sides from the mean normal field g, its jump and the jump of the potential."""
    slope = surfaces.potential_slope(q, V_m)
    return jax.vmap(electric.fields_beside, in_axes=(0, None, 0, 0, 0, 0))(surfaces.curves, E_inf, g, q, V_m, slope)


def mean_traction(surfaces: Surfaces, fields: SurfaceFields, field: Field) -> VesiclePoints:
    """Returns the Maxwell traction of these fields in units of ε_e|E_∞|²."""
    return jax.vmap(electric.maxwell_traction)(surfaces.curves, fields, field.permittivity_ratio)
