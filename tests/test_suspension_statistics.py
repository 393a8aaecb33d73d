"""Statistics of suspensions: exact on lattices, on few points, and over all random walks of a length."""

import itertools

import numpy as np
import pytest

import jaxves
from jaxves.geometry.domain import Cell
from jaxves.observables.chains import chains
from jaxves.observables.displacements import mean_squared_displacement
from jaxves.observables.pair_distribution import pair_distribution
from jaxves.observables.structure_factor import structure_factor

SIDE = 6
SQUARE = np.stack(np.divmod(np.arange(SIDE**2), SIDE), axis=-1) + 0.3
# The same lattice of points, in a cell that leans and with every point in another image.
LEANING = np.array([[SIDE, 0.0], [2.0, SIDE]])
SCATTERED = SQUARE + np.random.default_rng(2).integers(-3, 4, (SIDE**2, 2)) @ LEANING


@pytest.mark.parametrize(("x", "lattice"), [(SQUARE, SIDE * np.eye(2)), (SCATTERED, LEANING)], ids=["square", "leans"])
def test_a_square_lattice_has_its_shells_of_neighbours(x, lattice):
    """4 at 1, 4 at √2, 4 at 2, 8 at √5, 4 at √8."""
    edges = np.array([0.0, 0.9, 1.1, 1.3, 1.5, 1.9, 2.1, 2.3, 2.7, 2.9])
    g = pair_distribution(x, lattice, edges).g[:, 0]
    neighbours = g * np.pi * np.diff(edges**2)  # the density is 1
    np.testing.assert_allclose(neighbours, [0, 4, 0, 4, 0, 4, 8, 0, 4][: len(g)], atol=1e-12)
    sectors = pair_distribution(x, lattice, [0.9, 1.1], sectors=3).g[0]
    # two along x in the middle, two along y at the edge of the others
    np.testing.assert_allclose([sectors[1], sectors[0] + sectors[2]] / np.sum(sectors), 0.5, atol=1e-12)


def test_random_places_are_not_correlated():
    edges, times, M = np.linspace(0.0, 5.6, 8), 200, 40
    x = np.random.default_rng(0).uniform(0, 1, (times, M, 2)) @ LEANING
    found = pair_distribution(x, LEANING, edges, sectors=3).g
    count = times * M * (M - 1) / np.linalg.det(LEANING) * np.pi * np.diff(edges**2)[:, None] / 3
    # every pair is counted in both orders, which doubles the variance; none is a vesicle and itself
    np.testing.assert_array_less(np.abs(found - (M - 1) / M) * np.sqrt(count / 2), 4)


@pytest.mark.parametrize(("x", "lattice"), [(SQUARE, SIDE * np.eye(2)), (SCATTERED, LEANING)], ids=["square", "leans"])
def test_a_square_lattice_scatters_into_its_own_wave_vectors_alone(x, lattice):
    found = structure_factor(x, lattice, 7)
    k, S = found.k[0] / (2 * np.pi), found.S[0]
    bragg = np.all(np.abs(k - np.round(k)) < 1e-9, axis=-1)
    assert np.sum(bragg) >= 2
    np.testing.assert_allclose(S[bragg], SIDE**2, rtol=1e-9)
    np.testing.assert_allclose(S[~bragg], 0.0, atol=1e-9)
    shells = found.radial([0.0, 2 * np.pi - 0.1, 2 * np.pi + 0.1])
    assert shells[0] < 1e-9 < shells[1]


def test_two_points_interfere():
    x, lattice = np.array([[0.1, 0.2], [1.3, 0.9]]), np.array([[5.0, 0.0], [1.0, 4.0]])
    found = structure_factor(np.stack([x, x + lattice[1]]), lattice, 3)
    np.testing.assert_allclose(found.S, 1 + np.cos(found.k @ (x[1] - x[0])), atol=1e-12)
    assert len(np.unique(np.round(np.abs(found.k[0]), 9), axis=0)) <= found.k.shape[1] == 3 * 7 + 3


