"""Every experiment's `run()` at toy size: it runs, and says what it is for; every figure can be drawn."""

import json
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments import (
    _common,
    after_budding,
    beside_older,
    beside_others,
    close_evaluation,
    fast_sums,
    first_result,
    order_in_time,
    pop_and_budding,
    safeguards,
    scale,
    self_contact,
    shear,
    solvers,
    suspensions,
    throughput,
)

HERE = Path(_common.__file__).parent


@pytest.mark.slow
def test_throughput_counts_in_linear_solves_and_times_what_is_present():
    found = throughput.run(**throughput.QUICK)
    row = found["by size"][32]
    assert row["step / LU"] == row["step"] / row["LU"] > 0
    assert found["by what is present"]["flow"] > 0
    assert found["POP run"]["steps"] > 0
    throughput.draw(found)


def test_the_plain_code_that_jaxves_is_measured_against_computes_the_same():
    """Velocities for the same nodes and charge: spectrally close, so that both solve one problem."""
    coarse, fine = beside_others.same_computation(48), beside_others.same_computation(128)
    assert coarse < 1e-3 and fine < 1e-8


@pytest.mark.slow
def test_beside_others_times_all_schemes_and_knows_their_errors():
    row = beside_others.run(**beside_others.QUICK)["by size"][32]
    errors = row["error of the deformation"]
    assert all(seconds > 0 for seconds in row["seconds"].values())
    assert errors["jaxves, fourth order"] < 1e-6 < errors["plain NumPy"] < 1e-2
    assert row["over plain NumPy"]["plain NumPy"] == 1


def test_a_version_beside_itself_costs_the_same():
    row = beside_older.run(**beside_older.QUICK)["pop"]
    for key in ("equations", "flops", "bytes", "memory"):
        assert row["this"][key] == row["older"][key] > 0
    assert row["interval"][0] <= row["ratio"] <= row["interval"][1]


def test_the_time_to_a_first_result_is_counted_for_both_versions_cold_and_warm():
    row = first_result.run(**first_result.QUICK)["import"]
    assert all(row[version][kind]["cpu"] > 0.1 for version in ("older", "this") for kind in ("cold", "warm"))


@pytest.mark.slow
def test_order_in_time_sees_the_order():
    found = order_in_time.run(**order_in_time.QUICK)
    table = found["tank-treading"]["ARK4"]
    assert table["orders"]["x"][0] > 3
    assert max(table["area"]) < 1e-8
    order_in_time.draw(found)


def test_shear_meets_the_limits_of_a_circle():
    """Three vesicles, a quadratic: a per cent in both."""
    found = shear.run(**shear.QUICK)
    assert abs(found["limits"]["viscosity"] - 2) < 0.02
    assert abs(found["limits"]["inclination"] - np.pi / 4) < 0.01
    shear.draw(found)


def test_the_narrowest_chord_of_a_peanut_is_its_neck():
    """A third of its length, with no node on it."""
    x = jnp.asarray(solvers.SHAPES["peanut"](250, 0.5))
    width, tension, place = pop_and_budding.narrowest_chord(x, x[:, 0] ** 2)
    assert abs(width / (jnp.max(x[:, 0]) - jnp.min(x[:, 0])) - 1 / 3) < 1e-6
    assert abs(tension) < 1e-6
    assert np.max(np.abs(place)) < 1e-6


def test_the_first_minimum_is_found_between_saves():
    t = np.linspace(0, 1, 21)
    time, width = pop_and_budding.first_minimum(t, (t - 0.43) ** 2 + 0.1)
    assert abs(time - 0.43) < 1e-12
    assert abs(width - 0.1) < 1e-12
    assert np.isnan(pop_and_budding.first_minimum(t, -t)[0])


def test_a_conducting_vesicle_stays_prolate():
    found = pop_and_budding.run(**pop_and_budding.QUICK)
    assert pop_and_budding.classes(found)["Λ = 10"] == "P"
    assert found["POP"]["deformation_along_field"].min() < 0


def test_a_disturbance_of_the_symmetry_is_followed():
    found = after_budding.run(**after_budding.QUICK)
    row = found[3.2]
    assert row["status"] == "complete" and np.max(row["error"]) < 1e-2 and np.max(row["area"]) < 1e-5
    assert 1e-10 < np.max(row["asymmetry"]) < 1e-6
    after_budding.draw(found)


@pytest.mark.slow
def test_safeguards_shows_what_the_projection_is_worth():
    found = safeguards.run(**safeguards.QUICK)
    table = found["fixed"]["tank-treading"]
    assert table["no projection"]["length"][0] > 1e2 * table["both"]["length"][0]
    assert found["adaptive"]["POP"]["both"]["status"] == "complete"
    safeguards.draw(found)


