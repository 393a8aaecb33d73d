"""Layer potentials on one curve: exact symbols on a circle, Green's identities, symmetry, gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import circle

from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.operators.surfaces import Surfaces
from jaxves.potentials import kernels


@jax.jit
def surfaces(x):
    return Surfaces.of(x[None], electric=True)


def apply(name, x, density):
    s = surfaces(x)
    weighted = s.curves.speed[0] * density
    return {
        "S": lambda: s.laplace_slp[0] @ weighted,
        "D": lambda: s.laplace_slp_dn[0].T @ weighted,
        "S'": lambda: s.laplace_slp_dn[0] @ weighted,
        "D'": lambda: s.dlp_dn(density[None])[0],
    }[name]()


@pytest.mark.parametrize("R", [1.0, 0.6])
@pytest.mark.parametrize("k", [0, 1, 2, 7, 20])
def test_laplace_operators_on_a_circle_have_their_symbols(R, k):
    """S: R/2k, -R ln R on the mean; D' = -k/2R; S' = D = -½ on the mean, 0 otherwise."""
    x = circle(64, R)
    mode = jnp.cos(k * fourier.grid(64))
    symbols = {
        "S": R / (2 * k) if k else -R * np.log(R),
        "D'": -k / (2 * R),
        "S'": 0.0 if k else -0.5,
        "D": 0.0 if k else -0.5,
    }
    for name, symbol in symbols.items():
        np.testing.assert_allclose(apply(name, x, mode), symbol * mode, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("R", [1.0, 0.6])
def test_stokes_single_layer_on_a_circle_has_its_symbol(R):
    """On f₁ + i f₂ = c e^{ikθ}: R/4|k|; k = 0: R(¼ - ½ ln R); k = 1: 0 on normal, R/2 on tangential forces."""
    s = surfaces(circle(64, R))
    theta = fourier.grid(64)

    def velocity(f):
        u = s.stokes(jnp.stack([f.real, f.imag], axis=-1)[None])[0]
        return u[:, 0] + 1j * u[:, 1]

    c = 0.3 - 0.7j
    for k in (-5, -2, -1, 2, 3, 11):
        f = c * jnp.exp(1j * k * theta)
        np.testing.assert_allclose(velocity(f), R / (4 * abs(k)) * f, atol=1e-12, err_msg=str(k))
    constant = c * jnp.ones(64)
    np.testing.assert_allclose(velocity(constant), R * (0.25 - 0.5 * np.log(R)) * constant, atol=1e-12)
    normal, tangential = jnp.exp(1j * theta), 1j * jnp.exp(1j * theta)
    np.testing.assert_allclose(velocity(normal), 0, atol=1e-12)
    np.testing.assert_allclose(velocity(tangential), R / 2 * tangential, atol=1e-12)


def _green_errors(shape, N):
    """Representation of a function harmonic inside, u = Re e^z, by its own Cauchy data: S ∂_n u - D u = ½ u."""
    x = shape(N)
    c = Curve.from_nodes(x)
    u = jnp.exp(x[:, 0]) * jnp.cos(x[:, 1])
    gradient = jnp.stack([u, -jnp.exp(x[:, 0]) * jnp.sin(x[:, 1])], axis=-1)
    flux = jnp.sum(gradient * c.normal, axis=-1)
    value = apply("S", x, flux) - apply("D", x, u) - 0.5 * u
    derivative = apply("S'", x, flux) - apply("D'", x, u) - 0.5 * flux
    return max(jnp.max(jnp.abs(value)), jnp.max(jnp.abs(derivative)))


def test_greens_identities_converge_spectrally(shape):
    errors = [_green_errors(shape, N) for N in (32, 64, 128, 256)]
    assert errors[1] < 1e-2 * errors[0]
    assert errors[2] < max(1e-3 * errors[1], 1e-11)
    assert errors[3] < 1e-11


def test_stokes_single_layer_converges_spectrally_to_an_exterior_stokeslet(shape):
    """The velocity of a force density is continuous: S f on the curve against kernel sums on a finer one."""

    def at_first_node(N):
        x = shape(N)
        alpha = fourier.grid(N)
        f = jnp.stack([jnp.exp(jnp.sin(alpha)), jnp.cos(2 * alpha)], axis=-1)
        return surfaces(x).stokes(f[None])[0, 0]

    reference = at_first_node(512)
    errors = [jnp.max(jnp.abs(at_first_node(N) - reference)) for N in (16, 32, 64, 128)]
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 1e-2 * errors[1]
    assert errors[3] < 1e-12


def test_self_and_free_space_kernels_agree_away_from_the_diagonal(shape):
    """Off-diagonal smooth part plus log rule is one quadrature; a far density sees the plain kernel."""
    N = 128
    x = shape(N)
    c = Curve.from_nodes(x)
    # a density of tiny support far from the target makes both rules the same integral
    bump = jnp.exp(-40 * (1 - jnp.cos(fourier.grid(N) - np.pi)))
    r = x[0] - x
    laplace = jnp.sum(jnp.where(bump > 1e-20, kernels.laplace(r + (bump < 1e-20)[:, None]), 0) * bump * c.weights)
    np.testing.assert_allclose(apply("S", x, bump)[0], laplace, atol=1e-10)


def test_double_layer_of_a_constant_is_minus_one_half(shape):
    np.testing.assert_allclose(apply("D", shape(128), jnp.ones(128)), -0.5, atol=1e-12)


def test_stokes_single_layer_of_the_normal_vanishes(shape):
    s = surfaces(shape(128))
    np.testing.assert_allclose(s.stokes(s.curves.normal), 0, atol=1e-12)


def test_single_layers_are_self_adjoint(shape):
    s = surfaces(shape(64))
    for kernel in (s.laplace_slp[0], s.stokes_slp.xx[0], s.stokes_slp.xy[0], s.stokes_slp.yy[0]):
        np.testing.assert_allclose(kernel, kernel.T, atol=1e-15)


def test_reverse_mode_gradients_with_respect_to_the_nodes_are_finite_and_right(shape):
    """Diagonals are where NaN gradients are born; central differences in a random direction decide."""
    x = shape(32)
    alpha = fourier.grid(32)
    density = jnp.exp(jnp.sin(alpha))
    direction = jnp.stack([jnp.cos(3 * alpha), jnp.sin(2 * alpha)], axis=-1)

    @jax.jit
    def total(x):
        s = Surfaces.of(x[None], electric=True)
        u = s.stokes(jnp.stack([density, density**2], axis=-1)[None])
        return (
            jnp.sum(jnp.sin(u))
            + jnp.sum(s.potential_slope(density[None], density[None]) ** 2)
            + jnp.sum(s.dlp_dn(density[None]) ** 2)
        )

    slope = jnp.sum(jax.grad(total)(x) * direction)
    h = 1e-4

    def difference(h):
        return (total(x + h * direction) - total(x - h * direction)) / (2 * h)

    np.testing.assert_allclose(slope, (4 * difference(h) - difference(2 * h)) / 3, rtol=1e-8)
    curvature = jax.jvp(jax.grad(total), (x,), (direction,))[1]
    assert np.all(np.isfinite(curvature))
