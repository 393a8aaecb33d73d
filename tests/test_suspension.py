"""Suspensions: as many copies as asked for, without overlap across the cell, the same for the same seed."""

import itertools
import tomllib

import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.geometry import Polygon

from jaxves.geometry.placement import GAP, NoRoom, lattice_places, random_suspension
from jaxves.inputs.scene_files import SceneError, parse, to_toml

LATTICE = [[9.0, 0.0], [2.0, 8.0]]


def tables(cell=True, **suspension):
    vesicle = {"reduced_area": 0.9, "length": 0.9}
    found = {"t_end": 1.0, "vesicle": [vesicle], "suspension": suspension}
    return found | ({"cell": {"lattice": LATTICE}} if cell else {})


def least_distance(polygons, lattice):
    """Between any two images."""
    moved = [
        affinity.translate(polygon, *(np.array([m, n]) @ lattice))
        for m, n in itertools.product((-2, -1, 0, 1, 2), repeat=2)
        for polygon in polygons
    ]
    return min(a.distance(b) for a in polygons for b in moved if not shapely.equals(a, b))


def test_a_random_suspension_keeps_the_gap_across_the_boundary():
    angle = np.arange(32) * (2 * np.pi / 32)
    x = np.stack([1.2 * np.cos(angle), 0.7 * np.sin(angle)], axis=-1)
    found = random_suspension(x, LATTICE, count=10, seed=4)
    assert found.shape == (10, 32, 2)
    assert GAP <= least_distance([Polygon(nodes) for nodes in found], np.array(LATTICE)) < 10 * GAP
    np.testing.assert_array_equal(found, random_suspension(x, LATTICE, count=10, seed=4))
    assert np.any(found != random_suspension(x, LATTICE, count=10, seed=5))
    with pytest.raises(NoRoom, match=r"no room for vesicle \d+ of 100"):
        random_suspension(x, LATTICE, count=100)


def test_a_suspension_becomes_vesicles_when_it_is_read():
    file = parse(tables(area_fraction=0.35, seed=3, size_spread=0.1, reduced_area_spread=0.03))
    assert file.suspension is None
    areas = [np.pi * vesicle.reduced_area * vesicle.length**2 for vesicle in file.vesicle]
    assert abs(sum(areas) / 72.0 - 0.35) < 0.05
    lengths = [vesicle.length / 0.9 for vesicle in file.vesicle]
    assert 0.05 < np.std(lengths) < 0.2
    again = parse(tomllib.loads(to_toml(file)))
    assert again == file


def test_each_copy_has_undulations_of_its_own():
    """The seeds follow from that of the table, and a file that is written and read again keeps them."""
    thermal = {"temperature": 0.01, "seed": 5, "modes": 8}

    def seeds(thermal):
        wanted = tables(count=4, seed=3)
        wanted["vesicle"] = [wanted["vesicle"][0] | {"disturbance": thermal}]
        file = parse(wanted)
        assert parse(tomllib.loads(to_toml(file))) == file
        return [vesicle.disturbance.seed for vesicle in file.vesicle]

    assert len({*seeds(thermal), *seeds(thermal | {"seed": 6})}) == 8
    assert seeds(thermal) == seeds(thermal)


def test_a_lattice_of_places_fills_the_cell_evenly():
    places = lattice_places(12, np.diag([8.0, 6.0]))
    assert len(np.unique(np.round(places, 9), axis=0)) == 12
    assert {tuple(np.round(place, 9)) for place in places} == {(x, y) for x in (1, 3, 5, 7) for y in (1, 3, 5)}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (tables(cell=False, count=3), r"suspension, expected a \[cell\]"),
        (tables(), "suspension.count is missing, expected either count or area_fraction"),
        (tables(count=3, area_fraction=0.2), "suspension.count = 3, expected either"),
        (tables(area_fraction=1.2), "suspension.area_fraction = 1.2, expected a number > 0 and < 1"),
        (tables(area_fraction=0.9), "suspension.area_fraction = 0.9, expected fewer vesicles"),
        (tables(area_fraction=0.001), "suspension.area_fraction = 0.001, expected at least 0.03"),
        (tables(count=2, arrangement="square"), 'suspension.arrangement = "square"'),
        (tables(count=2, reduced_area_spread=0.4, seed=1), "suspension.reduced_area_spread = 0.4, expected less"),
    ],
)
def test_a_wrong_suspension_is_refused(wrong, said):
    with pytest.raises(SceneError, match=said):
        parse(wrong)
