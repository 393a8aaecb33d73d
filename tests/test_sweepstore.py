"""The file of a sweep: what is acknowledged is there, and what several processes wrote comes together."""

import math

import numpy as np
import pytest

from jaxves.inputs.sweep_files import parse, plan
from jaxves.results import sweep_store
from jaxves.results.hdf5 import StoreError
from jaxves.results.sweep_store import Variable
from jaxves.results.sweep_writer import SweepWriter

BETA, CONDUCTANCE = "field.beta", "field.membrane_conductance"
PLAN = plan(parse({"scene": "pop", "axes": {BETA: [1.0, 2.0, 3.0], CONDUCTANCE: [0.0, 0.1]}}))
VARIABLES = {
    "status": Variable("1", "how the case ended", dtype="S16"),
    "passes": Variable("1", "passes given to the case", dtype="i1"),
    "class": Variable("1", "phase", dtype="S16"),
    "deformation_final": Variable("1", "deformation: at the end", ("vesicle",)),
}


def created(path, plan=PLAN, **how):
    return SweepWriter.create(path, plan, VARIABLES, {"vesicle": 1}, {"nodes": 64}, **how)


def outcomes(cases):
    """Each case has its own number as a result."""
    return {"class": np.full(len(cases), b"POP", "S16"), "deformation_final": np.array(cases, float)[:, None]}


def test_what_is_written_counts_at_once_and_nothing_else_does(tmp_path):
    with created(tmp_path / "a.h5") as writer:
        writer.write(np.array([1, 2, 5]), ["complete", "drift", "steady"], 1, outcomes([1, 2, 5]))
    record = sweep_store.read_sweep(tmp_path / "a.h5")
    assert record.status.tolist() == [["pending", "complete"], ["drift", "pending"], ["pending", "steady"]]
    np.testing.assert_array_equal(record.data["deformation_final"].ravel(), [math.nan, 1, 2, math.nan, math.nan, 5])
    assert record.classes[0, 1] == "POP" and record.classes[0, 0] == ""
    assert record.reasons[1, 0] and not record.reasons[0, 1]


def test_a_case_that_ran_out_of_steps_is_to_run_again(tmp_path):
    with created(tmp_path / "a.h5") as writer:
        writer.write(np.array([0, 1]), ["complete", "again"], 1, outcomes([0, 1]))
    record = sweep_store.read_sweep(tmp_path / "a.h5")
    assert record.status.ravel().tolist()[:3] == ["complete", "again", "pending"]
    assert record.passes.ravel().tolist()[:3] == [1, 1, 0]
    assert "second" in record.reasons[0, 1]


def test_files_of_several_processes_come_together_as_if_one_had_written_all(tmp_path):
    words = ["complete", "again", "steady"]
    with created(tmp_path / "whole.h5") as writer:
        writer.write(np.array([0, 1, 2]), words, 1, outcomes([0, 1, 2]))
        writer.write(np.array([4, 5]), ["complete", "collision"], 1, outcomes([4, 5]))
        writer.write(np.array([1]), ["too many steps"], 2, outcomes([1]))
    created(tmp_path / "main.h5").close()
    with created(tmp_path / "one.h5") as writer:
        writer.write(np.array([0, 1, 2]), words, 1, outcomes([0, 1, 2]))
    with created(tmp_path / "two.h5") as writer:
        writer.write(np.array([4, 5]), ["complete", "collision"], 1, outcomes([4, 5]))
    with SweepWriter(tmp_path / "main.h5") as writer:
        writer.merge(tmp_path / "one.h5")
        writer.merge(tmp_path / "two.h5")
    with created(tmp_path / "two.h5", force=True) as writer:
        writer.write(np.array([1]), ["too many steps"], 2, outcomes([1]))
    with SweepWriter(tmp_path / "main.h5") as writer:
        writer.merge(tmp_path / "one.h5")  # once more: nothing in it is news
        writer.merge(tmp_path / "two.h5")
    main, whole = sweep_store.read_sweep(tmp_path / "main.h5"), sweep_store.read_sweep(tmp_path / "whole.h5")
    np.testing.assert_array_equal(main.status, whole.status)
    np.testing.assert_array_equal(main.passes, whole.passes)
    np.testing.assert_array_equal(main.classes, whole.classes)
    np.testing.assert_array_equal(main.data["deformation_final"], whole.data["deformation_final"])


def test_refused_cases_are_there_from_the_start_with_their_complaint(tmp_path):
    wrong = plan(parse({"scene": "pop", "cases": [{BETA: 1.0}, {BETA: math.nan}]}))
    created(tmp_path / "a.h5", wrong).close()
    record = sweep_store.read_sweep(tmp_path / "a.h5")
    assert record.status.tolist() == ["pending", "refused"] and "field.beta = nan" in record.reasons[1]
    np.testing.assert_array_equal(record.coordinates[BETA][1], [1.0, math.nan])


def test_a_sweep_of_very_many_cases_has_room_for_its_text(tmp_path):
    cases = [{BETA: 1.0 + i / 7, CONDUCTANCE: i / 7} for i in range(3000)]
    many = plan(parse({"scene": "pop", "cases": cases}))
    created(tmp_path / "a.h5", many).close()
    assert len(sweep_store.read_sweep(tmp_path / "a.h5").attributes["sweep"]) > 2**16


def test_what_is_no_sweep_is_refused(tmp_path):
    (tmp_path / "text.h5").write_text("no HDF5")
    for name in ("text.h5", "none.h5"):
        assert not sweep_store.is_sweep(tmp_path / name)
        with pytest.raises(StoreError, match=name):
            sweep_store.read_sweep(tmp_path / name)
    with pytest.raises(StoreError, match=r"force=True \(--force on the command line\)"):
        created(tmp_path / "text.h5")