def test_chains_are_followed_across_the_boundary():
    """Three in a row across the boundary, a pair across the direction, one that is bound to its own image, and one."""
    lattice = np.diag([10.0, 12.0])
    row = [[9.0, 1.0], [0.0 + 10.0, 1.0 - 12.0], [1.0, 1.0]]
    pair = [[5.0, 5.0], [5.0, 6.0]]
    x = np.array(row + pair + [[7.0, 9.0]])
    found = chains(x, lattice, 1.1)
    assert found.label.tolist() == [0, 0, 0, 1, 1, 2]
    assert found.size.tolist() == [3, 2, 1] and not np.any(found.spans)
    np.testing.assert_allclose(found.angle[:2], [0.0, np.pi / 2], atol=1e-12)
    assert np.isnan(found.angle[2])
    assert found.mean_length() == pytest.approx(14 / 6)
    assert found.order(0.0) == pytest.approx((3 - 2) / 5)
    along = chains(x, lattice, 1.1, direction=(1.0, 0.0))
    assert along.size.tolist() == [3, 1, 1, 1]
    ring = chains(np.array([[0.5, 0.0], [2.5, 0.0], [4.5, 0.0]]), np.diag([6.0, 9.0]), 2.1)
    assert ring.size.tolist() == [3] and ring.spans.tolist() == [True]


def test_all_random_walks_together_diffuse_exactly():
    """Every walk of 8 steps of ±1 along x, and of ±2 along y in the same order reversed: MSD = steps times length²."""
    steps = np.array(list(itertools.product((-1.0, 1.0), repeat=8)))
    walks = np.concatenate([np.zeros((1, len(steps))), np.cumsum(steps.T, axis=0)])
    back = np.concatenate([np.zeros((1, len(steps))), np.cumsum(2 * steps.T[::-1], axis=0)])
    t = 0.25 * np.arange(9)
    x = np.stack([walks, back], axis=-1) + 3.0 * t[:, None, None]  # a common motion is subtracted
    found = mean_squared_displacement(t, x, longest=1.0)
    np.testing.assert_allclose(found.squared, np.arange(9)[:, None] * [1.0, 4.0], atol=1e-12)
    np.testing.assert_allclose(found.diffusivity(), [2.0, 8.0], rtol=1e-12)
    gradient = np.array([[0.0, 3.0], [0.0, 0.0]])
    steps_y = 0.5 * (back[1:] + back[:-1]) * 0.25 * 3.0
    carried = x + np.stack([np.concatenate([np.zeros((1, len(steps))), np.cumsum(steps_y, axis=0)]), 0 * back], -1)
    still = mean_squared_displacement(t, carried - 3.0 * t[:, None, None], gradient=gradient, longest=1.0)
    np.testing.assert_allclose(still.squared, found.squared, atol=1e-10)


def test_lattices_of_a_sheared_cell_are_those_at_each_time():
    cell = Cell.of([[2.0, 0.0], [0.3, 2.0]], rate=5.0)
    found = cell.lattices(np.array([0.0, 0.1, 0.2]))
    np.testing.assert_allclose(found, [cell.lattice, [[2.0, 0.0], [-0.7, 2.0]], cell.lattice], atol=1e-14)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: jaxves.pair_distribution(SQUARE, np.eye(2), [0.0, 2.0]), "edges = .*, expected increasing distances"),
        (lambda: jaxves.pair_distribution(SQUARE[0], np.eye(2), [0.0, 0.5]), "centers = .*, expected an array"),
        (lambda: jaxves.structure_factor(SQUARE, -np.eye(2)[:, ::-1] @ np.diag([1, -1]), 0), "lattice|modes"),
        (lambda: jaxves.chains(SQUARE, SIDE * np.eye(2), 7.0), "reach = 7.0, expected a number > 0 and <= 6"),
        (lambda: jaxves.mean_squared_displacement([0, 1, 3], np.zeros((3, 2, 2))), "t = .*, expected three or more"),
    ],
)
def test_wrong_arguments_are_refused(call, said):
    with pytest.raises(ValueError, match=said):
        call()
