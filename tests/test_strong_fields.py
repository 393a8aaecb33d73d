"""Strong flows and fields: tension under load and growth of wrinkles, beside the theory of nearly round vesicles.

With ε₀ = √(2(1-Δ)/3), a load P on the second mode, and the mean physical tension λ₀ (in κ_B/a²):

    extension v = Ca (x, -y), vesicle along y      λ₀ → -2 Ca/ε₀ - 5/2
    field at t = 0⁺, vesicle along the field       λ₀ → 2 P/(3 ε₀),   P = (B/8)(3 + (1 - Λc)² - 3c²),  c = 2/(1 + Λ)
    mode k of the shape                            grows at -(k/4)(k² - 3/2 + λ₀)
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation.equation import equation_for
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.numerics import fourier
from jaxves.physics import membrane
from jaxves.physics.flow import Extension
from jaxves.physics.scene import dc_field, make_scene


@eqx.filter_jit
def motion(equation, x, V_m):
    return equation.motion(jnp.zeros(()), Unknowns.of(x, V_m))


def along_y(N, reduced_area, **present):
    return equation_for(make_scene(shapes.ellipse(N, reduced_area, angle=jnp.pi / 2), **present))


def mean_tension(found):
    curve, sigma = jax.tree.map(lambda leaf: leaf[0], (found.surfaces.curves, found.sigma))
    return float(jnp.mean(membrane.physical_tension(curve, sigma, jnp.ones(()))))


def excess(reduced_area):
    return np.sqrt(2 * (1 - reduced_area) / 3)


def test_the_tension_of_a_stretching_flow_across_the_vesicle():
    """The error is of second order in ε₀ relative to 2 Ca/ε₀."""
    Ca, errors = 1000.0, []
    for reduced_area in (0.99, 0.999):
        equation = along_y(64, reduced_area, flow=Extension(Ca))
        theory = -2 * Ca / excess(reduced_area) - 2.5
        errors.append(abs(mean_tension(motion(equation, equation.scene.x, None)) / theory - 1))
    assert errors[1] < 3e-4
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.15)


def test_the_tension_of_a_field_that_is_switched_on_tends_to_two_thirds_of_the_load():
    """The error is of first order in ε₀: two shapes extrapolate to the limit."""
    ratio, B, chi, found = 0.1, 1e4, 1e-5, []
    c = 2 / (1 + ratio)
    load = B / 8 * (3 + (1 - ratio * c) ** 2 - 3 * c**2)
    areas = (0.999, 0.9999)
    for reduced_area in areas:
        equation = along_y(64, reduced_area, field=dc_field(B * chi, chi=chi, conductivity_ratio=ratio))
        tension = mean_tension(motion(equation, equation.scene.x, jnp.zeros((1, 64))))
        found.append(tension * excess(reduced_area) / load / (2 / 3))
    assert found[0] == pytest.approx(0.959, abs=2e-3)
    wide, narrow = (excess(reduced_area) for reduced_area in areas)
    assert (found[1] * wide - found[0] * narrow) / (wide - narrow) == pytest.approx(1, abs=2e-3)


def test_wrinkles_in_a_stretching_flow_grow_at_the_rate_of_a_plane_membrane_under_that_tension():
    """Differences of F along the mode, which does not stretch the membrane, projected on it. Errors are O(ε₀²)."""
    N = 128
    equation = along_y(N, 0.999, flow=Extension(10.0))
    base = motion(equation, equation.scene.x, None)
    (normal,), (tangent,) = base.surfaces.curves.normal, base.surfaces.curves.tangent
    turn = (base.surfaces.curves.curvature * base.surfaces.curves.speed)[0]
    alpha, h = fourier.grid(N), 1e-6
    for k in (8, 16, 24, 40):
        wave = jnp.cos(k * alpha)
        mode = wave[:, None] * normal - fourier.antiderivative(turn * wave)[:, None] * tangent
        ahead, behind = (motion(equation, equation.scene.x + s * h * mode, None).velocity[0] for s in (1, -1))
        change = jnp.sum((ahead - behind) * normal, axis=1) / (2 * h)
        growth = float(2 * jnp.mean(change * wave))
        assert growth == pytest.approx(-k / 4 * (k**2 - 1.5 + mean_tension(base)), rel=3e-5)
