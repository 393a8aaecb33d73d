"""The class of motion in shear, the time of half a turn, and averages over whole half-turns, from exact time series."""

import numpy as np
import pytest

from jaxves.observables.shear_motion import average, classify, half_turns

CA, B = 10.0, 0.6


def rigid(t):
    """θ of θ' = -(Ca/2) (1 - B cos 2θ), which turns by half a turn in 2π/(Ca √(1 - B²))."""
    root = np.sqrt(1 - B**2)
    phase = -0.5 * CA * root * t
    whole = np.round(phase / np.pi)
    return np.arctan(np.sqrt((1 - B) / (1 + B)) * np.tan(phase - np.pi * whole)) + np.pi * whole


T = np.linspace(0.0, 6.0, 601)
PERIOD = 2 * np.pi / (CA * np.sqrt(1 - B**2))


def test_the_time_of_half_a_turn_is_found_between_saves():
    found = half_turns(T, rigid(T))
    assert len(found.times) == int(6.0 / PERIOD) + 1 and found.times[-1] == T[-1]
    np.testing.assert_allclose(np.diff(found.times), PERIOD, rtol=1e-5)
    np.testing.assert_allclose(found.period, PERIOD, rtol=1e-5)


@pytest.mark.parametrize("turns", [1, 3])
def test_the_average_over_half_turns_is_that_of_the_orbit(turns):
    """⟨cos 2θ⟩ = (1 - √(1 - B²))/B, which an average over all saved times misses."""
    exact = (1 - np.sqrt(1 - B**2)) / B
    values = np.cos(2 * rigid(T))
    np.testing.assert_allclose(average(T, rigid(T), values, turns), exact, rtol=1e-5)
    assert abs(np.mean(values) / exact - 1) > 1e-3
    assert np.isnan(average(T[:50], rigid(T[:50]), values[:50]))


@pytest.mark.parametrize(
    ("inclination", "name"),
    [
        (rigid(T), "tumbling"),
        (0.4 + np.exp(-2 * T), "treading"),
        (0.2 + 0.3 * np.sin(5 * T), "swinging"),
        (0.2 + 0.3 * np.exp(-T) * np.sin(5 * T), "treading"),
        (0.5 - 0.05 * T, "open"),
        (1.0 - np.pi * T / 6.0, "open"),
    ],
)
def test_motions_have_names(inclination, name):
    assert classify(T, inclination) == name


def test_rows_that_a_run_did_not_reach_do_not_count():
    t, inclination = T.copy(), rigid(T)
    t[400:] = inclination[400:] = np.nan
    assert classify(t, inclination) == "tumbling" and classify(t[:3], inclination[:3]) == "open"
