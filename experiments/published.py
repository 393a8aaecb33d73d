"""Do single vesicles agree with what others have published: in shear, at rest, and charging?

    python -m experiments.published          # a table and a figure, about two minutes

Only values with a traceable source, and only closed forms or numbers printed in text: no figure was read off.

[KS]  S. R. Keller & R. Skalak, J. Fluid Mech. 120, 27 (1982): a membrane on an ellipsoid of axes a, b treads at
      cos 2θ = 1/(f₀ (f₁ + 1/f₁)) when the viscosities are equal, f₀ = 2/(a/b + b/a), f₁ = ½(a/b - b/a). The third axis
      has no part in it, so it holds for an elliptic cylinder; it is tan θ = b/a.
[Q]   Quasi-circular vesicles in two dimensions: R. Finken, A. Lamura, U. Seifert & G. Gompper, Eur. Phys. J. E 25, 309
      (2008) for any viscosities; the form used, cos 2θ = 2√(2(1-Δ)/3), is derived in `quasi_circular`.
[B]   J. F. Brady, Int. J. Multiphase Flow 10, 113 (1984): [μ] = 2 for discs, and a circle that cannot stretch is one.
[G]   G. Ghigliotti, T. Biben & C. Misbah, J. Fluid Mech. 653, 489 (2010), abstract: the rheology of a dilute
      two-dimensional suspension is "relatively insensitive to shear rate".
[L]   M. Lévy, J. Math. Pures Appl. 10, 5 (1884): a ring collapses at the pressure 3 κ_B/a³.
[F]   J. E. Flaherty, J. B. Keller & S. I. Rubinow, SIAM J. Appl. Math. 23, 446 (1972): its sides touch at 5.247.
      Between the two the ring is the elastica κ_ss + κ³/2 - λκ = p, solved here as a boundary-value problem; vesicles
      left alone must end on it.
[S]   H. P. Schwan's equation for a cylinder: V_m = 2 a E (1 - e^{-t/τ}), τ = a C_m (1/σ_i + 1/σ_e): see, e.g.,
      K. R. Foster & H. P. Schwan, Crit. Rev. Biomed. Eng. 17, 25 (1989).

What to expect: [B], [L], [F], [S] to their digits. [Q] and [KS] are approximations: both tend to the truth as Δ → 1;
[KS], whose ellipse neither deforms nor keeps its elements of length, stays within 3 degrees down to Δ = 0.6.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import solve_bvp

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import curve as geometry
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.physics.scene import dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate

from . import quasi_circular, shear
from ._common import save, store, styled

AREAS = (0.6, 0.7, 0.8, 0.9, 0.97, 0.99)
QUICK = dict(areas=(0.9,), N=32, tolerance=1e-4, t_end=1.5, shears=(10.0,), rest=(0.9,))


def keller_skalak(reduced_area) -> float:
    """Returns the inclination in radians of the ellipse of this reduced area."""
    moment = np.sort(np.linalg.eigvalsh(geometry.second_moments(Curve.from_nodes(shapes.ellipse(256, reduced_area)))))
    ratio = float(np.sqrt(moment[1] / moment[0]))  # a/b
    f0, f1 = 2 / (ratio + 1 / ratio), 0.5 * (ratio - 1 / ratio)
    return 0.5 * np.arccos(1 / (f0 * (f1 + 1 / f1)))


def quasi(reduced_area) -> float:
    """Returns the inclination in radians of the quasi-circular vesicle; NaN if the theory has none."""
    cosine = 2 * float(quasi_circular.amplitude(reduced_area))
    return 0.5 * np.arccos(cosine) if cosine < 1 else np.nan


def elastica(reduced_area=None, points=200) -> dict[str, float]:
    """The two-fold ring of perimeter 2π with this area, or (None) the one whose sides touch.

    Pressure p (outside minus inside), tension λ, energy ½∮κ² ds, half-width of the waist, and reduced area.
    """

    def slope(s, y, constants):
        theta, kappa, rate, _, height, _ = y
        tension, pressure = constants
        return np.stack([
            kappa, rate, pressure + tension * kappa - 0.5 * kappa**3, np.cos(theta), np.sin(theta),
            -height * np.cos(theta),
        ])  # fmt: skip

    def ends(a, b, constants):
        last = a[4] if reduced_area is None else b[5] - 0.25 * np.pi * reduced_area
        return np.array([a[0], a[2], a[3], a[5], b[0] - 0.5 * np.pi, b[2], b[4], last])

    s = np.linspace(0, 0.5 * np.pi, points)
    # From a nearly round ring on, in steps of area, so that the branch is the two-fold one.
    u = 0.2 * np.cos(2 * s)
    guess = np.stack([s - 0.75 * np.sin(2 * s) * 0.2, 1 - 3 * u, 6 * u, np.sin(s), -np.cos(s), 0.5 * s])
    constants = np.array([-2.5, 3.0])
    target, wanted = reduced_area, 0.35 if reduced_area is None else reduced_area
    for reduced_area in [*np.arange(0.95, wanted, -0.05), target]:
        found = solve_bvp(slope, ends, s, guess, p=constants, tol=1e-8, max_nodes=20_000)
        if not found.success:
            raise RuntimeError(f"elastica at reduced area {reduced_area}: {found.message}")
        guess, constants = found.sol(s), found.p
    return {
        "pressure": float(constants[1]),
        "tension": float(constants[0]),
        "energy": float(2 * np.trapezoid(guess[1] ** 2, s)),
        "half-width": float(-guess[4, 0]),
        "area": float(4 * guess[5, -1] / np.pi),
    }


@eqx.filter_jit
def _at_rest(reduced_area, N, tolerance, t_end):
    setting = make_scene(shapes.ellipse(N, reduced_area))
    result = simulate(setting, t_end, saves=1, march=Adaptive(tolerance))
    motion = equation_for(setting).motion(jnp.zeros(()), Unknowns.of(result.x[-1]))
    curve = Curve.from_nodes(result.x[-1, 0])
    normal = jnp.sum(motion.f_hd[0] * curve.normal, axis=-1)
    return {
        "pressure": jnp.mean(normal),
        "unevenness": jnp.max(jnp.abs(normal - jnp.mean(normal))),
        "tension": jnp.mean(result.tension[-1, 0]),
        "energy": result.diagnostics["bending_energy"][-1, 0],
    }


def at_rest(reduced_area, N=96, tolerance=1e-7, t_end=6.0) -> dict[str, float]:
    """Returns pressure, tension and energy of a vesicle at rest, and how much its force deviates from uniform."""
    found = _at_rest(jnp.asarray(reduced_area), N, jnp.asarray(tolerance), jnp.asarray(t_end))
    return {name: float(value) for name, value in found.items()}


@eqx.filter_jit
def charging(ratio, N=32, t_end=0.3, chi=0.08):
    """Returns the largest deviation of V_m on a circle from the formula for a cylinder, divided by the bound 2."""
    field = dc_field(0.0, conductivity_ratio=ratio, chi=chi)
    result = simulate(make_scene(shapes.circle(N), field=field), t_end, saves=4, march=Adaptive(1e-9))
    exact = 2 * (1 - jnp.exp(-result.t / (chi * (1 / ratio + 1))))
    return jnp.max(jnp.abs(result.V_m[:, 0] - exact[:, None] * jnp.sin(fourier.grid(N)))) / 2


def run(areas=AREAS, N=64, tolerance=1e-6, t_end=4.0, shears=(1.0, 10.0, 100.0), rest=(0.6, 0.8, 0.9, 0.97, 0.99)):
    """Steady shear by Δ; [μ] at Δ = 0.8 by Ca; vesicles at rest and the elastica by Δ; the ring that touches; V_m."""
    return {
        "shear": {
            area: shear.steady(area, N, tolerance, t_end=t_end) | {"KS": keller_skalak(area), "Q": quasi(area)}
            for area in areas
        },
        "shear rate": {Ca: shear.steady(0.8, N, tolerance, Ca, 10 * t_end / Ca) for Ca in shears},
        "rest": {area: {"vesicle": at_rest(area), "elastica": elastica(area)} for area in rest},
        "touching": elastica(),
        "charging": {ratio: float(charging(jnp.asarray(ratio))) for ratio in (0.1, 10.0)},
    }


def limit(found) -> dict[str, float]:
    """Returns [μ] and the pressure at Δ = 1, by a straight line in 1 - Δ through the two roundest vesicles."""
    near = sorted(found["shear"])[-2:]
    viscosity = np.polyfit([1 - a for a in near], [found["shear"][a]["viscosity"] for a in near], 1)[-1]
    rest = sorted(found["rest"])[-2:]
    pressure = np.polyfit([1 - a for a in rest], [found["rest"][a]["vesicle"]["pressure"] for a in rest], 1)[-1]
    return {"viscosity": float(viscosity), "pressure": float(pressure)}


@styled
def draw(found) -> Figure:
    """Draws inclination against Δ with both theories, and the pressure of vesicles at rest with the elastica."""
    figure = Figure(figsize=(run_plots.PAGE, 2.5))
    left, right = figure.subplots(1, 2)
    fine = np.linspace(0.55, 0.999, 60)
    left.plot(fine, np.rad2deg([keller_skalak(a) for a in fine]), label="Keller & Skalak: tan θ = b/a")
    left.plot(fine, np.rad2deg([quasi(a) for a in fine]), "--", label="quasi-circular")
    areas = np.array(list(found["shear"]))
    left.plot(areas, np.rad2deg([row["inclination"] for row in found["shear"].values()]), "ko", ms=3.5, label="jaxves")
    left.set(xlabel=r"$\Delta$", ylabel="inclination in shear (°)", ylim=(0, 46))
    left.legend()
    touching = found["touching"]
    curve = np.linspace(touching["area"] + 0.01, 0.98, 12)
    right.plot(curve, [elastica(a)["pressure"] for a in curve], label="elastica")
    right.plot(touching["area"], touching["pressure"], "^", color="#D55E00", ms=5, label="sides touch, 5.247 [F]")
    right.plot(1.0, 3.0, "D", color="#009E73", ms=4, label="ring collapses, 3 [L]")
    rest = found["rest"]
    right.plot(list(rest), [row["vesicle"]["pressure"] for row in rest.values()], "ko", ms=3.5, label="jaxves, at rest")
    right.set(xlabel=r"$\Delta$", ylabel=r"pressure $p$ ($\kappa_B/a^3$)")
    right.legend()
    return figure


def main():
    found = run()
    ends = limit(found)
    print("Δ       inclination (°)  Keller-Skalak  quasi-circular  [μ]")
    for area, row in found["shear"].items():
        angles = np.rad2deg([row["inclination"], row["KS"], row["Q"]])
        print(f"{area:<6}  {angles[0]:9.3f}        {angles[1]:9.3f}      {angles[2]:9.3f}     {row['viscosity']:.5f}")
    print(f"[μ] at Δ → 1: {ends['viscosity']:.4f}; Brady's disc 2")
    rates = ", ".join(f"Ca = {Ca:g}: {row['viscosity']:.4f}" for Ca, row in found["shear rate"].items())
    print(f"[μ] at Δ = 0.8: {rates}; Ghigliotti et al.: relatively insensitive to shear rate")
    for area, row in found["rest"].items():
        vesicle, ring = row["vesicle"], row["elastica"]
        print(
            f"at rest, Δ = {area}: pressure {vesicle['pressure']:.6f} (elastica {ring['pressure']:.6f}), tension "
            f"{vesicle['tension']:.5f} ({ring['tension']:.5f}), energy {vesicle['energy']:.6f} ({ring['energy']:.6f}); "
            f"force uneven by {vesicle['unevenness']:.0e}"
        )
    print(f"pressure at Δ → 1: {ends['pressure']:.4f}; Lévy's ring 3")
    print(
        f"sides touch at p = {found['touching']['pressure']:.4f} (Flaherty et al. 5.247), "
        f"Δ = {found['touching']['area']:.4f}"
    )
    print("charging of a circle, largest deviation:", *(f"Λ = {k:g}: {v:.0e}" for k, v in found["charging"].items()))
    store("published", found | {"limits": ends})
    save(draw(found), "published")


if __name__ == "__main__":
    main()
