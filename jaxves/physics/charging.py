r"""Laws of charging, solved for one implicit stage: densities as affine functions of the mean normal field.

With g the mean of the normal fields on both sides of a membrane, E_n = g - q/2 inside and g + q/2 outside. All charge
sits on the faces of the membrane, so each law is local but for g. At material points it reads

    relaxed    q = 2η g,                                    χ V' = 2Λ/(1+Λ) g - G V
    relaxing   t_c Q' = Λ E_n,i - E_n,e,                    χ W' = ½(Λ E_n,i + E_n,e) - G V
               Q = E_n,e - ε E_n,i,                          W = V - (δ/2)(ε E_n,i + E_n,e)

Here η = (Λ-1)/(Λ+1) and t_c = χδ = ε_e/σ_e in units of t_κ. In `relaxed` the charge in the fluids is in equilibrium,
which is the limit δ → 0. In `relaxing` it takes the time t_c. Q is the charge of both faces together in units of
ε_e|E_∞|, and W is half of the difference of their charges in units of C_m a|E_∞|. The charges follow from conservation
on each face, Q_e = ε_e E_n,e - C_m V and Q_i = C_m V - ε_i E_n,i. The membrane does not stretch, so convection along
the membrane is contained in the material derivative.

A stage of an implicit scheme asks for s with s = s_0 + c s' at the same instant. In an AC field the scalars are complex
envelopes, V(t) = Re[V̂ e^{iωt}], and s' contains -iω s. `shift` is iω, or zero.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Inexact

from ..numerics.arrays import Scalar
from .electric import Field, inner_share

Shift = Inexact[Array, ""] | float
Coefficients = Inexact[Array, "M"] | Inexact[Array, "M 1"]
Values = Inexact[Array, "M N"]


class Affine(NamedTuple):
    """value + slope · g, with one slope for each membrane, (M, 1)."""

    value: Values
    slope: Coefficients

    def at(self, g: Values) -> Values:
        """Returns the values at the mean normal field g."""
        return self.value + self.slope * g


class Densities(NamedTuple):
    """The jump q of the normal field, the potential V, and the scalars by name.

    `neutral` says that no membrane has a net charge, ∮ q ds = 0. For q = 2η g the mean of g is then zero.
    """

    q: Affine
    V: Affine
    scalars: dict[str, Affine]
    neutral: bool = False


class Relaxed(NamedTuple):
    """Charge in the fluids is in equilibrium. The only scalar is V_m."""

    field: Field
    names = ("V_m",)

    def charged(self, V_m: Values, g: Values) -> dict[str, Values]:
        """Returns the scalars for this potential, with relaxed charge at the mean normal field g."""
        return {"V_m": V_m}

    def densities(self, start: dict[str, Values], c: Scalar, shift: Shift = 0.0) -> Densities:
        """Returns q, V and the scalars of a stage as functions of g, from `start` = s_0."""
        field = self.field
        chi = field.membrane_chi[:, None]
        share = inner_share(field.conductivity_ratio)[:, None]
        d = 1 / (1 + c * shift + c * field.membrane_conductance[:, None] / chi)
        V = Affine(d * start["V_m"], 2 * c * share / chi * d)
        q = Affine(jnp.zeros_like(V.value), 2 * field.contrast()[:, None])
        return Densities(q, V, {"V_m": V}, neutral=True)

    def rates(self, found: dict[str, Values], V: Values, g: Values, shift: Shift = 0.0):
        """Returns s' at the scalars `found`, the potential V and the mean normal field g."""
        field = self.field
        share = inner_share(field.conductivity_ratio)[:, None]
        rate = (2 * share * g - field.membrane_conductance[:, None] * V) / field.membrane_chi[:, None]
        return {"V_m": rate - shift * V}


class Relaxing(NamedTuple):
    """Charge in the fluids relaxes in the time t_c. The scalars are Q and W."""

    field: Field
    names = ("Q", "W")

    def _numbers(self):
        """Returns Λ, G, χ, ε, η_ε and δ of each membrane (M, 1), with δ for its own capacitance, and t_c."""
        field = self.field
        t_c = field.relaxation_time()
        parts = field.conductivity_ratio, field.membrane_conductance, field.membrane_chi, field.permittivity_ratio
        ratio, conductance, chi, epsilon = (part[:, None] for part in parts)
        return ratio, conductance, chi, epsilon, (epsilon - 1) / (epsilon + 1), t_c / chi, t_c

    def densities(self, start: dict[str, Values], c: Scalar, shift: Shift = 0.0) -> Densities:
        """Returns q, V and the scalars of a stage as functions of g, from `start` = s_0."""
        ratio, conductance, chi, epsilon, eta, delta, t_c = self._numbers()
        both = 1 + epsilon
        kappa = 2 * delta * epsilon / both
        # E_n,i = (2g - Q)/(1+ε) and E_n,e = (2ε g + Q)/(1+ε), from which Q' and W' follow.
        d = 1 / (1 + c * shift + c * (1 + ratio) / (t_c * both))
        Q = Affine(d * start["Q"], 2 * d * c * (ratio - epsilon) / (t_c * both))
        e = 1 / (1 + c * shift + c * conductance / chi)
        of_g = c / chi * ((ratio + epsilon) / both - conductance * kappa)
        of_Q = c / chi * 0.5 * ((1 - ratio) / both + conductance * delta * eta)
        W = Affine(e * (start["W"] + of_Q * Q.value), e * (of_g + of_Q * Q.slope))
        V = Affine(W.value - 0.5 * delta * eta * Q.value, W.slope + kappa - 0.5 * delta * eta * Q.slope)
        q = Affine(2 * Q.value / both, 2 * Q.slope / both + 2 * eta)
        return Densities(q, V, {"Q": Q, "W": W})

    def rates(self, found: dict[str, Values], V: Values, g: Values, shift: Shift = 0.0):
        """Returns s' at the scalars `found`, the potential V and the mean normal field g."""
        ratio, conductance, chi, epsilon, _, _, t_c = self._numbers()
        inner, outer = (2 * g - found["Q"]) / (1 + epsilon), (2 * epsilon * g + found["Q"]) / (1 + epsilon)
        rates = {
            "Q": (ratio * inner - outer) / t_c,
            "W": (0.5 * (ratio * inner + outer) - conductance * V) / chi,
        }
        return {name: rate - shift * found[name] for name, rate in rates.items()}

    def charged(self, V_m: Values, g: Values) -> dict[str, Values]:
        """Returns the scalars for this potential, with relaxed charge at the mean normal field g."""
        ratio, _, _, epsilon, _, delta, _ = self._numbers()
        Q = 2 * (ratio - epsilon) / (1 + ratio) * g
        return {"Q": Q, "W": V_m - delta * (ratio + epsilon) / (1 + ratio) * g}
