r"""From laboratory quantities in SI units to the paper's dimensionless numbers, and back.

    Λ = σ_i/σ_e                 G  = a G_m/σ_e            β = ε|E_∞|² a C_m/(μσ_e)
    χ = C_m κ_B/(σ_e μ a²)      Ca = μ γ̇ a³/κ_B           a = L/2π

Ten quantities in four base units leave six numbers. The sixth has no influence, because ε enters only as ε|E_∞|². The
inverse therefore needs a, κ_B, μ, σ_e and ε. All formulas accept traced arrays.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..numerics.arrays import ScalarLike, as_float

Number = Float[Array, "*batch"]


class Scales(eqx.Module):
    """The units of dimensionless results: multiply a result by them to get SI units."""

    length: Number  # a, m
    time: Number  # t_κ = μa³/κ_B, s
    velocity: Number  # a/t_κ, m/s
    tension: Number  # κ_B/a², N/m
    stress: Number  # κ_B/a³, Pa: of forces per area and pressures
    energy: Number  # κ_B/a, J/m: per depth, as everything in two dimensions
    V_m: Number  # |E_∞| a, V
    charge: Number  # |E_∞|, V/m: of the jump q of the normal derivative
    maxwell_stress: Number  # ε|E_∞|², Pa; β/χ times `stress`
    charging_time: Number  # a C_m/σ_e, s; χ times `time`


class LabQuantities(eqx.Module):
    """One vesicle in SI units; all fields are numbers, or arrays of one shape."""

    a: Number = eqx.field(converter=as_float)  # m, perimeter/2π
    E: Number = eqx.field(converter=as_float)  # V/m, |E_∞|
    sigma_i: Number = eqx.field(converter=as_float)  # S/m
    sigma_e: Number = eqx.field(converter=as_float)  # S/m
    epsilon: Number = eqx.field(converter=as_float)  # F/m, of the outer fluid, absolute
    C_m: Number = eqx.field(converter=as_float)  # F/m²
    kappa_B: Number = eqx.field(converter=as_float)  # J
    mu: Number = eqx.field(converter=as_float)  # Pa s
    G_m: Number = eqx.field(converter=as_float, default=0.0)  # S/m²
    shear_rate: Number = eqx.field(converter=as_float, default=0.0)  # 1/s

    def numbers(self) -> "Numbers":
        """Returns the dimensionless numbers, by the formulas at the top of this file."""
        return Numbers(
            beta=self.epsilon * self.E**2 * self.a * self.C_m / (self.mu * self.sigma_e),
            chi=self.C_m * self.kappa_B / (self.sigma_e * self.mu * self.a**2),
            conductivity_ratio=self.sigma_i / self.sigma_e,
            membrane_conductance=self.a * self.G_m / self.sigma_e,
            capillary_number=self.mu * self.shear_rate * self.a**3 / self.kappa_B,
        )

    def scales(self) -> Scales:
        """Returns the units in which results are given."""
        time = self.mu * self.a**3 / self.kappa_B
        return Scales(
            length=self.a,
            time=time,
            velocity=self.a / time,
            tension=self.kappa_B / self.a**2,
            stress=self.kappa_B / self.a**3,
            energy=self.kappa_B / self.a,
            V_m=self.E * self.a,
            charge=self.E,
            maxwell_stress=self.epsilon * self.E**2,
            charging_time=self.a * self.C_m / self.sigma_e,
        )


class Numbers(eqx.Module):
    """The numbers β, χ, Λ, G and Ca; all fields are numbers, or arrays of one shape."""

    beta: Number = eqx.field(converter=as_float)
    chi: Number = eqx.field(converter=as_float)
    conductivity_ratio: Number = eqx.field(converter=as_float)
    membrane_conductance: Number = eqx.field(converter=as_float, default=0.0)
    capillary_number: Number = eqx.field(converter=as_float, default=0.0)

    def physical(
        self,
        *,
        a: ScalarLike,
        kappa_B: ScalarLike,
        mu: ScalarLike,
        sigma_e: ScalarLike,
        epsilon: ScalarLike,
    ) -> LabQuantities:
        """Returns laboratory quantities in SI units that have these numbers.

        They are not differentiable in β at β = 0, because |E_∞| is proportional to √β.
        """
        C_m = self.chi * sigma_e * mu * a**2 / kappa_B
        return LabQuantities(
            a=a,
            E=jnp.sqrt(self.beta * mu * sigma_e / (epsilon * a * C_m)),
            sigma_i=self.conductivity_ratio * sigma_e,
            sigma_e=sigma_e,
            epsilon=epsilon,
            C_m=C_m,
            kappa_B=kappa_B,
            mu=mu,
            G_m=self.membrane_conductance * sigma_e / a,
            shear_rate=self.capillary_number * kappa_B / (mu * a**3),
        )
