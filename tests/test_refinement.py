"""Refinement: the boundary of the finest grid is found, with few of its points, in whatever order they come."""

import numpy as np
import pytest

from jaxves.sweeps.refinement import wanted

N, STRIDE = 65, (8, 8)


def disk():
    x, y = np.meshgrid(np.linspace(0, 1, N), np.linspace(0, 1, N), indexing="ij")
    return np.where((x - 0.4) ** 2 + (y - 0.55) ** 2 < 0.3**2, "O", "P")


def refined(classes, chosen=lambda mask: mask, known=None, stride=STRIDE):
    """The points that end up computed when of those asked for `chosen` come at a time."""
    known = np.zeros(classes.shape, bool) if known is None else known
    while (asked := wanted(np.where(known, classes, ""), known, stride)).any():
        known = known | chosen(asked)
    return known


def test_all_points_at_the_boundary_are_computed_and_few_others():
    classes = disk()
    known = refined(classes)
    for axis in (0, 1):
        here, there = [np.take(classes, range(*ends), axis) for ends in ((0, N - 1), (1, N))]
        both = np.take(known, range(N - 1), axis) & np.take(known, range(1, N), axis)
        assert np.all(both[here != there])
    assert known.sum() < 0.25 * known.size


def test_the_points_do_not_depend_on_the_order_in_which_they_come():
    classes = disk()
    rng = np.random.default_rng(0)

    def some(mask):
        few = mask & (rng.random(mask.shape) < 0.1)
        return few if few.any() else mask

    np.testing.assert_array_equal(refined(classes, some), refined(classes))


def test_cases_without_a_class_ask_for_nothing():
    classes = np.full((9, 9), "P")
    classes[4, 4] = ""
    known = refined(classes, stride=(4, 4))
    assert known.sum() == 9


@pytest.mark.parametrize("axis", [0, 1])
def test_an_axis_that_is_not_refined_separates_nothing(axis):
    """Classes that differ from row to row alone ask for nothing between the columns."""
    classes = np.moveaxis(np.array([["P"] * 9, ["O"] * 9, ["POP"] * 9]), 0, axis)
    stride = (1, 8) if axis == 0 else (8, 1)
    assert refined(classes, stride=stride).sum() == 6
