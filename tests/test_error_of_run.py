"""The stated error of a whole run covers nodes and steps; a result that knows nothing is not complete."""

import h5py
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base import status
from jaxves.cli.commands import answer
from jaxves.inputs.parameters import with_nodes
from jaxves.inputs.scene_files import parse, to_toml
from jaxves.inputs.uses import RUN
from jaxves.numerics import fourier
from jaxves.observables import certificate
from jaxves.results import run_store
from jaxves.runs import error_estimate, runner
from jaxves.runs.build import build
from jaxves.runs.case import Case
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate
from jaxves.sweeps.case_summary import outcome

DRIVEN = {
    "t_end": 0.02,
    "saves": 4,
    "vesicle": [{"reduced_area": 0.576, "angle": 87.4566}],
    "field": {"beta": 14.2939, "conductivity_ratio": 669.6676, "chi": 0.0177, "permittivity_ratio": 2.0981},
    "flow": {"kind": "shear", "capillary_number": 0.3061},
}


def scene_file(nodes, tolerance=1e-4, **tables):
    return parse(DRIVEN | tables | {"numerics": {"nodes": nodes, "tolerance": tolerance}})


@pytest.fixture(scope="module")
def finer():
    """What the driven scene does, from 96 nodes and a tolerance of 1e-6."""
    return simulate(build(scene_file(96)), DRIVEN["t_end"], saves=4, march=Adaptive(1e-6))


def distance(record, result):
    """The largest distance in x and V_m, on the nodes of the finer run."""
    N = result.x.shape[2]
    pairs = [(record.x, result.x), (record.V_m, result.V_m)]
    return max(float(jnp.max(jnp.abs(fourier.resample(jnp.asarray(a), N, axis=2) - b))) for a, b in pairs)


@pytest.mark.parametrize("nodes", [40, 48, 64])
def test_the_error_of_a_run_covers_its_nodes(nodes, finer, tmp_path):
    """The nodes, not the steps, limit these runs: what they state is at least a tenth of the truth."""
    word = runner.run(scene_file(nodes), tmp_path / "run.h5")
    record = run_store.read_result(tmp_path / "run.h5")
    true = distance(record, finer)
    assert true > 1e-4 and 0.1 * true < record.attributes["error"] < 100 * true
    assert word in (*status.SUCCESS, "inaccurate")


def test_a_result_without_a_correct_digit_is_inaccurate_and_kept(tmp_path, capsys):
    """Exit status 3, advice, and all rows in the file; so in a Python result and in a case of a sweep."""
    path = tmp_path / "scene.toml"
    path.write_text(to_toml(scene_file(40)), encoding="utf-8")
    assert answer(["run", str(path), "--out", str(tmp_path / "run.h5")]) == 3
    said = capsys.readouterr().out
    assert "inaccurate" in said and "more nodes" in said
    record = run_store.read_result(tmp_path / "run.h5")
    assert record.status == "inaccurate" and len(record.t) == 5 and np.all(np.isfinite(record.x))
    with h5py.File(tmp_path / "run.h5") as file:
        assert float(file["certificate"].attrs["digits"]) < certificate.LEAST_DIGITS

    case = Case.of(scene_file(40), RUN)
    result = simulate(case.scene({}), 0.02, saves=4)
    assert result.word == "inaccurate" and result.digits < 1 and bool(jnp.all(jnp.isfinite(result.x)))
    found = outcome(case, (), case.march(), case.scene({}))
    assert int(found["status"]) == status.INACCURATE


def test_a_fixed_step_has_an_error_too(tmp_path):
    """POP for a short while with the first-order scheme: the error is near that of the step, and is stated."""
    tables = {"t_end": 0.02, "saves": 4, "vesicle": [{"reduced_area": 0.9, "angle": 90.0}]}
    tables |= {"field": {"beta": 3.2, "conductivity_ratio": 0.1}}
    file = parse(tables | {"numerics": {"nodes": 32, "time_step": 1e-3, "method": "euler"}})
    runner.run(file, tmp_path / "run.h5")
    record = run_store.read_result(tmp_path / "run.h5")
    right = simulate(build(with_nodes(file, 64)), 0.02, saves=4, march=Adaptive(1e-7))
    true = distance(record, right)
    assert 0.1 * true < record.attributes["error"] < 10 * true


def test_where_no_second_run_arrives_nothing_is_known(tmp_path, monkeypatch):
    """The error is infinite then, and the run is inaccurate."""
    monkeypatch.setattr(error_estimate, "_compared", lambda *arguments: None)
    word = runner.run(parse({"t_end": 1e-3, "saves": 1, "vesicle": [{"reduced_area": 0.9}]}), tmp_path / "run.h5")
    assert word == "inaccurate" and np.isposinf(run_store.read_result(tmp_path / "run.h5").attributes["error"])


def test_a_vesicle_at_rest_is_not_inaccurate():
    """Its powers and forces are round-off, and say nothing of its digits."""
    tables = {"t_end": 0.1, "saves": 2, "vesicle": [{"shape": "circle"}], "numerics": {"nodes": 32}}
    result = simulate(build(parse(tables)), 0.1, saves=2)
    assert result.word == "complete" and result.digits > 6


def test_the_error_is_taken_wherever_the_run_made_a_few_steps():
    """Most steps are in the first tenth: its saved times count, though all others have hardly a step between them."""
    steps = [0, 15, 21, 22, 23, 24, 25, 26, 27, 28, 29]
    assert list(error_estimate.instants(steps.__getitem__, 10)) == [0, 1, 2, 6, 10]
