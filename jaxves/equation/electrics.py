r"""Charging of the membranes by a field, and the electric force on them.

`AbstractElectrics` is the interface for the equation of motion. `MembraneCharging` is the model of the paper: a
capacitive membrane between two leaky dielectrics, with V_m as the only scalar. `physics/electric.py` has the formulas.
Other models are in `staged_charging`.
"""

import abc
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.curve import Curve
from ..numerics import fourier, linear
from ..numerics.arrays import Scalar, VesicleNodes, VesiclePoints, identity
from ..operators.interactions import pair_frames
from ..operators.surfaces import Surfaces
from ..physics import electric
from ..physics.electric import Field, SurfaceFields
from ..physics.scene import Scene
from .charging_of_shape import ChargingOfShape
from .coupled import assembled, solve_coupled


class AbstractElectric(eqx.Module):
    """The electric quantities at one instant.

    `traction` is f_el, the electric force per arc length, (M, N, 2). `charge` is the jump q of the normal derivative of
    the potential, (M, N). `fields` are the electric fields on both sides of the membranes.
    """

    traction: eqx.AbstractVar[VesiclePoints]
    charge: eqx.AbstractVar[VesicleNodes]
    fields: eqx.AbstractVar[SurfaceFields]

    @abc.abstractmethod
    def potential(self, scalars: dict[str, VesicleNodes]) -> VesicleNodes:
        """Returns V_m (M, N); `scalars` are those of the state. In a field averaged over its period it is the mean."""

    def greatest_potential(self, scalars: dict[str, VesicleNodes]) -> VesicleNodes:
        """Returns V_m (M, N), or the greatest value of |V_m| in a period if the field is averaged over it."""
        return self.potential(scalars)


class AbstractElectrics(eqx.Module):
    """An electric model: the rates of the scalars, and the electric force."""

    @abc.abstractmethod
    def start(self, scene: Scene, surfaces: Callable[[], Surfaces]) -> dict[str, VesicleNodes]:
        """Returns the scalars at the start by name, (M, N) each. `surfaces` computes the membranes at the start."""

    @abc.abstractmethod
    def solve(
        self, t: Scalar, surfaces: Surfaces, scalars: dict[str, VesicleNodes], *, direct: bool, factored: bool
    ) -> tuple[AbstractElectric, linear.Solution, linear.AbstractFactored | None]:
        """Returns the electric quantities at one instant, the linear solution, and factors for `linear_part`.

        With `direct`, systems that couple membranes are factorised and not solved by GMRES. `factored` says that
        `linear_part` will be called.
        """

    @abc.abstractmethod
    def rates(
        self, found: AbstractElectric, scalars: dict[str, VesicleNodes], velocity: VesiclePoints
    ) -> dict[str, VesicleNodes]:
        """Returns the time derivatives of the scalars at material points, given the velocity of the nodes."""

    @abc.abstractmethod
    def linear_part(self, surfaces: Surfaces, factors: linear.AbstractFactored | None) -> Float[Array, "M n n"] | None:
        """Returns the linear part of `rates` for each membrane, for all its scalars in the order of their names.

        It is None if the scalars are solved for within the stages of a step (`staged_charging`).
        """

    def shape_part(
        self,
        surfaces: Surfaces,
        found: AbstractElectric,
        scalars: dict[str, VesicleNodes],
        factors: linear.AbstractFactored | None,
    ) -> Callable[[Surfaces, VesiclePoints, Scalar], dict[str, VesicleNodes]] | None:
        """Returns the function from these surfaces, a displacement (M, N, 2) and c to c times the change of `rates`.

        The scalars are fixed. The function may leave out other membranes, and everything if c is short. None, which is
        the default, leaves this dependence to explicit stages.
        """
        return None


class MembraneElectric(AbstractElectric):
    """The electric quantities for capacitive membranes. `w` (M, N) is the unknown of the integral equation, q = η w."""

    w: VesicleNodes
    charge: VesicleNodes
    traction: VesiclePoints
    fields: SurfaceFields

    def potential(self, scalars):
        return scalars["V_m"]


