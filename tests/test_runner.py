"""Runs into files: rows, ends, continuations to the last bit, relaxed starts, numbers of nodes."""

import tomllib

import numpy as np
import pytest
from conftest import Stops, stored

from jaxves.base import resolution, status
from jaxves.equation.projection import Filter
from jaxves.inputs.scene_files import parse
from jaxves.numerics import fourier
from jaxves.observables.certificate import certificate
from jaxves.results import hdf5, run_store, run_writer
from jaxves.runs import problem, rows, runner

BASE = "t_end = {t_end}\nsaves = {saves}\n"
VESICLE = "[[vesicle]]\nreduced_area = {}\nangle = 90.0\n"
FIELD = "[field]\nbeta = 3.2\nconductivity_ratio = 0.1\n"


def pop(*, t_end=0.06, saves=12, nodes=32, numerics="", stop="", area=0.9, average="average = [0.02, 0.05]\n"):
    """All of these march with one compiled program, as long as stepping and average are the same."""
    text = BASE.format(t_end=t_end, saves=saves) + average + VESICLE.format(area) + FIELD
    return parse(tomllib.loads(text + stop + f"[numerics]\nnodes = {nodes}\n" + numerics))


def quiet(*, area=0.9, relaxed="true", stop="[stop]\nsteady = 1e-3\n"):
    """Neither field nor flow."""
    text = BASE.format(t_end=1.0, saves=4) + VESICLE.format(area) + f"relaxed = {relaxed}\n"
    return parse(tomllib.loads(text + stop + "[numerics]\nnodes = 32\n"))


METHODS = {"adaptive": "", "fixed": 'time_step = 2e-3\nmethod = "euler"\n'}


@pytest.mark.parametrize("numerics", METHODS.values(), ids=METHODS)
def test_a_run_interrupted_and_resumed_has_the_bits_of_an_uninterrupted_one(tmp_path, numerics, monkeypatch):
    scene_file = pop(numerics=numerics)
    whole, parts = tmp_path / "whole.h5", tmp_path / "parts.h5"
    assert runner.run(scene_file, whole) == "complete"
    assert runner.run(scene_file, parts, progress=Stops(5)) == "interrupted"
    record = run_store.read_result(parts)
    assert len(record.t) == 6 and record.status == "interrupted" and "--resume" in record.attributes["advice"]
    assert stored(parts) != stored(whole)
    # Written in other blocks, and stopped once more.
    monkeypatch.setattr(rows, "SECONDS_BETWEEN_WRITES", 0.0)
    assert runner.run(scene_file, parts, resume=True, progress=Stops(2)) == "interrupted"
    assert runner.run(scene_file, parts, resume=True) == "complete"
    assert stored(parts) == stored(whole)
    assert "averages/stress" in stored(whole)


def test_a_result_holds_the_start_all_saved_times_and_what_made_it(tmp_path):
    path = tmp_path / "pop.h5"
    seen = []
    runner.run(pop(), path, progress=lambda t, t_end, text: seen.append(t))
    record = run_store.read_result(path)
    np.testing.assert_allclose(record.t, 0.06 * np.arange(13) / 12, rtol=1e-15)
    assert seen[-1] == 0.06 and sorted(seen) == seen and len(seen) >= 13
    start = problem.starting_scene(pop()).x
    np.testing.assert_allclose(record.x[0], start, atol=1e-3)  # the ellipse to what 32 nodes hold of it
    assert np.all(record.V_m[0] == 0) and np.all(record.nodes == 32) and record.nodes.shape == (13, 1)
    assert all(np.all(np.isfinite(values)) for values in record.diagnostics.values())
    assert parse(tomllib.loads(record.scene)) == pop()


def test_a_finished_run_has_nothing_to_resume_and_is_left_as_it_is(tmp_path):
    path = tmp_path / "pop.h5"
    runner.run(pop(), path)
    before = path.read_bytes()
    assert runner.run(pop(), path, resume=True) == "complete"
    assert path.read_bytes() == before


def test_a_file_is_resumed_with_its_own_scene_only(tmp_path):
    path = tmp_path / "pop.h5"
    runner.run(pop(), path, progress=Stops(3))
    before = path.read_bytes()
    with pytest.raises(hdf5.StoreError, match="another scene"):
        runner.run(pop(area=0.8), path, resume=True)
    assert path.read_bytes() == before


def test_a_run_ends_at_the_row_at_which_its_class_is_reached(tmp_path):
    path = tmp_path / "pop.h5"
    scene_file = pop(t_end=0.6, saves=60, stop='[stop]\nclass = "O"\n', average="average = [0.0, 0.6]\n")
    assert runner.run(scene_file, path) == "class reached"
    deformation = run_store.read_result(path).diagnostics["deformation_along_field"]
    assert len(deformation) < 61
    assert np.all(deformation[:-1] >= -0.01) and deformation[-1, 0] < -0.01


