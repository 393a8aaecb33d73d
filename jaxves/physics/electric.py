r"""The leaky-dielectric model for capacitive, conducting membranes (Wu & Veerapaneni, eqs. 5-9).

    φ = -E_∞·x + S q - D V_m,     q = [[∂_n φ]],  V_m = [[φ]],     jumps are inside minus outside
    ½ w + S'[η w] = E_∞·n + D'V_m,             q = η w,  η = (Λ-1)/(Λ+1)
    χ dV_m/dt + G V_m = Λ/(1+Λ) w              at a material point
    f_el = (β/χ) [[ε (½(E_n² - E_t²) n + E_n E_t t)]]

The unknown is w and not q, because w is also defined at Λ = 1, where q = 0. Since ∮ E_∞·n ds = ∮ D'V_m ds = 0,
∮ w ds = 0 as well. The mean of w is added to the operator. This does not change the solution, and it keeps the operator
regular as Λ → ∞, where ½ + S' is singular.
"""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..base.arguments import Bounded, is_known, refusal, require
from ..base.bounds import FINITE, RATIO_OF_RELAXING
from ..base.physical_numbers import BETA, CHARGE_RELAXATION, CHI, PER_VESICLE
from ..geometry.curve import Curve, d_ds
from ..numerics.arrays import (
    NodePoints,
    Nodes,
    PerVesicle,
    Scalar,
    ScalarLike,
    VesiclePoints,
    as_float,
    optional_float,
)
from .point_functions import OwnFunction, at_points, require_vector, require_without
from .waveform import AC, AbstractHistory, require_history

_PER_VESICLE = tuple(number.per_vesicle for number in PER_VESICLE)