class MembraneCharging(AbstractElectrics):
    """χ dV_m/dt + G V_m = Λ/(1+Λ) w. The charge in the fluids is in equilibrium at every instant.

    `solver` solves for the charge of one membrane if its factors are not needed. `cut` modes are removed from rates.
    """

    field: Field
    solver: linear.AbstractSolver
    cut: int = eqx.field(static=True)

    def start(self, scene, surfaces):
        return {"V_m": jnp.zeros(scene.x.shape[:2]) if scene.V_m is None else scene.V_m}

    def solve(self, t, surfaces, scalars, *, direct, factored):
        V_m = scalars["V_m"]
        solution, factors = self._charge(t, surfaces, V_m, direct, factored)
        w = solution.value
        charge = self.field.contrast()[:, None] * w
        fields = self._fields(t, surfaces, V_m, w, charge)
        traction = jax.vmap(electric.maxwell_traction)(surfaces.curves, fields, self.field.permittivity_ratio)
        return MembraneElectric(w, charge, self.field.stress_scale() * traction, fields), solution, factors

    def rates(self, found, scalars, velocity):
        return {"V_m": fourier.low_pass(self.field.charging_rate(scalars["V_m"], found.w), self.cut)}

    def linear_part(self, surfaces, factors):
        field = self.field

        def of_one(curve, laplace_slp, factors, share, conductance, chi):
            return _charging_matrix(curve, laplace_slp, factors, share, conductance, chi, self.cut)

        return jax.vmap(of_one)(
            surfaces.curves,
            surfaces.laplace_slp,
            factors,
            electric.inner_share(field.conductivity_ratio),
            field.membrane_conductance,
            field.membrane_chi,
        )

    def shape_part(self, surfaces, found, scalars, factors):
        share = electric.inner_share(self.field.conductivity_ratio)
        parts = factors, found.fields, scalars["V_m"], share, self.field.membrane_chi
        return ChargingOfShape.of(surfaces, *parts, self.cut)

    def _charge(self, t: Scalar, surfaces: Surfaces, V_m: VesicleNodes, direct: bool, factored: bool):
        field = self.field
        curves = surfaces.curves
        mean = 1.0 / jnp.sum(curves.speed, axis=1, keepdims=True)
        kernel = surfaces.laplace_slp_dn * field.contrast()[:, None, None] + mean[:, None]
        matrices = 0.5 * identity(V_m.shape[1]) + kernel * curves.speed[:, None, :]
        flux = electric.component(curves.normal, field.at(curves.x, t)) + surfaces.dlp_dn(V_m)
        across = surfaces.interactions
        # The linear part and the preconditioner of GMRES need the factors. Otherwise the solver may be iterative.
        solver = self.solver if across is None and not factored else linear.Dense()
        charge = jax.vmap(lambda matrix: solver.factor(linear.LinearOperator(matrix)))(matrices)
        if across is None:
            return jax.vmap(lambda charge, b: charge.solve(b))(charge, flux), charge
        if not direct:

            def respond(across, w):
                return jnp.sum(curves.normal * across.slp_gradient(field.contrast()[:, None] * w), axis=-1)

            return solve_coupled(charge, respond, across, flux), charge
        pairs = across.matrices()
        target, _ = pair_frames(curves)
        normal = jnp.moveaxis(target.normal, -1, 1)[..., None]
        eta = jnp.repeat(field.contrast(), V_m.shape[1])
        coupled = pairs.scattered(jnp.sum(normal * pairs.gradient, axis=1)) * eta
        return assembled(matrices, coupled).solve(flux.reshape(-1)).reshaped(*flux.shape), charge

    def _fields(self, t: Scalar, surfaces: Surfaces, V_m: VesicleNodes, w: VesicleNodes, charge: VesicleNodes):
        slope = surfaces.potential_slope(charge, V_m)
        E = self.field.at(surfaces.curves.x, t)
        return jax.vmap(electric.surface_fields, in_axes=(0, None if E.ndim == 1 else 0, 0, 0, 0, 0))(
            surfaces.curves, E, self.field.conductivity_ratio, w, V_m, slope
        )


def _charging_matrix(
    curve: Curve,
    laplace_slp: Float[Array, "N N"],
    charge: linear.AbstractFactoredDense,
    share: Scalar,
    conductance: Scalar,
    chi: Scalar,
    cut: int,
) -> Float[Array, "N N"]:
    """Returns (Λ/(1+Λ) (½ + S'η)⁻¹ D' - G)/χ of one membrane.

    `share` is Λ/(1+Λ), and `charge` solves with ½ + S'η.
    """
    N = curve.speed.shape[0]
    low_pass = fourier.low_pass_matrix(N, cut)
    # ∂ · kernel · ∂ · filter / |x_α|; the kernel is symmetric, so kernel · ∂ = -(∂ · kernel)ᵀ
    symbol = fourier.derivative_symbol(N) * fourier.low_pass_symbol(N, cut)
    dlp_dn = -fourier.derivative(fourier.multiply(laplace_slp, symbol, axis=0).T, axis=0) / curve.speed[:, None]
    response = fourier.low_pass_rows(share * charge.solve_columns(dlp_dn), cut)
    return (response - conductance * low_pass) / chi