def test_a_run_that_breaks_down_keeps_its_rows_and_says_why(tmp_path):
    path = tmp_path / "broken.h5"
    word = runner.run(pop(area=0.4, t_end=0.6, saves=60, average="average = [0.0, 0.6]\n"), path)
    record = run_store.read_result(path)
    assert word == record.status and word not in {*status.SUCCESS, "interrupted"}
    assert 1 <= len(record.t) < 61 and np.all(np.isfinite(record.t)) and np.all(np.isfinite(record.x))
    assert record.attributes["advice"].startswith(status.ADVICE[word])
    with pytest.raises(hdf5.StoreError, match=word):
        runner.run(pop(area=0.4, t_end=0.6, saves=60, average="average = [0.0, 0.6]\n"), path, resume=True)


def test_a_disk_that_fails_ends_the_run_with_its_reason(tmp_path, monkeypatch):
    path = tmp_path / "full.h5"
    append = run_writer.Writer.append

    def until_full(self, block, restart, seconds):
        if self.saved >= 4:
            raise hdf5.StoreError(f"cannot write {path}: No space left on device")
        append(self, block, restart, seconds)

    monkeypatch.setattr(rows, "SECONDS_BETWEEN_WRITES", 0.0)
    monkeypatch.setattr(run_writer.Writer, "append", until_full)
    with pytest.raises(runner.Broken, match="No space left"):
        runner.run(pop(), path)
    assert len(run_store.read_result(path).t) == 4


def test_a_relaxed_vesicle_starts_at_rest_in_its_place_and_direction(tmp_path):
    """With `steady`, such a run ends at its first saved time."""
    path = tmp_path / "relaxed.h5"
    assert runner.run(quiet(), path) == "steady"
    record = run_store.read_result(path)
    assert len(record.t) == 2
    ellipse = tmp_path / "ellipse.h5"
    runner.run(quiet(relaxed="false"), ellipse)
    first = run_store.read_result(ellipse)
    assert len(first.t) > 2
    assert record.diagnostics["bending_energy"][0] < first.diagnostics["bending_energy"][0] - 1e-3
    for name, tolerance in {"area": 1e-7, "length": 1e-7, "center": 1e-6}.items():
        np.testing.assert_allclose(record.diagnostics[name][0], first.diagnostics[name][0], atol=tolerance)
    np.testing.assert_allclose(abs(record.diagnostics["inclination"][0]), np.pi / 2, atol=1e-6)


def test_a_vesicle_that_does_not_relax_is_named_in_the_file(tmp_path):
    path = tmp_path / "tight.h5"
    word = runner.run(quiet(area=0.15), path)
    record = run_store.read_result(path)
    assert word == record.status not in status.SUCCESS
    assert len(record.t) == 1 and "vesicle 0 did not relax" in record.attributes["advice"]
    with pytest.raises(hdf5.StoreError):
        runner.run(quiet(area=0.15), path, resume=True)


@pytest.mark.parametrize("area", [0.95, 0.6, 0.3])
def test_auto_takes_the_fewest_nodes_that_resolve_the_start(area):
    def with_nodes(nodes):
        text = BASE.format(t_end=1.0, saves=4) + VESICLE.format(area) + f"[numerics]\nnodes = {nodes}\n"
        return problem.starting_scene(parse(tomllib.loads(text))).x[0]

    def tail(x):
        return fourier.spectral_tail(x, Filter.for_nodes(x.shape[0]).x)

    chosen = with_nodes('"auto"')
    N = chosen.shape[0]
    sizes = resolution.sizes_up_to(0)
    assert N in sizes
    np.testing.assert_array_equal(chosen, with_nodes(N))
    if sizes[-1] != N:
        assert tail(chosen) < 1e-6
    for fewer in sizes[: sizes.index(N)]:
        assert tail(with_nodes(fewer)) >= 1e-6


def test_the_error_of_a_run_is_known_within_a_factor_of_three(tmp_path):
    """Against a run of which no error is left, with nodes enough that time makes what error there is."""
    records = {}
    for tolerance in (1e-4, 1e-8):
        scene_file = pop(t_end=0.3, saves=6, nodes=64, average="", numerics=f"tolerance = {tolerance}\n")
        assert runner.run(scene_file, tmp_path / f"{tolerance}.h5") == "complete"
        records[tolerance] = run_store.read_result(tmp_path / f"{tolerance}.h5")
    rough, fine = records[1e-4], records[1e-8]
    true = max(np.max(np.abs(rough.x - fine.x)), np.max(np.abs(rough.V_m - fine.V_m)))
    assert true / 3 < rough.attributes["error"] < 3 * true
    assert certificate(rough.diagnostics, rough.attributes["error"])["run"].value == rough.attributes["error"]


def test_the_error_of_a_run_is_estimated_where_it_is_wanted(tmp_path):
    for number, (numerics, wanted) in enumerate((("certify = false\n", False), (METHODS["fixed"], True))):
        runner.run(pop(numerics=numerics), tmp_path / f"{number}.h5")
        assert ("error" in run_store.read_result(tmp_path / f"{number}.h5").attributes) == wanted


def test_runs_that_differ_in_numbers_share_their_programs(tmp_path, calls_of):
    """The second one traces nothing, whatever its field is."""
    runner.run(pop(numerics="certify = false\n"), tmp_path / "first.h5")
    calls = calls_of(problem, "initial_state")
    other = pop(numerics="certify = false\n")
    field = other.field.model_copy(update={"beta": 2.5, "conductivity_ratio": 0.2})
    runner.run(other.model_copy(update={"field": field}), tmp_path / "second.h5")
    assert not calls
