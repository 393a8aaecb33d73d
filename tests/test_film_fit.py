"""Numbers from the outlines of a film: distances, residuals of variance 1, intervals, and what is left open."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.analysis import boxes, intervals
from jaxves.analysis.film_gauge import gauge
from jaxves.analysis.observations import Observations
from jaxves.geometry.curve import Curve
from jaxves.geometry.distance import depths
from jaxves.geometry.shapes import circle, ellipse
from jaxves.inputs.scene_files import parse
from jaxves.numerics import fourier
from jaxves.runs.build import scene_of
from jaxves.stepping.fixed import Fixed

RADIUS, NOISE = 40.0, 0.3


def moved(x, shift):
    """The same curve with its nodes moved along it."""
    N = x.shape[0]
    return fourier.evaluate(x, fourier.grid(N) + shift)


def film(tmp_path, shapes, rng, points=160, noise=NOISE):
    """Noisy outlines of these shapes, each shifted at random, as a contour tool writes them."""
    outlines = []
    for x in shapes:
        alpha = 2 * np.pi * (np.arange(points) / points + rng.random())
        exact = RADIUS * np.asarray(fourier.evaluate(jnp.asarray(x), jnp.asarray(alpha)))
        outlines.append(exact * [1, -1] + 5 * rng.normal(size=2) + noise * rng.normal(size=(points, 2)))
    np.save(tmp_path / "film.npy", outlines)
    return jaxves.read_frames(tmp_path / "film.npy", pixel=0.25, interval=0.1)


# -- distances -----------------------------------------------------------------------------------------------------


def test_distances_from_a_circle_are_exact_and_positive_inside():
    points = jnp.array([[0.9, 0.0], [0.0, 1.2], [-0.3, -0.4], [0.6, 0.8]])
    np.testing.assert_allclose(depths(circle(16), points), [0.1, -0.2, 0.5, 0.0], atol=1e-14)


def test_distances_do_not_depend_on_where_the_nodes_are():
    x, points = ellipse(32, 0.85), 1.05 * ellipse(48, 0.9)
    np.testing.assert_allclose(depths(moved(x, 0.1), points), depths(x, points), atol=1e-9)


def test_the_derivative_of_a_depth_is_the_outward_displacement():
    """By differences, and from the formula for points on the curve itself."""
    x, points = ellipse(32, 0.85), 1.05 * ellipse(48, 0.9)
    dx = fourier.low_pass(jnp.asarray(np.random.default_rng(0).normal(size=x.shape)), 5, axis=0)
    slope = jax.jvp(lambda x: depths(x, points), (x,), (dx,))[1]
    both = [depths(x + h * dx, points) for h in (1e-5, -1e-5)]
    np.testing.assert_allclose(slope, (both[0] - both[1]) / 2e-5, atol=1e-7)
    on_curve = jax.jvp(lambda y: depths(y, x), (x,), (dx,))[1]
    np.testing.assert_allclose(on_curve, jnp.sum(dx * Curve.from_nodes(x).normal, axis=-1), atol=1e-9)


# -- residuals -----------------------------------------------------------------------------------------------------


def test_residuals_have_variance_one_and_see_neither_position_nor_nodes(tmp_path):
    """Twelve frames of a known ellipse in units of its own radius; then shifted, and with nodes moved along it."""
    x = np.asarray(ellipse(32, 0.85, angle=0.4))
    frames = film(tmp_path, [x] * 12, np.random.default_rng(0))
    made, seen, t_end = gauge(frames, 2.0)
    assert t_end == pytest.approx(0.55) and made.saves == 11
    assert seen.shape == (12, 2 * frames.modes - 1)
    shapes = jnp.asarray(np.stack([x] * 12))[:, None] * (RADIUS * frames.pixel / frames.radius.value)
    residuals = made(shapes) - seen
    assert np.mean(residuals**2) == pytest.approx(1.0, abs=4 * np.sqrt(2 / residuals.size))
    shifted = made(jax.vmap(jax.vmap(lambda x: moved(x, 0.3)))(shapes + jnp.array([0.3, -0.2])))
    np.testing.assert_allclose(shifted, made(shapes), atol=1e-6)
    other = made(jnp.asarray(np.stack([np.asarray(ellipse(32, 0.83, angle=0.4))] * 12))[:, None]) - seen
    assert np.mean(other**2) > 5


def test_a_film_of_one_frame_or_a_bad_unit_is_refused(tmp_path):
    frames = film(tmp_path, [np.asarray(ellipse(32, 0.9))], np.random.default_rng(0))
    with pytest.raises(ValueError, match="only one, expected some after t = 0"):
        gauge(frames, 1.0)
    with pytest.raises(ValueError, match="time_unit = 0"):
        gauge(frames, 0)


# -- intervals -----------------------------------------------------------------------------------------------------

ALL = boxes.boxes({"field.beta": (0.1, 10.0), "field.chi": (0.01, 1.0), "vesicle.angle": (-90.0, 90.0)})


def test_a_ratio_that_is_determined_is_named_although_its_numbers_are_not():
    """Residuals that see log β - log χ, and an angle; nothing sees β alone."""
    jacobian = np.array([[100.0, -100.0, 0.0], [0.01, 0.01, 0.0], [0.0, 0.0, 50.0]])
    found = intervals.judged(jacobian, ALL)
    assert found.loose == ("+0.71 log field.beta +0.71 log field.chi",)
    (sentence,) = found.determined
    assert sentence.startswith("field.beta/field.chi is determined to ±2.0%, field.beta and field.chi alone are not")
    assert found.half_widths[0] > intervals.LOOSE > found.half_widths[2]


@pytest.mark.parametrize(
    ("row", "name"),
    [((100.0, 100.0), "field.beta field.chi"), ((200.0, -100.0), "field.beta²/field.chi"),
     ((100.0, -200.0), "field.beta/field.chi²")],
)  # fmt: skip
def test_products_and_powers_are_named(row, name):
    (sentence,) = intervals.judged(np.array([[*row, 0.0], [0.0, 0.0, 50.0]]), ALL).determined
    assert sentence.startswith(f"{name} is determined")


def test_numbers_without_any_influence_are_loose_and_nothing_is_said_of_their_ratio():
    found = intervals.judged(np.array([[0.0, 0.0, 50.0]]), ALL)
    assert found.determined == () and len(found.loose) == 2


def test_half_widths_of_determined_numbers_are_those_of_the_inverse_information():
    jacobian = np.random.default_rng(0).normal(size=(40, 3)) * [20.0, 30.0, 40.0]
    found = intervals.judged(jacobian, ALL)
    exact = intervals.NORMAL_95 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    np.testing.assert_allclose(found.half_widths, exact, rtol=1e-10)
    assert found.loose == found.determined == ()


# -- fits ----------------------------------------------------------------------------------------------------------

RELAXING = {"t_end": 0.1, "vesicle": [{"reduced_area": 0.85, "angle": 70.0}], "numerics": {"nodes": 24}}


def test_bending_is_found_from_a_film_and_a_number_without_influence_is_left_open(tmp_path):
    """Seven frames of an ellipse that relaxes; its position along x is not seen at all."""
    file, march = parse(RELAXING), Fixed(2)
    exact = np.asarray(jaxves.simulate(scene_of(file, {}), 0.06, saves=6, march=march).x[:, 0])
    frames = film(tmp_path, exact, np.random.default_rng(1), noise=0.1)
    time_unit = 6 * 0.1 / 0.06  # s
    bounds = {"vesicle.bending": (0.1, 10.0), "vesicle.center[0]": (-1.0, 1.0)}
    start = {"vesicle.bending": 1.5, "vesicle.center[0]": 0.1}
    with pytest.warns(UserWarning, match=r"vesicle.length is missing, .* radius of the film, 0.0\d* % of it"):
        found = jaxves.fit_frames(file, bounds, frames, time_unit, starts=[start], march=march)
    low, high = found.intervals["vesicle.bending"]
    assert low < 1.0 < high < 1.6 * low
    assert found.intervals["vesicle.center[0]"] is None
    assert abs(found.chi2 / found.observations - 1) < 4 * np.sqrt(2 / found.observations)
    assert "vesicle.bending = " in str(found) and "vesicle.center[0]: not determined alone" in str(found)

    two = [{"reduced_area": 0.9}, {"reduced_area": 0.9, "center": [4.0, 0.0]}]
    with pytest.raises(ValueError, match="scene has 2 vesicles, expected one, as in a film"):
        jaxves.fit_frames(
            parse(RELAXING | {"vesicle": two}), bounds | {"vesicle.length": (0.9, 1.1)}, frames, time_unit
        )
    assert Observations.of_frames(frames, time_unit).t_end == pytest.approx(0.06)
