r"""Does a nearly circular vesicle in shear and a field do what small-deformation theory says?

    python -m experiments.quasi_circular          # a table and a figure, about a minute

Theory, derived here for this model; a = 1 on the unit circle, u_m the Fourier modes e^{imθ} of r - 1, δ the field's
angle, s = Λ/(1+Λ), B = β/χ. Length and area fix |u_2|: 1 - Δ = Σ (m²-1)|u_m|², so with mode 2 alone

    u_2 = (A/2) e^{-2iψ},     A = √(2(1-Δ)/3)

and only the angle ψ is free. On the circle the Stokes layer maps normal and tangential force (p, q) of mode 2 to the
velocity (p/6 - iq/12, ip/12 + q/6). Inextensibility, v_n + 2i v_t = 0, then says q = -Ca whatever p is, and

    du_2/dt = F - 2iΩ u_2 - ½(λ₀ + 5/2) u_2,     F = -iCa/4 - (B/12) (3 ε I² - O² - T² - O T)

The mean tension λ₀ keeps |u_2|, which leaves

    dψ/dt = Ω - Im(F e^{2iψ})/A,     λ₀ = -5/2 + 4 Re(F e^{2iψ})/A,     Ω = -Ca/2 + 2 s B Im(E V*)
    dV/dt = (s (2E - V) - G V)/χ - iΩ V      mode 1 of V_m;     E = e^{-iδ}/2 that of E_∞·n
    w = 2E - V,   I = (1-s) w,   O = s w,   T = (1-s) w + V      field: normal inside, outside; tangential outside / i

Ω is the mean tangential velocity: the shear's -Ca/2 and the electric torque, which for G = 0, Ca = 0 turns the circle
by itself beyond β = 1. Viscosity: [μ] Ca = Im p - Re q + q_0 with the mode-2 and mean forces. F e^{2iδ} is real and
negative where the field presses a vesicle oblate: at first for every Λ < 1, for ever where G exceeds G_c(Λ).

What to expect: without a field nothing enters ψ between √(1-Δ) and its cube, so steady ψ errs by (1-Δ)^{3/2} and
[μ] = 2 by 1 - Δ. A field's mode 1 meets the shape's mode 2 at once: errors of √(1-Δ), of derivatives too.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Complex, Float
from matplotlib.figure import Figure

from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.observables.checks import Checks
from jaxves.physics.electric import inner_share
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.plots import run_plots
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.stepping.marching import simulate

from ._common import save, store, styled

AREAS = (0.99, 0.995, 0.999, 0.9998)
QUICK = dict(areas=(0.99, 0.995), N=32, steps=100)
FIELD = {"beta": 1.6, "ratio": 0.2, "conductance": 0.5, "shear": 2.0}


class Numbers(NamedTuple):
    """β, Λ, G, Ca, and the angle of the field; χ = 0.08."""

    beta: float | Array
    ratio: float | Array
    conductance: float | Array
    shear: float | Array
    direction: float = np.pi / 2
    chi: float = 0.08


class Circle(NamedTuple):
    """The quantities on the circle if mode 1 of V_m is V."""

    rotation: Float[Array, ""]  # Ω
    forcing: Complex[Array, ""]  # F
    normal: Complex[Array, ""]  # mode 2 of the electric force on the fluid, normal and tangential
    tangential: Complex[Array, ""]
    torque: Float[Array, ""]  # its mean tangential part


def on_the_circle(V, n: Numbers) -> Circle:
    """Returns Ω, F and the electric force for a given V."""
    s, scale = inner_share(jnp.asarray(n.ratio, dtype=float)), n.beta / n.chi
    E = 0.5 * jnp.exp(-1j * n.direction)
    w = 2 * E - V
    inside, outside, along = (1 - s) * w, s * w, (1 - s) * w + V
    normal = -scale * (inside**2 - 0.5 * (outside**2 + along**2))
    tangential = -1j * scale * (inside**2 - outside * along)
    torque = 2 * scale * jnp.imag(outside * jnp.conj(along))
    forcing = -0.25j * n.shear + (normal - 0.5j * tangential) / 6
    return Circle(-0.5 * n.shear + 0.5 * torque, forcing, normal, tangential, torque)


def amplitude(reduced_area):
    """Returns the amplitude A of u = A cos 2(θ - ψ)."""
    return jnp.sqrt(2 * (1 - reduced_area) / 3)


def rates(state, n: Numbers, reduced_area):
    """Returns (dψ/dt, dV/dt) at (ψ, V)."""
    angle, V = state
    circle = on_the_circle(V, n)
    s = inner_share(jnp.asarray(n.ratio, dtype=float))
    turning = circle.rotation - jnp.imag(circle.forcing * jnp.exp(2j * angle)) / amplitude(reduced_area)
    charging = (s * (jnp.exp(-1j * n.direction) - V) - n.conductance * V) / n.chi
    return turning, charging - 1j * circle.rotation * V


def solution(n: Numbers, reduced_area, angle, t_end, steps=4000):
    """Returns (ψ, V) at `t_end` for an uncharged vesicle at inclination `angle`; classical Runge-Kutta."""
    h = t_end / steps

    def step(y, _):
        def moved(k, c):
            return jax.tree.map(lambda a, b: a + c * h * b, y, k)

        k1 = rates(y, n, reduced_area)
        k2 = rates(moved(k1, 0.5), n, reduced_area)
        k3 = rates(moved(k2, 0.5), n, reduced_area)
        k4 = rates(moved(k3, 1.0), n, reduced_area)
        return jax.tree.map(lambda y, a, b, c, d: y + h / 6 * (a + 2 * b + 2 * c + d), y, k1, k2, k3, k4), None

    start = jnp.asarray(angle, dtype=float), jnp.zeros((), complex)
    return lax.scan(step, start, length=steps)[0]


def observables(state, n: Numbers, reduced_area) -> dict[str, Array]:
    """Returns ψ, mode 1 of V_m, mean tangential velocity, λ₀ A, and [μ] at (ψ, V)."""
    angle, V = state
    circle = on_the_circle(V, n)
    turned = circle.forcing * jnp.exp(2j * angle)
    shape = 6 * jnp.real(turned) * jnp.exp(-2j * angle)  # 3 (λ₀ + 5/2) u_2
    # With q = 2iλ_2 + q_e = -Ca the mode-2 tension is λ_2 = i(Ca + q_e)/2; it presses inward.
    normal = circle.normal - shape - 0.5j * (n.shear + circle.tangential)
    return {
        "inclination": angle,
        "potential": V,
        "speed": circle.rotation,
        "tension": 4 * jnp.real(turned) - 2.5 * amplitude(reduced_area),
        "viscosity": (jnp.imag(normal) + n.shear + circle.torque) / n.shear,
    }


def theory(n: Numbers, reduced_area, angle, t_end):
    """Returns the observables at `t_end` by the theory."""
    return observables(solution(n, reduced_area, angle, t_end), n, reduced_area)


def scene(n: Numbers, reduced_area, angle, N: int) -> Scene:
    """Returns the vesicle of the theory: an ellipse, whose mode 4 is of the order of 1 - Δ."""
    direction = (np.cos(n.direction), np.sin(n.direction))
    field = dc_field(n.beta, conductivity_ratio=n.ratio, membrane_conductance=n.conductance, direction=direction)
    return make_scene(shapes.ellipse(N, reduced_area, angle=angle), field=field, flow=Shear(n.shear))


def simulated(n: Numbers, reduced_area, angle, t_end, *, N: int, steps: int):
    """Returns the same observables from the full equations."""
    result = simulate(scene(n, reduced_area, angle, N), t_end, saves=1, march=Fixed(steps))
    curve = Curve.from_nodes(result.x[-1, 0])
    mode = jnp.sum(result.V_m[-1, 0] * (curve.normal[:, 0] - 1j * curve.normal[:, 1]) * curve.weights)
    found = result.diagnostics
    return {
        "inclination": found["inclination"][-1, 0],
        "potential": mode / (2 * jnp.pi),
        "speed": found["tank_treading_speed"][-1, 0],
        "tension": amplitude(reduced_area) * jnp.mean(result.tension[-1, 0]),
        "viscosity": found["effective_viscosity"][-1],
    }


@eqx.filter_jit
def with_derivatives(of, numbers, reduced_area, *arguments, **options):
    """Returns values, and their derivatives with respect to β and Λ."""

    def values(beta, ratio):
        n = Numbers(**numbers)._replace(beta=beta, ratio=ratio)
        return of(n, reduced_area, *arguments, **options)

    at = jnp.asarray(numbers["beta"]), jnp.asarray(numbers["ratio"])
    value, by_beta = jax.jvp(values, at, (jnp.ones(()), jnp.zeros(())))
    _, by_ratio = jax.jvp(values, at, (jnp.zeros(()), jnp.ones(())))
    return {"value": value, "d/dβ": by_beta, "d/dΛ": by_ratio}


def in_a_field(areas=AREAS, numbers=FIELD, angle=0.5, t_end=0.4, N=64, steps=240):
    """Returns differences between theory and simulation of values and derivatives by Δ, and the theory."""
    found = {"theory": [], "difference": []}
    for area in areas:
        exact = with_derivatives(theory, numbers, jnp.asarray(area), angle, t_end)
        full = with_derivatives(simulated, numbers, jnp.asarray(area), angle, t_end, N=N, steps=steps)
        found["theory"].append(exact)
        found["difference"].append(jax.tree.map(lambda a, b: jnp.abs(a - b), exact, full))
    return {part: jax.tree.map(lambda *rows: np.array(rows), *rows) for part, rows in found.items()}


@eqx.filter_jit
def _treading(reduced_area, shear, N, tolerance, t_end):
    angle = 0.5 * jnp.arccos(2 * amplitude(reduced_area))
    setting = make_scene(shapes.ellipse(N, reduced_area, angle=angle), flow=Shear(shear))
    return simulate(setting, t_end, saves=1, march=Adaptive(tolerance), checks=Checks()).diagnostics


def in_shear(areas=AREAS, shear=2.0, N=64, tolerance=1e-8, t_end=2.0):
    """Returns, by Δ, differences of the steady inclination from ½ arccos 2A, and of [μ] from 2."""
    found = {"inclination": [], "viscosity": []}
    for area in areas:
        rows = _treading(jnp.asarray(area), jnp.asarray(shear), N, jnp.asarray(tolerance), t_end)
        found["inclination"].append(abs(rows["inclination"][-1, 0] - 0.5 * np.arccos(2 * amplitude(area))))
        found["viscosity"].append(abs(rows["effective_viscosity"][-1] - 2))
    return {name: np.array(values) for name, values in found.items()}


def critical_conductance(ratio) -> float:
    """Returns G_c: above it a field of any strength makes the charged vesicle oblate, for Λ < 1.

    With the steady V = 2E ν, ν = s/(s+G), the bracket of F is a quadratic in ν, which is zero at 1/(1 + G_c/s).
    """
    s = ratio / (1 + ratio)
    # 3 I² = O² + T² + O T over (2E)²; T = (1-s)(1-ν) + ν
    inside = np.polynomial.Polynomial([1 - s, s - 1])
    outside = np.polynomial.Polynomial([s, -s])
    along = np.polynomial.Polynomial([1 - s, s])
    roots = (3 * inside**2 - outside**2 - along**2 - outside * along).roots()
    nu = next(root.real for root in roots if 0 < root.real < 1)
    return float(s * (1 / nu - 1))


def side(ratio, share_of_critical, reduced_area=0.99, beta=1.6, N=48, t_end=3.0, tolerance=1e-4):
    """Returns the final inclination in degrees of a vesicle that starts at 45° without flow: 90 prolate, 0 oblate.

    G is in units of G_c.
    """
    G = share_of_critical * critical_conductance(ratio)
    return float(np.degrees(_left_alone(jnp.asarray(ratio), jnp.asarray(G), reduced_area, beta, N, t_end, tolerance)))


@eqx.filter_jit
def _left_alone(ratio, G, reduced_area, beta, N, t_end, tolerance):
    field = dc_field(beta, conductivity_ratio=ratio, membrane_conductance=G)
    setting = make_scene(shapes.ellipse(N, reduced_area, angle=jnp.pi / 4), field=field)
    return simulate(setting, t_end, saves=1, march=Adaptive(tolerance)).diagnostics["inclination_unwrapped"][-1, 0]


def orders(areas, differences) -> np.ndarray:
    """Returns the observed powers of 1 - Δ from one Δ to the next."""
    return np.diff(np.log(differences)) / np.diff(np.log(1 - np.array(areas)))


def run(areas=AREAS, N=64, steps=240, ratios=(0.1, 0.5), shares=(0.8, 1.25)):
    """Returns differences in a field and in shear, and the final inclinations for conductances below and above G_c."""
    sides = {
        ratio: {"G_c": critical_conductance(ratio)} | {share: side(ratio, share) for share in shares}
        for ratio in ratios
    }
    return {
        "areas": list(areas),
        "field": in_a_field(areas, N=N, steps=steps),
        "shear": in_shear(areas, N=N),
        "sides": sides,
    }


@styled
def draw(found) -> Figure:
    """Draws differences against 1 - Δ, with the expected slopes."""
    figure = Figure(figsize=(run_plots.PAGE, 2.6))
    panels = figure.subplots(1, 3, sharex=True)
    deficit = 1 - np.array(found["areas"])
    names = {"inclination": r"$\psi$", "potential": "$V$", "speed": r"$\Omega$", "viscosity": r"$[\mu]$"}
    difference = found["field"]["difference"]
    markers = dict(zip(names, "osD^", strict=True))
    for name, label in names.items():
        panels[1].loglog(deficit, difference["value"][name], marker=markers[name], ms=3.5, label=label)
        panels[2].loglog(deficit, difference["d/dΛ"][name], marker=markers[name], ms=3.5, label=label)
    for name, values in found["shear"].items():
        panels[0].loglog(deficit, values, marker=markers[name], ms=3.5, label=names[name])
    slopes = (((found["shear"]["inclination"], 1.5), (found["shear"]["viscosity"], 1.0)),)
    slopes += (((difference["value"]["potential"], 0.5),), ((difference["d/dΛ"]["inclination"], 0.5),))
    titles = ("steady shear, no field", "shear and field", r"shear and field: $\partial/\partial\Lambda$")
    for axes, title, lines in zip(panels, titles, slopes, strict=True):
        for values, power in lines:
            axes.loglog(deficit, 0.6 * values[0] * (deficit / deficit[0]) ** power, "--", color="0.5", lw=0.8)
            axes.annotate(
                rf"$(1-\Delta)^{{{power:g}}}$",
                (deficit[-2], 0.6 * values[0] * (deficit[-2] / deficit[0]) ** power),
                va="top", fontsize=6,
            )  # fmt: skip
        axes.set(xlabel=r"$1-\Delta$", title=title)
        axes.legend()
    panels[0].set(ylabel="|simulation - theory|")
    return figure


def main():
    found = run()
    areas = found["areas"]
    print("|simulation - theory| at Δ =", *areas, "  and the observed powers of 1 - Δ")

    def show(label, values):
        powers = " ".join(f"{power:5.2f}" for power in orders(areas, values))
        print(f"{label:24}", *(f"{value:.2e}" for value in values), "  ", powers)

    for name, values in found["shear"].items():
        show(f"shear, {name}", values)
    for kind, table in found["field"]["difference"].items():
        for name, values in table.items():
            show(f"field, {name} {kind}", values)
    for ratio, row in found["sides"].items():
        ends = ", ".join(f"G = {share} G_c ends at {row[share]:.1f}°" for share in row if share != "G_c")
        print(f"Λ = {ratio}: G_c = {row['G_c']:.4f}; {ends}")
    store("quasi_circular", {**found, "field": jax.tree.map(np.abs, found["field"])})
    save(draw(found), "quasi_circular")


if __name__ == "__main__":
    main()