def test_the_tension_operator_is_its_matrix_and_the_charge_operator_too():
    surfaces = jax.jit(solvers.surfaces_of)(solvers.SHAPES["Δ = 0.5"](64))
    v = jnp.asarray(np.random.default_rng(0).normal(size=64))
    plain = {"dense": False, "preconditioned": False}
    for make, how in ((solvers.tension_operator, plain), (solvers.charge_operator, {"dense": False})):
        dense, free = make(surfaces, dense=True), make(surfaces, **how)
        np.testing.assert_allclose(free.mv(v), dense.mv(v), atol=1e-12)


def test_the_preconditioner_of_the_tension_keeps_the_counts_low():
    found = solvers.run(**solvers.QUICK)
    counts = found["counts"]["Δ = 0.9"][64]
    assert counts["charge"] < 10
    assert 2 * counts["tension"] < counts["tension, plain"]
    assert max(found["timings"][64]["residuals"].values()) < 10 * solvers.TOLERANCE


def test_close_evaluation_converges():
    errors = close_evaluation.four_cases(sizes=(100, 150), reference=400)
    assert errors[150][0] < 1e-4 * errors[100][0] or errors[150][0] < 1e-12


def test_self_contact_shows_what_the_finer_grid_is_worth():
    wide, narrow = self_contact.run(**self_contact.QUICK)
    assert wide["factor"] == 1
    assert narrow["factor"] > 1
    for name in self_contact.POTENTIALS:
        assert narrow[f"corrected {name}"] < 1e-2 * narrow[f"plain {name}"]
    self_contact.draw([wide, narrow])


@pytest.mark.parametrize("name", sorted(path.stem for path in (HERE / "data").glob("*.json")))
def test_stored_numbers_say_where_they_come_from(name):
    stored = json.loads((HERE / "data" / f"{name}.json").read_text())
    assert stored["provenance"]["command"].replace(" --", "_") == f"python -m experiments.{name}"
    assert {"jaxves", "jax", "machine"} <= stored["provenance"].keys()


def test_every_figure_of_the_table_exists_and_is_small():
    named = set(re.findall(r"figures/(\w+\.png)", (HERE / "README.md").read_text()))
    assert named == {path.name for path in (HERE / "figures").iterdir()}
    assert all((HERE / "figures" / name).stat().st_size < 150_000 for name in named)


def test_the_rows_of_a_table_have_as_many_cells_as_its_head():
    head = None
    for line in (HERE / "README.md").read_text().splitlines():
        cells = len(re.findall(r"(?<!\\)\|", line)) if line.startswith("|") else None
        head = cells if head is None else head
        assert cells in (None, head), line
        head = None if cells is None else head


def test_vesicles_of_a_suspension_keep_their_distance():
    x = np.asarray(scale.suspension(9, 64).x)
    nearest = min(
        np.min(np.linalg.norm(x[i][:, None] - x[j][None], axis=-1)) for i in range(9) for j in range(i + 1, 9)
    )
    assert scale.GAP <= nearest < 3 * scale.GAP


def test_fast_sums_have_the_error_that_is_asked_for():
    (row,) = fast_sums.run(**fast_sums.QUICK)
    assert max(row[f"error of {sum}"] for sum in ("velocity", "gradient", "double layer")) < row["tolerance"]
    assert not row["lists too short"]
    assert all(seconds > 0 for seconds in row["seconds"].values())
    fast_sums.draw([row])


@pytest.mark.slow
def test_scale_steps_a_suspension_in_a_process_of_its_own():
    (row,) = scale.run(**scale.QUICK)
    assert row["finite"]
    assert row["residual"] < 1e-5  # a tenth of the tolerance
    assert row["peak"] > row["planned"] > 0
    assert row["parts"]["F"] > row["parts"]["sum of forces"] > 0
    scale.draw([row])


def test_the_error_of_a_mean_is_that_of_equal_parts():
    """Parts with the means 1, 2, 3 and 4, after a first third that is left out."""
    mean, error = suspensions.mean_and_error(np.concatenate([np.full(4, 9.0), np.repeat([1.0, 2.0, 3.0, 4.0], 2)]))
    assert mean == 2.5
    np.testing.assert_allclose(error, np.sqrt(5 / 3) / 2)


@pytest.mark.slow
def test_suspensions_in_shear_and_in_a_field_end_complete():
    found = suspensions.run(**suspensions.QUICK)
    (shear,), (field,) = found["shear"], found["field"]
    assert shear["status"] == field["status"] == "complete"
    assert 1 < shear["viscosity"] < 2 * shear["dilute"]
    assert field["conductivity"][-1] < field["conductivity"][0] < 1  # membranes charge
    suspensions.draw(found)


@pytest.mark.slow
def test_a_suspension_of_viscous_vesicles_in_shear_ends_complete():
    found = suspensions.contrast(**suspensions.QUICK_CONTRAST)
    (row,), counts = found["rows"], found["iterations"][2]
    assert row["status"] == "complete" and 1 < row["viscosity"] < 3
    assert 0 < counts["equal"] <= counts["5.0"] < 30


@pytest.mark.slow
def test_a_close_pair_costs_more_than_a_vesicle():
    found = scale.run_few(**scale.QUICK_FEW)
    assert found["pairs"]["near pair"] > found["pairs"]["single"]
