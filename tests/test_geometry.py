"""Fourier calculus, curves and starting shapes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import ellipse, star

from jaxves.geometry import curve, shapes
from jaxves.geometry.curve import Curve
from jaxves.numerics import fourier
from jaxves.physics.scene import dc_field, make_scene
from jaxves.stepping.marching import simulate


@pytest.mark.parametrize("N", [64, 256])
def test_derivative_is_exact_for_resolved_modes(N):
    alpha = fourier.grid(N)
    f = jnp.stack([jnp.sin(3 * alpha), jnp.cos((N // 2 - 1) * alpha)])
    exact = jnp.stack([3 * jnp.cos(3 * alpha), -(N // 2 - 1) * jnp.sin((N // 2 - 1) * alpha)])
    np.testing.assert_allclose(fourier.derivative(f), exact, atol=1e-13 * N**2)
    np.testing.assert_allclose(fourier.derivative(f.T, axis=0), exact.T, atol=1e-13 * N**2)
    np.testing.assert_allclose(f @ fourier.derivative_matrix(N).T, exact, atol=1e-13 * N**2)


@pytest.mark.parametrize(("N", "columns"), [(128, 128), (200, 300), (640, 2), (2048, 3)])
def test_large_grids_take_three_products_that_equal_the_circulant_matrix(N, columns):
    """Real, imaginary and mixed symbols, along both axes; the Nyquist mode has a real symbol only."""
    rng = np.random.default_rng(0)
    f = rng.normal(size=(N, columns))
    symbol = rng.normal(size=N // 2 + 1) + 1j * rng.normal(size=N // 2 + 1)
    symbol[[0, -1]] = symbol[[0, -1]].real
    exact = fourier.circulant(symbol, N) @ f
    traced = jax.make_jaxpr(lambda f: fourier.multiply(f, symbol, axis=0))(jnp.asarray(f))
    assert str(traced).count("dot_general") == 3
    np.testing.assert_allclose(fourier.multiply(jnp.asarray(f), symbol, axis=0), exact, atol=1e-12 * N)
    np.testing.assert_allclose(fourier.multiply(jnp.asarray(f.T), symbol), exact.T, atol=1e-12 * N)


@pytest.mark.parametrize("N", [64, 256])
def test_low_pass_removes_the_highest_modes_and_nothing_else(N):
    alpha = fourier.grid(N)
    low, high = jnp.cos((N // 2 - 3) * alpha), jnp.sin((N // 2 - 2) * alpha) + (-1.0) ** np.arange(N)
    np.testing.assert_allclose(fourier.low_pass(low + high, 3), low, atol=1e-12)
    basis = fourier.high_modes(N, 3)
    np.testing.assert_allclose(np.eye(N) - basis @ basis.T, fourier.low_pass_matrix(N, 3), atol=1e-12)


def test_resampling_and_evaluation_follow_the_interpolant():
    f = jnp.exp(jnp.sin(fourier.grid(48)))
    np.testing.assert_allclose(fourier.resample(f, 96), jnp.exp(jnp.sin(fourier.grid(96))), atol=1e-12)
    np.testing.assert_allclose(fourier.resample(fourier.resample(f, 96), 48), f, atol=1e-13)
    alpha = jnp.array([0.1, 2.0, 6.0])
    np.testing.assert_allclose(fourier.evaluate(f, alpha), jnp.exp(jnp.sin(alpha)), atol=1e-12)


def test_geometry_of_an_ellipse():
    a, b = 1.4, 0.7
    c = Curve.from_nodes(ellipse(96, a, b))
    np.testing.assert_allclose(curve.area(c), np.pi * a * b, rtol=1e-13)
    from scipy.special import ellipe

    np.testing.assert_allclose(curve.length(c), 4 * a * ellipe(1 - (b / a) ** 2), rtol=1e-12)
    np.testing.assert_allclose(c.curvature[0], a / b**2, rtol=1e-10)
    moments = np.pi * a * b / 4 * np.diag([a**2, b**2])
    np.testing.assert_allclose(curve.second_moments(c), moments, atol=1e-13)
    np.testing.assert_allclose(curve.deformation(c, jnp.array([0.0, 1.0])), (b - a) / (b + a), rtol=1e-12)


@pytest.mark.parametrize("degrees", [-89.0, -30.0, 0.0, 45.0, 90.0])
def test_inclination_and_centroid_follow_a_rotation_and_a_shift(degrees):
    x = shapes.rotated(star(64) * jnp.array([2.0, 1.0]), jnp.deg2rad(degrees)) + jnp.array([3.0, -1.0])
    unturned = Curve.from_nodes(star(64) * jnp.array([2.0, 1.0]))
    angle = curve.inclination(Curve.from_nodes(x)) - curve.inclination(unturned)
    assert abs(np.mod(angle - np.deg2rad(degrees) + np.pi / 2, np.pi) - np.pi / 2) < 1e-12
    expected = shapes.rotated(curve.centroid(unturned)[None], jnp.deg2rad(degrees))[0] + jnp.array([3.0, -1.0])
    np.testing.assert_allclose(curve.centroid(Curve.from_nodes(x)), expected, atol=1e-13)


def test_the_gradient_of_the_inclination_is_finite_at_a_circle():
    gradient = jax.grad(lambda x: curve.inclination(Curve.from_nodes(x)))(shapes.circle(32))
    assert np.all(np.isfinite(gradient))


@pytest.mark.parametrize("reduced_area", [0.8, 0.9, 0.999, 1.0])
def test_ellipse_has_the_reduced_area_and_perimeter_asked_for(reduced_area):
    c = Curve.from_nodes(shapes.ellipse(128, reduced_area, angle=0.3, length=1.7))
    np.testing.assert_allclose(curve.reduced_area(c), reduced_area, rtol=1e-11)
    np.testing.assert_allclose(curve.length(c), 2 * np.pi * 1.7, rtol=1e-11)
    if reduced_area < 1:
        np.testing.assert_allclose(curve.inclination(c), 0.3, atol=1e-10)


@pytest.mark.parametrize("reduced_area", [0.001, -1.0, np.nan])
def test_an_ellipse_that_does_not_exist_is_refused_or_where_traced_not_a_number(reduced_area):
    with pytest.raises(ValueError, match="reduced_area = "):
        shapes.ellipse(16, reduced_area)
    assert np.all(np.isnan(jax.jit(lambda area: shapes.ellipse(16, area))(reduced_area)))


def test_a_slender_ellipse_approaches_its_reduced_area_spectrally():
    errors = [abs(curve.reduced_area(Curve.from_nodes(shapes.ellipse(N, 0.4))) / 0.4 - 1) for N in (64, 128, 256)]
    assert errors[1] < 0.1 * errors[0]
    assert errors[2] < 1e-2 * errors[1]


def test_nodes_of_an_ellipse_are_equispaced():
    speed = Curve.from_nodes(shapes.ellipse(128, 0.8)).speed
    np.testing.assert_allclose(speed, 1.0, atol=1e-8)


def test_ellipse_differentiates_in_its_reduced_area():
    def second_node(delta):
        return shapes.ellipse(64, delta, angle=0.2)[5]

    forward = jax.jacfwd(second_node)(0.8)
    reverse = jax.jacrev(second_node)(0.8)
    h = 1e-4
    richardson = (
        8 * (second_node(0.8 + h) - second_node(0.8 - h)) - (second_node(0.8 + 2 * h) - second_node(0.8 - 2 * h))
    ) / (12 * h)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9)
    np.testing.assert_allclose(forward, richardson, rtol=1e-7)


def test_a_curve_through_points_of_an_ellipse_is_that_ellipse_either_way_round():
    points = np.asarray(ellipse(200))
    for given in (points, points[::-1]):
        c = Curve.from_nodes(shapes.through_points(given, 64, length=1.0))
        np.testing.assert_allclose(curve.length(c), 2 * np.pi, rtol=1e-6)
        np.testing.assert_allclose(curve.reduced_area(c), curve.reduced_area(Curve.from_nodes(ellipse(96))), rtol=1e-6)
        assert np.ptp(c.speed) < 1e-4


@pytest.mark.parametrize("reduced_area", [0.25, 0.5, 0.9, 0.999])
def test_an_ellipse_of_given_excess_is_that_of_the_reduced_area(reduced_area):
    excess = np.sqrt(1 - reduced_area)
    found = shapes.ellipse_of_excess(64, excess, angle=0.3, length=2.0)
    np.testing.assert_allclose(found, shapes.ellipse(64, reduced_area, angle=0.3, length=2.0), atol=1e-11)


def test_a_circle_has_a_derivative_in_its_excess():
    """r = 1 + n cos 2θ with n = √(2/3) excess; nodes move along, too, to stay equispaced."""

    def nodes(excess):
        return shapes.ellipse_of_excess(32, excess)

    slope = jax.jit(jax.jacfwd(nodes))(0.0)
    np.testing.assert_allclose(jax.jit(jax.jacrev(nodes))(0.0), slope, atol=1e-13)
    outward = jnp.sum(slope * shapes.circle(32), axis=-1)
    np.testing.assert_allclose(outward, np.sqrt(2 / 3) * np.cos(2 * fourier.grid(32)), atol=1e-12)


def test_large_matrices_are_built_inside_the_program():
    """With more entries than a constant may have, they equal the transforms of NumPy; the program holds no copy."""
    rng = np.random.default_rng(1)
    N, K, cut = 512, 768, 128
    f = rng.normal(size=N)
    spectrum = np.fft.rfft(f)
    split = np.append(spectrum[:-1], 0.5 * spectrum[-1])  # the Nyquist mode is shared between ±N/2 on finer grids

    finer = fourier.resample(jnp.asarray(f), K)
    coarser, modes = map(np.asarray, jax.jit(lambda: (fourier.resampling(K, N), fourier.high_modes(N, cut)))())
    np.testing.assert_allclose(finer, np.fft.irfft(split, K) * (K / N), atol=1e-12)
    np.testing.assert_allclose(coarser, fourier.resampling_matrix(K, N), atol=1e-13)
    np.testing.assert_allclose(np.eye(N) - modes @ modes.T, fourier.low_pass_matrix(N, cut), atol=1e-12)
    cosine, sine = jax.jit(fourier.coefficients)(jnp.asarray(f))
    weight = np.append(np.append(1.0, np.full(N // 2 - 1, 2.0)), 1.0) / N
    np.testing.assert_allclose(cosine - 1j * sine, weight * spectrum, atol=1e-12)
    np.testing.assert_allclose(fourier.resampled(f, K, 0), finer, atol=1e-12)
    np.testing.assert_allclose(fourier.resampled(np.asarray(finer), N, 0), fourier.resample(finer, N), atol=1e-12)


def test_the_program_of_many_nodes_holds_no_large_constant():
    """Matrices as constants would be 115 MB of text with 512 nodes."""
    scene = make_scene(shapes.ellipse(512, 0.9), field=dc_field(1.0, conductivity_ratio=0.1))
    lowered = jax.jit(lambda scene: simulate(scene, 1e-7, saves=1).x).lower(scene)
    assert len(lowered.as_text()) < 2e7
