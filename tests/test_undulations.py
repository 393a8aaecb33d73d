"""Thermal undulations of a start: spectrum, the same shape with all nodes, area and perimeter, scene files."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.geometry import curve, shapes
from jaxves.geometry.curve import Curve
from jaxves.inputs.checking import SceneError
from jaxves.inputs.parameters import numbers
from jaxves.inputs.scene_files import parse
from jaxves.inputs.uses import RUN, SWEEP
from jaxves.runs.build import build
from jaxves.runs.case import Case

NODES = {"numerics": {"nodes": 64}}
THERMAL = dict(temperature=0.04, tension=20.0, modes=12, seed=3)


def test_the_spectrum_is_that_of_a_membrane_and_falls_like_a_cube_without_tension():
    k = np.arange(2.0, 40.0)
    np.testing.assert_allclose(shapes.undulation(k, 0.04, 0.0), 0.04 / (8 * np.pi * k**3), rtol=1e-12)
    tense = 0.04 / (4 * np.pi * 50.0) * (1 / k - 1 / np.sqrt(k**2 + 50.0))
    np.testing.assert_allclose(shapes.undulation(k, 0.04, 50.0), tense, rtol=1e-10)


def test_amplitudes_have_the_variance_of_the_spectrum():
    """Normal displacements of an ellipse of perimeter 4π, over seeds: the mean square of each Fourier amplitude."""
    N, modes = 32, 5
    base = shapes.ellipse(N, 0.9, length=2.0)
    normal = Curve.from_nodes(base).normal

    def amplitudes(seed):
        x = shapes.undulated(base, temperature=1e-10, modes=modes, seed=seed)
        return np.fft.rfft(np.sum((x - base) * normal, axis=1) / 2.0)[2 : modes + 1] / N

    found = np.abs(np.array([amplitudes(seed) for seed in range(12)])) ** 2
    exact = shapes.undulation(np.arange(2.0, modes + 1), 1e-10, 0.0)
    # 48 squares of complex normal numbers: the mean is within 0.5 of 1 with a probability of 99.9 %.
    assert abs(np.mean(found / exact) - 1) < 0.5


def test_the_shape_is_the_same_at_every_number_of_nodes_with_its_area_and_perimeter():
    coarse, fine = (jax.jit(lambda N=N: shapes.undulated(shapes.ellipse(N, 0.8), **THERMAL))() for N in (128, 192))
    # both start at the first node of the ellipse; every second node of one is every third of the other
    np.testing.assert_allclose(coarse[::2], fine[::3], atol=1e-9)
    moved, base = Curve.from_nodes(fine), Curve.from_nodes(shapes.ellipse(192, 0.8))
    np.testing.assert_allclose(curve.length(moved), curve.length(base), rtol=1e-10)
    np.testing.assert_allclose(curve.area(moved), curve.area(base), rtol=1e-10)
    assert np.ptp(moved.speed) < 1e-7
    assert 1e-3 < np.max(np.abs(fine - shapes.ellipse(192, 0.8))) < 0.3


def test_a_scene_file_has_undulations_and_their_numbers():
    tables = {"t_end": 1.0, "vesicle": [{"reduced_area": 0.9, "disturbance": THERMAL}]} | NODES
    file = parse(tables)
    found = numbers(file)
    assert found["vesicle.disturbance.temperature"] == 0.04 and found["vesicle.disturbance.tension"] == 20.0
    angle = jnp.zeros(())
    expected = shapes.undulated(shapes.ellipse(64, 0.9, angle=angle), **THERMAL)
    np.testing.assert_allclose(build(file).x[0], expected, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"modes": 29}, r"modes = 29, expected at most 28 modes for 64 nodes"),
        ({"seed": -1}, r"disturbance.seed = -1, expected a whole number >= 0"),
        ({"temperature": -0.1}, r"disturbance.temperature = -0.1, expected a positive finite number"),
        ({"waves": 3}, r"disturbance.waves = 3, expected one of the keys: temperature, tension, seed, modes"),
    ],
)
def test_wrong_undulations_are_refused(change, message):
    with pytest.raises(SceneError, match=message):
        parse({"t_end": 1.0, "vesicle": [{"reduced_area": 0.9, "disturbance": THERMAL | change}]} | NODES)


def test_undulations_without_a_number_of_nodes_suit_a_run_and_not_a_sweep():
    file = parse({"t_end": 1.0, "vesicle": [{"reduced_area": 0.9, "disturbance": THERMAL | {"modes": 29}}]})
    assert Case.of(file, RUN).scene_file.numerics.nodes == "auto"
    with pytest.raises(SceneError, match="modes = 29, expected at most 28 modes for 64 nodes"):
        Case.of(file, SWEEP)


def test_the_shape_has_a_derivative_with_respect_to_temperature_and_tension():
    base = shapes.ellipse(32, 0.9)

    @jax.jit
    def shape(numbers):
        return shapes.undulated(base, temperature=numbers[0], tension=numbers[1], modes=8)

    at, h = jnp.array([0.02, 5.0]), 1e-4
    forward = jax.jacfwd(shape)(at)
    reverse = jax.jacrev(shape)(at)
    np.testing.assert_allclose(forward, reverse, atol=1e-10)
    for n in range(2):
        dn = h * at[n] * jnp.eye(2)[n]
        difference = (shape(at + dn) - shape(at - dn)) / (2 * h * at[n])
        np.testing.assert_allclose(forward[..., n], difference, atol=1e-5 * np.max(np.abs(forward[..., n])))


def test_a_shape_without_spare_length_is_refused_and_a_traced_one_is_not_a_number():
    with pytest.raises(ValueError, match=r"temperature = 0\.04, expected less"):
        shapes.undulated(shapes.circle(64), **THERMAL)
    traced = jax.jit(lambda temperature: shapes.undulated(shapes.circle(64), **THERMAL | {"temperature": temperature}))
    assert np.all(np.isnan(traced(0.04)))
    tables = {"t_end": 1.0, "vesicle": [{"reduced_area": 1.0, "disturbance": THERMAL}], "numerics": {"nodes": 64}}
    with pytest.raises(SceneError, match=r"vesicle\.disturbance\.temperature = 0\.04, expected less"):
        build(parse(tables))