def inner_share(conductivity_ratio: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Returns Λ/(1+Λ). Value and derivative are correct for all Λ in [0, ∞]."""
    small = conductivity_ratio <= 1
    inverse = 1 / jnp.where(small, 1.0, conductivity_ratio)
    below = jnp.where(small, conductivity_ratio, 0.0)
    return jnp.where(small, below / (1 + below), 1 / (1 + inverse))


class FieldFunction(OwnFunction):
    """An imposed field of the user's own: a function E(x, t) in JAX of one point (2,), in units of the reference |E_∞|.

    `dc_field(E_inf=E)` makes it from a function. Arrays in a function that is an `equinox.Module` can be traced,
    differentiated and batched. A plain function must be the same object in later calls, or JAX compiles again.

    Steps end where the field changes most (`steep_times`), and at the times that a method `breakpoints()` of the
    function returns. A pulse shorter than `t_end`/1000 has to be stated there, or a step may pass over it.

    Raises:
        ValueError: JAX cannot trace the function, as with a Python `if` on the time; it does not return one array (2,);
            or it has a divergence or a curl at one of a few points.
    """

    def __check_init__(self):
        require_vector("E_inf", self.function, "field", "E")
        self.require_breakpoints("E_inf")
        if is_known(self.arrays):
            harmonic = "the gradient of a harmonic potential, which has neither divergence nor curl"
            require_without("E_inf", self.function, divergence=harmonic, curl=harmonic)


def component(vectors: VesiclePoints | NodePoints, E: Float[Array, "*batch 2"]) -> Float[Array, "*batch_out"]:
    """Returns the component of a field along `vectors` (..., 2). The field is uniform, (2,), or one at each of them."""
    return vectors @ E if E.ndim == 1 else jnp.sum(vectors * E, axis=-1)


class Field(Bounded):
    """The imposed electric field and the electric parameters of fluids and membranes; (M,) arrays are per vesicle.

    β = ε|E_∞|² a C_m / μσ_e and χ = C_m κ_B/(σ_e μ a²) use the reference capacitance. Their ratio scales the Maxwell
    stress. `membrane_chi` is χ with the capacitance of each vesicle. `charge_relaxation` is δ = ε_e/(a C_m) with the
    reference capacitance; with None, charge in the fluids is in equilibrium at every instant. `function` is a field
    that depends on position, in place of `direction`.

    Raises:
        ValueError: a known number is out of its bounds, or shapes do not fit.
    """

    bounds: ClassVar = {
        "beta": BETA.bounds,
        "chi": CHI.bounds,
        "charge_relaxation": CHARGE_RELAXATION.bounds,
        **{number.per_vesicle: number.bounds for number in PER_VESICLE},
        "direction": FINITE,
    }

    beta: Scalar = eqx.field(converter=as_float)
    chi: Scalar = eqx.field(converter=as_float)
    conductivity_ratio: PerVesicle = eqx.field(converter=as_float)  # Λ
    membrane_conductance: PerVesicle = eqx.field(converter=as_float)  # G
    membrane_chi: PerVesicle = eqx.field(converter=as_float)
    permittivity_ratio: PerVesicle = eqx.field(converter=as_float)  # ε_i/ε_e
    direction: Float[Array, "2"] = eqx.field(converter=as_float)
    history: AbstractHistory | None = None
    charge_relaxation: Scalar | None = eqx.field(converter=optional_float, default=None)  # δ
    function: FieldFunction | None = None

    def __check_init__(self):
        for name in ("beta", "chi"):
            if getattr(self, name).shape != ():
                raise refusal(f"Field.{name}", getattr(self, name), "one number")
        for name in _PER_VESICLE:
            if getattr(self, name).ndim != 1 or getattr(self, name).shape != self.conductivity_ratio.shape:
                raise refusal(f"Field.{name}", getattr(self, name), "one number for each vesicle, (M,)")
        if self.history is not None:
            require_history("Field.history", self.history, "Pulse(0.0, 1.0, 1e-3), or None")
        if self.direction.shape != (2,) or (is_known(self.direction) and not np.any(np.asarray(self.direction))):
            raise refusal("Field.direction", self.direction, "two finite numbers, not both zero")
        if self.function is not None:
            self._check_function()
        if self.charge_relaxation is not None:
            if self.charge_relaxation.shape != ():
                raise refusal("Field.charge_relaxation", self.charge_relaxation, "one number")
            require("Field.conductivity_ratio", self.conductivity_ratio, RATIO_OF_RELAXING)

    def _check_function(self) -> None:
        if not isinstance(self.function, FieldFunction):
            raise refusal("Field.function", self.function, "a FieldFunction, or None")
        if self.charge_relaxation is not None:
            raise refusal("charge_relaxation", self.charge_relaxation, "None with a field E_inf of your own")
        if isinstance(self.history, AC) and self.history.averaged:
            raise refusal("history.averaged", True, "an AC field that is not averaged, with a field E_inf of your own")

    def is_within_bounds(self) -> Bool[Array, ""]:
        valid = super().is_within_bounds() & jnp.any(self.direction != 0)
        if self.charge_relaxation is None:
            return valid
        return valid & jnp.all(RATIO_OF_RELAXING.hold(self.conductivity_ratio))

    def for_vesicles(self, M: int) -> "Field":
        """Returns the field of one vesicle with its numbers repeated for M vesicles."""
        repeated = {name: jnp.broadcast_to(getattr(self, name), (M,)) for name in _PER_VESICLE}
        return dataclasses.replace(self, **repeated)

    def unit_direction(self) -> Float[Array, "2"]:
        """Returns the normalised `direction`."""
        return self.direction / jnp.sqrt(jnp.sum(self.direction**2))

    def is_uniform(self) -> bool:
        """Returns whether the field is the same at every point, along `direction`."""
        return self.function is None

    def at(self, x: Float[Array, "*batch 2"], t: Scalar) -> Float[Array, "*out 2"]:
        """Returns the imposed field at time t: one vector (2,) if it is uniform, otherwise one at each point of x."""
        if self.function is None:
            return self.E_inf(t)
        E = at_points(self.function.function, x, t)
        return E if self.history is None else self.history(t) * E

    def E_inf(self, t: Scalar) -> Float[Array, "2"]:
        """Returns the imposed field at time t if it is uniform, in units of the reference |E_∞|."""
        direction = self.unit_direction()
        return direction if self.history is None else self.history(t) * direction

    def breakpoints(self) -> Float[Array | np.ndarray, "B"]:
        """Returns the times at which the field is not smooth, in order. Time steps end there."""
        own = [part.breakpoints() for part in (self.history, self.function) if part is not None]
        return jnp.sort(jnp.concatenate(own)) if len(own) > 1 else own[0] if own else np.zeros(0)

    def steep_times(self, x: VesiclePoints, t_end: ScalarLike) -> Float[Array | np.ndarray, "S"]:
        """Returns times that a function of the user changes at, found from samples (`OwnFunction.steep_times`)."""
        return np.zeros(0) if self.function is None else self.function.steep_times(x, t_end)

    def period(self) -> Scalar | None:
        """Returns the period of the field in units of t_κ; None if it has none, or is averaged over it."""
        return None if self.history is None else self.history.period()

    def stress_scale(self) -> Scalar:
        """Returns β/χ, the Maxwell stress of the reference field in units of the bending stress κ_B/a³."""
        return self.beta / self.chi

    def relaxation_time(self) -> Scalar:
        """Returns t_c = χδ, the time ε_e/σ_e in which charge relaxes in the outer fluid, in units of t_κ."""
        return self.chi * self.charge_relaxation

    def contrast(self) -> PerVesicle:
        """Returns η = (Λ-1)/(Λ+1)."""
        return 2 * inner_share(self.conductivity_ratio) - 1

    def charging_rate(self, V_m: Float[Array, "M N"], w: Float[Array, "M N"]) -> Float[Array, "M N"]:
        """Returns dV_m/dt = (Λ/(1+Λ) w - G V_m)/χ."""
        share = inner_share(self.conductivity_ratio)
        conductance = self.membrane_conductance
        return (share[:, None] * w - conductance[:, None] * V_m) / self.membrane_chi[:, None]


class SurfaceFields(eqx.Module):
    """The normal and tangential electric field on the inner and outer side of one membrane, in units of |E_∞|."""

    inner_normal: Nodes
    outer_normal: Nodes
    inner_tangential: Nodes
    outer_tangential: Nodes


def surface_fields(
    curve: Curve,
    E_inf: Float[Array, "2"] | NodePoints,
    conductivity_ratio: Scalar,
    w: Nodes,
    V_m: Nodes,
    potential_slope: Nodes,
) -> SurfaceFields:
    """Returns the electric field on both sides of one membrane.

    `E_inf` is the imposed field, uniform (2,) or at the nodes (N, 2). `potential_slope` is ∂_s of S q - D V_m on the
    membrane, with the mean of the two sides for D. The normal components follow from the continuity of the current:
    E_n = w/(1+Λ) inside and Λ w/(1+Λ) outside, so E_n,i - E_n,e = -q.
    """
    share = inner_share(conductivity_ratio)
    tangential = component(curve.tangent, E_inf) - potential_slope
    half_jump = 0.5 * d_ds(V_m, curve)
    return SurfaceFields((1 - share) * w, share * w, tangential - half_jump, tangential + half_jump)


def fields_beside(
    curve: Curve, E_inf: Float[Array, "2"], g: Nodes, q: Nodes, V_m: Nodes, potential_slope: Nodes
) -> SurfaceFields:
    """Returns the electric field on both sides of one membrane, with the mean g and the jump -q of E_n.

    `potential_slope` is that of `surface_fields`.
    """
    tangential = curve.tangent @ E_inf - potential_slope
    half_jump = 0.5 * d_ds(V_m, curve)
    return SurfaceFields(g - 0.5 * q, g + 0.5 * q, tangential - half_jump, tangential + half_jump)


def maxwell_traction(curve: Curve, fields: SurfaceFields, permittivity_ratio: Scalar) -> NodePoints:
    """Returns [[ε (½(E_n² - E_t²) n + E_n E_t t)]], (N, 2), in units of ε_e |E_∞|²."""
    E_n, E_t = fields.inner_normal, fields.inner_tangential
    normal = permittivity_ratio * 0.5 * (E_n**2 - E_t**2)
    tangential = permittivity_ratio * E_n * E_t
    E_n, E_t = fields.outer_normal, fields.outer_tangential
    normal = normal - 0.5 * (E_n**2 - E_t**2)
    tangential = tangential - E_n * E_t
    return normal[:, None] * curve.normal + tangential[:, None] * curve.tangent
