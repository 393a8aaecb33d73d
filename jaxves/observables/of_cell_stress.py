r"""The mean stress of a suspension in a periodic cell, with the Maxwell stress of a field.

    ⟨σ⟩ = -⟨p⟩ 1 + 2⟨e⟩ + Σ,     T = ε (E E - ½ E² 1)
    Σ = -(1/A) Σ ∮ (f_b + f_λ) ⊗ x ds + (1/A) Σ (ν - 1) ∮ (v ⊗ n + n ⊗ v) ds + (β/χ) ⟨T⟩

⟨⟩ is the mean over the cell with the area A, and e the rate of strain. The term with the viscosity ratio ν is the
integral of 2 (ν - 1) e over the insides. Bending and tension exert no net force and no
torque on a membrane. Their part therefore does not depend on the image of a vesicle that is taken, and it is symmetric.
The moment of f_hd, which is the particle stress in the plane, would depend on the image: in a field each vesicle
carries a net electric force.

⟨T⟩ follows from sums over the membranes. With m = ∂_s V_m, the mean field Ē of the bulk, and J = [[0, 1], [-1, 0]]:

    𝒬[a, b]_ij = (1/A) Σ ∮ a (δ_ij S[b] - S_Stokes[b e_j]_i) ds
    ⟨E E⟩ = Ē Ē + 𝒬[q, q] + J 𝒬[m, m] Jᵀ - 𝒬[q, m] Jᵀ - J 𝒬[q, m]ᵀ

The kernel of 𝒬 is k_i k_j/k⁴ in Fourier space, and S[b] is the trace of S_Stokes[b e_j]_i. If permittivities differ,
T/ε times ε_i - ε_e is integrated over the insides, where the integral of T is the moment of T·n on the membrane.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..equation.state import Motion
from ..geometry.domain import AbstractDomain
from ..numerics.arrays import Scalar, VesicleNodes
from ..operators.surfaces import Surfaces
from ..physics.flow import Shear
from ..physics.scene import Scene
from .inner_stress import excess_viscous
from .registry import Instant, gives

_J = np.array([[0.0, 1.0], [-1.0, 0.0]])
Tensor = Float[Array, "2 2"]


def mean_maxwell_stress(
    surfaces: Surfaces, domain: AbstractDomain, E_inf: Float[Array, "2"], q: VesicleNodes, V_m: VesicleNodes
) -> Tensor:
    """Returns ⟨E E - ½ E² 1⟩ over a periodic cell, for the permittivity 1 inside and outside."""
    area, slope = domain.area(), surfaces.d_ds(V_m)
    of_q, of_m = _responses(surfaces, q), _responses(surfaces, slope)

    def moment(a, response):
        return jnp.einsum("mn,mnij->ij", a * surfaces.curves.weights, response) / area

    crossed = moment(q, of_m) @ _J.T
    mean = E_inf - surfaces.interactions.mean_dipole(V_m)
    square = jnp.outer(mean, mean) + moment(q, of_q) + _J @ moment(slope, of_m) @ _J.T - crossed - crossed.T
    square = 0.5 * (square + square.T)
    return square - 0.5 * jnp.trace(square) * jnp.eye(2)


def _responses(surfaces: Surfaces, b: VesicleNodes) -> Float[Array, "M N 2 2"]:
    """Returns δ_ij S[b] - S_Stokes[b e_j]_i at the nodes."""
    velocity = jnp.stack([surfaces.stokes(b[..., None] * unit) for unit in np.eye(2)], axis=-1)
    return jnp.trace(velocity, axis1=-2, axis2=-1)[..., None, None] * np.eye(2) - velocity


def mean_stress(motion: Motion, scene: Scene, domain: AbstractDomain, t: Scalar, V_m: VesicleNodes | None) -> Tensor:
    """Returns Σ (2, 2), in κ_B/a³; `V_m` is None without a field."""
    curves, electric = motion.surfaces.curves, motion.electric
    elastic = motion.f_hd if electric is None else motion.f_hd + electric.traction
    # Arms from the centroids keep the digits of distant vesicles; ∮ (f_b + f_λ) ds is zero.
    weights = curves.weights[..., None]
    middle = jnp.sum(curves.x * weights, axis=1, keepdims=True) / jnp.sum(weights, axis=1, keepdims=True)
    moment = -jnp.einsum("mna,mnb->ab", elastic, (curves.x - middle) * weights)
    if scene.viscosity_ratio is not None:
        moment = moment + excess_viscous(motion, scene.viscosity_ratio)
    if electric is None:
        return moment / domain.area()
    fields = electric.fields
    E_n, E_t = fields.inner_normal, fields.inner_tangential
    normal, tangential = 0.5 * (E_n**2 - E_t**2), E_n * E_t
    traction = normal[..., None] * curves.normal + tangential[..., None] * curves.tangent
    excess = (scene.field.permittivity_ratio - 1)[:, None, None] * traction
    inside = jnp.einsum("mna,mnb->ab", excess, (curves.x - middle) * weights) / domain.area()
    maxwell = mean_maxwell_stress(motion.surfaces, domain, scene.field.E_inf(t), electric.charge, V_m)
    return moment / domain.area() + scene.field.stress_scale() * (maxwell + inside)


@gives(
    "mean_stress",
    "normal_stress_difference",
    "relative_viscosity",
    needed=lambda scene: scene.cell is not None,
)
def of_mean_stress(instant: Instant, found) -> dict[str, Array]:
    """The mean stress of the cell beyond pressure and fluid, and the viscosity of the suspension in a shear flow."""
    motion, scene, t = instant.motion, instant.scene, instant.t
    V_m = None if motion.electric is None else motion.electric.potential(instant.y.scalars)
    stress = mean_stress(motion, scene, instant.equation.domain.at(t), t, V_m)
    out = {"mean_stress": stress, "normal_stress_difference": stress[0, 0] - stress[1, 1]}
    if not isinstance(scene.flow, Shear):
        return out
    return out | {"relative_viscosity": 1 + stress[0, 1] / scene.flow.capillary_number}
