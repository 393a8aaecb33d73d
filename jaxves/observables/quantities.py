"""Names, units, meanings and axes of the diagnostics. `diagnostics` computes them. Nothing here imports JAX."""

from typing import NamedTuple


class Quantity(NamedTuple):
    """The unit (in the paper's scales), the meaning, and the names of the axes."""

    units: str
    long_name: str
    dims: tuple[str, ...]


_EACH, _RUN = ("t", "vesicle"), ("t",)
QUANTITIES = {
    "area": Quantity("a^2", "enclosed area", _EACH),
    "length": Quantity("a", "perimeter", _EACH),
    "center": Quantity("a", "centroid of the enclosed area", (*_EACH, "xy")),
    "deformation": Quantity("1", "(√I_yy - √I_xx)/(√I_yy + √I_xx), positive when long in y", _EACH),
    "deformation_along_field": Quantity("1", "the same with y along the field", _EACH),
    "deformation_period_mean": Quantity("1", "its mean over the last whole period of the field", _EACH),
    "deformation_period_least": Quantity("1", "its least value in the last whole period, of the ends of steps", _EACH),
    "deformation_period_greatest": Quantity("1", "its greatest value there", _EACH),
    "deformation_period_change": Quantity("1", "its change from the start to the end of that period", _EACH),
    "inclination": Quantity("rad", "angle of the major axis from x, in (-π/2, π/2]", _EACH),
    "inclination_unwrapped": Quantity("rad", "angle of the major axis from x, followed in time", _EACH),
    "tank_treading_speed": Quantity("a/t_kappa", "mean tangential velocity, counter-clockwise, about its mean", _EACH),
    "bending_energy": Quantity("kappa_B/a", "½ ∮ κ_B κ² ds", _EACH),
    "tension_min": Quantity("kappa_B/a^2", "least physical tension λ of the interpolant", _EACH),
    "tension_max": Quantity("kappa_B/a^2", "greatest physical tension λ of the interpolant", _EACH),
    "max_curvature": Quantity("1/a", "largest |curvature| of the interpolant", _EACH),
    "spectral_tail": Quantity("1", "top of the spectrum of x and V_m over its largest mode", _EACH),
    "tension_tail": Quantity("1", "top of the spectrum of the tension over its largest mode", _EACH),
    "metric_error": Quantity("1", "largest relative deviation of the node spacing, at the nodes", _EACH),
    "force_residual": Quantity("1", "∮ f ds over ∮ |f| ds of bending and tension, zero but for discretisation", _EACH),
    "torque_residual": Quantity("1", "∮ x × f ds over ∮ |x| |f| ds about the centroid, likewise", _EACH),
    "self_gap": Quantity("a", "narrowest chord of the interpolant, of parts twice as far apart along it", _EACH),
    "neighbor_distance": Quantity("a", "distance of the centre to the nearest other, of more than two vesicles", _EACH),
    "dipole": Quantity("eps E_inf a^2", "∮ (q x - V_m n) ds about the centroid", (*_EACH, "xy")),
    "dipole_angle": Quantity("rad", "angle of the dipole from x, in (-π, π]", _EACH),
    "averaged_swing": Quantity("a", "swing of the nodes within a period, which an averaged field leaves out", _EACH),
    "interfacial_charge": Quantity("eps_e E_inf a", "∮ Q ds, the charge of both faces of the membrane", _EACH),
    "lipid_tension_max": Quantity("kappa_B/a^2", "greatest λ + ½ C_m V_m², with the share of the capacitor", _EACH),
    "charge": Quantity("E_inf a", "∮ q ds", _EACH),
    "max_V_m": Quantity("E_inf a", "largest |V_m| of the interpolant, which electroporation depends on", _EACH),
    "torque": Quantity("kappa_B/a", "electric torque about the centroid", _EACH),
    "traction_ratio": Quantity("1", "∮ |f_el·t| ds / ∮ |f_el·n| ds, zero without traction", _EACH),
    "min_gap": Quantity("a", "least distance between two membranes, of the interpolants", _RUN),
    "film_error": Quantity("1", "estimated relative error of the drainage of the thinnest film", _RUN),
    "separation": Quantity("a", "distance of the centres of two vesicles", _RUN),
    "line_angle": Quantity("rad", "angle from x of the line of two centres, second to first, in (-π, π]", _RUN),
    "stress": Quantity("kappa_B/a^3", "particle stress -(1/A) Σ ∮ f_hd ⊗ x ds", (*_RUN, "xy", "ab")),
    "effective_viscosity": Quantity("1", "intrinsic viscosity [μ] of the dilute suspension", _RUN),
    "mean_current": Quantity("sigma_e E_inf", "mean current density in the periodic cell", (*_RUN, "xy")),
    "effective_conductivity": Quantity("sigma_e", "component of the mean current along the field, over it", _RUN),
    "mean_stress": Quantity(
        "kappa_B/a^3", "mean stress in the periodic cell, without pressure and viscous stress", (*_RUN, "xy", "ab")
    ),
    "normal_stress_difference": Quantity("kappa_B/a^3", "xx less yy component of the mean stress", _RUN),
    "relative_viscosity": Quantity("1", "shear stress in the periodic cell over that of the fluid alone", _RUN),
    "power_flow": Quantity("kappa_B/(a t_kappa)", "power of the imposed flow", _RUN),
    "power_electric": Quantity("kappa_B/(a t_kappa)", "power of the electric force", _RUN),
    "dissipation": Quantity("kappa_B/(a t_kappa)", "viscous dissipation of the disturbance", _RUN),
    "power_balance": Quantity("kappa_B/(a t_kappa)", "dE_b/dt less all powers: zero but for discretisation", _RUN),
    "time_error": Quantity("a", "sum of the estimated errors of all steps so far", _RUN),
    "residual": Quantity("1", "worst true relative residual of the linear solves", _RUN),
}


def described(name: str, axes: int) -> Quantity:
    """Returns the quantity of this name, or that of an observable of the user's own with this number of axes.

    The unit of such an observable is not known. Its axes are the time, and the vesicles if it has two.
    """
    return QUANTITIES.get(name) or Quantity("", f"{name}, an observable of the user's own", _EACH[:axes])
