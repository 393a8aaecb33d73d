"""A fit says whether its χ² is improbable: then the intervals are too narrow."""

import numpy as np
import pytest
from scipy.stats import chi2

from jaxves.analysis.fit import Fit


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
