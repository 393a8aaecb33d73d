"""Motions at G = 0: what they are called and how they are measured."""

import numpy as np
import pytest

from experiments import shear_regimes as r


def rows(inclination, speed):
    t = np.linspace(0, 9, 901)
    flat = np.zeros_like(t)
    found = {"t": t, "inclination": inclination(t), "speed": speed(t), "viscosity": flat + 2.0, "tail": flat}
    return found | {"status": "complete"}


@pytest.mark.parametrize(
    ("inclination", "speed", "name"),
    [
        (lambda t: 30 + 20 * np.exp(-3 * t), lambda t: -5 + 0 * t, "treading"),
        (lambda t: 115 + 0 * t, lambda t: 5 + 0 * t, "mirrored treading"),
        (lambda t: 45 + 20 * np.sin(7 * t), lambda t: -8 + 7 * np.cos(7 * t), "staggering"),
        (lambda t: 45 + 60 * np.sin(7 * t), lambda t: -2 + 7 * np.cos(7 * t), "reversing"),
        (lambda t: -300 * t, lambda t: -12 + 0 * t, "tumbling"),
    ],
)
def test_motions_are_called_by_angle_and_speed(inclination, speed, name):
    assert r.kind(rows(inclination, speed)) == name
    assert r.kind(rows(inclination, speed) | {"status": "unresolved"}) == "stopped"


def test_maxima_and_periods_are_found_between_saves():
    found = rows(lambda t: 45 + 20 * np.sin(7 * t), lambda t: -8 + 0 * t)
    times, heights = r.maxima(found["t"], found["inclination"])
    np.testing.assert_allclose(times, (0.5 * np.pi + 2 * np.pi * np.arange(len(times))) / 7, atol=1e-5)
    np.testing.assert_allclose(heights, 65, atol=1e-3)
    np.testing.assert_allclose(r.measured(found)["period"], 2 * np.pi / 7, rtol=1e-5)


def test_an_insulating_vesicle_can_tread_against_the_shear():
    """A toy of the mirrored motion: counter-clockwise, inclined beyond 90°, where shear alone treads clockwise."""
    m = r.measured(r.history(r.REGIMES["mirrored treading"], 32, 1e-3, 4.0, 80))
    assert m["speed"] > 4
    assert 95 < m["least"] < m["greatest"] < 135
