"""A fit says whether its χ² is improbable: then the intervals are too narrow."""

import numpy as np
import pytest
from scipy.stats import chi2

import jaxves
from jaxves.analysis.fit import Fit
from jaxves.analysis.observations import Observations
from jaxves.inputs.scene_files import parse
from jaxves.runs.build import scene_of
from jaxves.stepping.fixed import Fixed

MARCH = Fixed(10)


def fit_with(found, observations):
    values = {"field.beta": 3.2, "field.chi": 0.08}
    intervals = {name: (0.9 * value, 1.1 * value) for name, value in values.items()}
    return Fit(values, intervals, np.eye(2), found, observations, (), (), ())


@pytest.mark.parametrize("found", [0.5, 8.0, 30.0])
def test_the_probability_is_that_of_a_larger_chi_squared_with_the_redundant_observations(found):
    assert fit_with(found, 12).probability == pytest.approx(chi2.sf(found, 10), rel=1e-10)


def test_only_a_fit_with_an_improbable_chi_squared_is_called_doubtful():
    assert "intervals are too narrow" in str(fit_with(87.8, 12))
    assert "too narrow" not in str(fit_with(chi2.isf(2e-3, 10), 12))


def test_without_redundant_observations_nothing_is_improbable():
    assert fit_with(1e3, 2).probability == 1.0 and "too narrow" not in str(fit_with(1e3, 2))


def test_a_number_that_ends_at_a_bound_has_no_interval_and_says_so():
    """The observed motion is that of a field stronger than the bounds allow."""
    file = parse(
        {"t_end": 0.1, "vesicle": [{"reduced_area": 0.9, "angle": 90.0}], "numerics": {"nodes": 32},
         "field": {"beta": 3.0, "conductivity_ratio": 0.1}}
    )  # fmt: skip
    truth = jaxves.simulate(scene_of(file, {"field.beta": np.float64(4.0)}), 0.1, saves=10, march=MARCH)
    seen = Observations(0.1, {"deformation": np.asarray(truth.diagnostics["deformation"])[1:]}, {"deformation": 1e-3})
    narrow, wide = (jaxves.fit(file, {"field.beta": (2.0, end)}, seen, starts=1, march=MARCH) for end in (3.5, 9.0))
    assert narrow.at_bounds == ("field.beta",) and narrow.intervals == {"field.beta": None}
    assert "field.beta = 3.5, an end of its bounds" in str(narrow) and "determined" not in str(narrow)
    low, high = wide.intervals["field.beta"]
    assert wide.at_bounds == () and low < 4.0 < high and "bounds" not in str(wide)
