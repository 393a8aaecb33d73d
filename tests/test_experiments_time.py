"""The experiments on accuracy, run time and stability, at toy size."""

import json

import jax.numpy as jnp
import numpy as np
import pytest
from conftest import star

from experiments import convergence, long_run, stability
from experiments._common import HERE
from experiments._distance import distances
from experiments._schemes import ARK2, ARK3
from jaxves.numerics import fourier


def rows_of(x, V_m):
    return {"x": x[None, None], "V_m": V_m[None, None], "tension": 3 * V_m[None, None]}


def test_the_distance_of_two_outlines_does_not_see_their_nodes():
    """The same star from other nodes, with a function of place on it: apart by round-off."""

    def sampled(N, shift):
        alpha = fourier.grid(N) + shift
        radius = 1 + 0.2 * jnp.cos(3 * alpha)
        x = radius[:, None] * jnp.stack([jnp.cos(alpha), jnp.sin(alpha)], axis=-1)
        return rows_of(x, jnp.sin(alpha))

    found = distances(sampled(64, 0.03), sampled(96, 0.0))
    assert max(value.max() for value in found.values()) < 1e-14


def test_the_distance_of_two_outlines_is_the_one_along_the_normal():
    x = star(128)
    V_m = jnp.zeros(128)
    moved = jnp.array([3e-9, -4e-9])
    apart = distances(rows_of(x + moved, V_m + 2e-9), rows_of(x, V_m + 1.0))
    # somewhere on a closed curve the normal points along the displacement, but for the spacing of the nodes
    assert abs(apart["shape"][0] / 5e-9 - 1) < 1e-2
    np.testing.assert_allclose(apart["V_m"], 1 - 2e-9, rtol=1e-12)
    np.testing.assert_allclose(apart["tension"], 1 - 2e-9, rtol=1e-12)


def test_the_baselines_satisfy_their_order_conditions():
    """Both parts, with the coupling conditions, which equal abscissae and weights reduce to these."""
    for scheme in (ARK2, ARK3):
        table = scheme.tableau
        b, c = table.weights, table.times
        np.testing.assert_allclose(table.implicit.sum(axis=1), c, atol=1e-14)
        conditions = [b.sum() - 1, b @ c - 1 / 2, table.error_weights.sum()]
        if scheme.order > 2:
            conditions += [b @ c**2 - 1 / 3, b @ table.explicit @ c - 1 / 6, b @ table.implicit @ c - 1 / 6]
            conditions += [table.error_weights @ c]
        np.testing.assert_allclose(conditions, 0, atol=1e-14)
        assert np.max(np.abs(table.error_weights)) > 1e-3


def test_seconds_for_an_error_lie_between_two_runs_or_follow_the_order():
    table = {"shape": [1e-2, 1e-4], "seconds": [1.0, 10.0], "steps": [100, 1000]}  # order 2
    np.testing.assert_allclose(convergence.seconds_for(table, 1e-3)[0], np.sqrt(10))
    np.testing.assert_allclose(convergence.seconds_for(table, 1e-6), (100.0, 2.0))
    stuck = table | {"shape": [1e-2, 1e-2]}
    assert np.isnan(convergence.seconds_for(stuck, 1e-3)[0])


def test_runs_by_default_are_those_of_the_scheme_that_a_scene_file_takes():
    ark4 = {"settings": [1e-3, 1e-5, 1e-6], "shape": [1.0, 2.0, 3.0], "V_m": [0.1, 0.2, 0.3]}
    ark5 = {name: [10 * value for value in values] for name, values in ark4.items()} | {"settings": ark4["settings"]}
    schemes = {"Euler": {"settings": [500], "shape": [7.0], "V_m": [7.0]}, "ARK4": ark4, "ARK5": ark5}
    assert convergence.by_default(schemes, 1)["shape"] == (1.0, 2.0, 30.0)
    assert convergence.by_default(schemes, 2)["V_m"] == (0.1, 2.0, 3.0)
    finer = {"ARK5": ark5 | {"shape": [4.0, 5.0, 6.0]}}
    taken = convergence.resolved({"64": schemes, "96": finer}, {64: 1e-5, 96: 1e-6}, 1)
    assert taken == {"settings": (1e-3, 1e-5, 1e-6), "shape": (1.0, 2.0, 6.0), "V_m": (0.1, 0.2, 3.0)}
    assert convergence.resolved({"64": schemes}, {64: 1e-5}, 1)["settings"] == (1e-3, 1e-5)


def test_convergence_compares_schemes_with_one_reference():
    found = convergence.run(**convergence.QUICK)["tank-treading"]
    tables = found["nodes"]["32"]
    assert found["reference"]["shape"] < 1e-4
    rough, fine = tables["ARK4"]["shape"]
    assert fine < rough < min(10 * 1e-3, tables["Euler"]["shape"][0])
    assert tables["ARK4"]["rates"][0] >= 6 * tables["ARK4"]["steps"][0]
    assert len(found["amplification"]) == 5
    assert all(0 < grown < 1 for grown in found["amplification"].values())  # treading forgets its start
    convergence.draw({"tank-treading": found})


def test_stability_finds_the_usual_right_and_says_where_it_stops():
    """β/χ = 32000 compresses the membrane until it wrinkles more finely than any node spacing."""
    found = stability.run(**stability.QUICK)["field"]
    usual, wrinkled = found["N=32"], found["χ=0.0001 N=32"]
    assert usual["verdict"] == "right"
    assert 0 < usual["error"] < 1e-3
    assert (wrinkled["verdict"], wrinkled["word"]) == ("stopped", "unresolved")
    stability.draw({"field": found})


def test_labels_name_what_is_unusual_and_times_shrink_with_what_is_fast():
    assert stability.Cell().label() == "usual"
    assert stability.Cell(conductivity_ratio=np.inf, Ca=10.0).label() == "Λ=inf Ca=10"
    assert stability.Cell(Ca=1000.0).t_end() == 0.02
    assert stability.Cell(chi=0.01, beta=100.0).t_end() == 0.005
    cells = [cell for cells in stability.GROUPS.values() for cell in cells]
    assert len({cell.label() for cell in cells}) == len(cells) >= 60


def test_a_long_run_keeps_area_perimeter_and_spacing():
    found = long_run.run(**long_run.QUICK)
    (row,) = found.values()
    assert row["status"] == "complete"
    assert row["steps"] == 80
    assert max(row["area"], row["length"]) < 1e-7
    assert 0 < row["inclination"] < 0.1


@pytest.mark.parametrize("name", ["convergence", "stability"])
def test_stored_numbers_keep_what_the_experiments_promise(name):
    """No cell wrong; POP at 1/500 of the first-order time; 1e-8 reached."""
    data = json.loads((HERE / "data" / f"{name}.json").read_text())["data"]
    if name == "stability":
        groups = [cells for group, cells in data.items() if group != "largest step"]
        assert not {label for cells in groups for label, cell in cells.items() if cell["verdict"] == "wrong"}
        return
    tables = data["POP"]["nodes"]["64"]
    euler, _ = convergence.seconds_for(tables["Euler"], 1e-4)
    assert euler > 500 * convergence.seconds_for(tables["ARK4"], 1e-4)[0]
    for scene in ("POP", "tank-treading"):
        assert np.nanmin(data[scene]["nodes"]["96"]["ARK5"]["shape"]) < 1e-8
