"""The class of motion in shear, the time of half a turn, and averages over whole half-turns, from exact time series."""

import numpy as np
import pytest

from jaxves.observables.shear_motion import average, classify, half_turns, is_sheared, motion_of

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


def test_slow_motion_of_a_viscous_vesicle_is_not_rest():
    """Inclinations relax (1 + ν)/2 times as slowly: a change that is rest for ν = 1 is none for ν = 100."""
    drifting = 0.4 + np.deg2rad(0.3) * T / 1.2
    assert classify(T, drifting) == classify(T, drifting, 0.1) == "treading"
    assert classify(T, drifting, 100.0) == "open"


def test_the_motion_of_all_vesicles_has_half_turns_and_the_viscosity_of_the_only_one():
    both = np.stack([rigid(T), 0.4 + np.exp(-2 * T)], axis=1)
    found = motion_of(T, both, np.ones(2), np.cos(2 * rigid(T)))
    assert found.names == ("tumbling", "treading") and np.isnan(found.viscosity) and np.isnan(found.half_turn[1])
    np.testing.assert_allclose(found.half_turn[0], PERIOD, rtol=1e-5)
    alone = motion_of(np.append(T, np.nan), np.append(both[:, :1], [[np.nan]], axis=0), np.ones(1), np.append(T, 0.0))
    np.testing.assert_allclose(alone.viscosity, 6.0 - 0.5 * PERIOD * int(6.0 / PERIOD), rtol=1e-5)


def test_a_motion_in_shear_needs_a_constant_shear_and_no_circle():
    tables = {"vesicle": [{"shape": "ellipse"}], "flow": {"kind": "shear"}}
    assert is_sheared(tables) and is_sheared(tables | {"flow": {"kind": "shear", "time": {"kind": "constant"}}})
    for flow in (None, {"kind": "extension"}, {"kind": "shear", "time": {"kind": "sine"}}):
        assert not is_sheared(tables | {"flow": flow})
    assert not is_sheared(tables | {"vesicle": [{"shape": "circle"}]})
