r"""How the charging of a membrane changes when the membrane moves, for the linear part A.

A displacement d = h n + τ t carries V_m with the nodes. To first order, the potentials change by φ' with

    [[φ']] = h (E_n,i - E_n,e) - τ ∂_s V_m,     Λ ∂_nφ'_i - ∂_nφ'_e = -∂_s(h (Λ E_t,i - E_t,e))

on the membrane where it was. With φ' = S q' - D [[φ']] and a = S ∂_α [[φ']], both conditions are one equation for q':

    (½ + η S') q' = ∂_s(η a - h (Λ E_t,i - E_t,e)/(1+Λ))

and the current E_n,e through the membrane, which charges it, changes at a node by

    δE_n,e = (½ - S') q' + ∂_s(a - h E_t,e) - κ h E_n,e + τ ∂_s E_n,e

These are the shape derivatives of a transmission problem [H]. In waves of wavenumber k the rate of V_m changes by about
Λ k/(χ (1+Λ)) times the local field and h. If this rate exceeds that of the steps, and V_m is implicit but this
dependence is explicit, errors of V_m lose their order, and the steps become smaller.

Only the membrane itself moves here; the change of the potential on other membranes stays explicit.

A stage with c = γh needs this only if c is not short compared to the charging time χ. In shorter stages V_m hardly
follows the shape, and the explicit part is as accurate.

[H] F. Hettlich, Fréchet derivatives in inverse obstacle scattering, Inverse Problems 11 (1995) 371.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve, d_ds
from ..numerics import fourier, linear
from ..numerics.arrays import Nodes, PerVesicle, Scalar, VesicleNodes, VesiclePoints
from ..operators.surfaces import Surfaces
from ..physics.electric import SurfaceFields

_SHORT = 0.1  # a stage is short if c/χ is below this for all membranes


class ChargingOfShape(eqx.Module):
    """The derivative of dV_m/dt with respect to the shape at one instant, at fixed V_m of the nodes.

    `charge` solves with ½ + η S' of each membrane, `share` (M,) is Λ/(1+Λ), and `chi` (M,) is χ of each membrane.
    `V_slope` and `current_slope` are the derivatives of V_m and E_n,e along the membrane. `cut` modes are removed from
    the rates.
    """

    charge: linear.AbstractFactoredDense
    fields: SurfaceFields
    V_slope: VesicleNodes
    current_slope: VesicleNodes
    share: PerVesicle
    chi: PerVesicle
    cut: int = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        surfaces: Surfaces,
        charge: linear.AbstractFactoredDense,
        fields: SurfaceFields,
        V_m: VesicleNodes,
        share: PerVesicle,
        chi: PerVesicle,
        cut: int,
    ) -> "ChargingOfShape":
        """Computes what does not depend on the displacement."""
        return cls(charge, fields, surfaces.d_ds(V_m), surfaces.d_ds(fields.outer_normal), share, chi, cut)

    def __call__(self, surfaces: Surfaces, dx: VesiclePoints, c: Scalar) -> dict[str, VesicleNodes]:
        """Returns c times the change of dV_m/dt (M, N) that a displacement (M, N, 2) of the `surfaces` causes.

        It is zero in short stages.
        """
        own = surfaces.curves, surfaces.laplace_slp, surfaces.laplace_slp_dn
        share = c / self.chi

        def change():
            parts = self.charge, self.fields, self.V_slope, self.current_slope, self.share, dx
            current = jax.vmap(_change_of_current)(*own, *parts)
            return fourier.low_pass(share[:, None] * current, self.cut)

        return {"V_m": jax.lax.cond(jnp.any(share > _SHORT), change, lambda: jnp.zeros_like(self.V_slope))}


def _change_of_current(
    curve: Curve,
    slp: Float[Array, "N N"],
    slp_dn: Float[Array, "N N"],
    charge: linear.AbstractFactoredDense,
    fields: SurfaceFields,
    V_slope: Nodes,
    current_slope: Nodes,
    share: Float[Array, ""],
    dx: Float[Array, "N 2"],
) -> Nodes:
    """Returns δE_n,e at the nodes of one membrane."""
    h, along = jnp.sum(curve.normal * dx, axis=-1), jnp.sum(curve.tangent * dx, axis=-1)
    jump = h * (fields.inner_normal - fields.outer_normal) - along * V_slope
    a = slp @ fourier.derivative(jump)
    pulled = h * fields.outer_tangential
    flux = d_ds((2 * share - 1) * a + (1 - share) * pulled - share * h * fields.inner_tangential, curve)
    q = charge.solve_columns(flux[:, None])[:, 0]
    through = 0.5 * q - slp_dn @ (curve.speed * q) + d_ds(a - pulled, curve)
    return through + along * current_slope - curve.curvature * h * fields.outer_normal
