"""`python -m experiments`: every module is listed with its question, and its toy run is one that it accepts."""

import importlib
import inspect
import subprocess
import sys

import pytest
from typer.testing import CliRunner

from experiments import __main__ as together
from experiments import _running

app = together.typer.Typer()
app.command()(together.main)


def answer(*arguments):
    return CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200"})


@pytest.mark.parametrize("name", together.names())
def test_an_experiment_asks_a_question_answers_it_and_can_be_run_small(name):
    assert together.question(name).endswith("?")
    module = importlib.import_module(f"experiments.{name}")
    assert callable(module.main)
    if hasattr(module, "QUICK"):
        inspect.signature(module.run).bind(**module.QUICK)


def test_the_list_names_every_experiment_with_the_minutes_of_the_readme():
    listed = answer()
    assert listed.exit_code == 0
    assert all(name in listed.output for name in together.names())
    assert together.minutes()["shear"] == "3"


def test_a_quick_run_calls_run_with_the_toy_arguments(monkeypatch):
    from experiments import shear, throughput

    called = {}
    monkeypatch.setattr(shear, "run", lambda **arguments: called.update(arguments))
    monkeypatch.setattr(sys, "argv", ["", "shear"])
    _running.main()
    assert called == shear.QUICK
    monkeypatch.delattr(throughput, "QUICK")
    monkeypatch.setattr(sys, "argv", ["", "throughput"])
    with pytest.raises(SystemExit) as ended:
        _running.main()
    assert ended.value.code == 3


def test_what_failed_or_cannot_be_run_small_is_named_at_the_end(monkeypatch, tmp_path):
    ended = [
        _running.Outcome("shear", "done", 1.0),
        _running.Outcome("throughput", "no QUICK", 1.0),
        _running.run_quickly("solvers.no_such_part", str(tmp_path)),
    ]
    monkeypatch.setattr(together, "outcomes", lambda chosen, quick: ended)
    found = answer("--quick")
    assert found.exit_code == 1
    assert "failed: solvers.no_such_part: ModuleNotFoundError" in found.output
    assert "no QUICK: throughput" in found.output
    assert "1 done" in found.output


def test_the_command_runs_them_side_by_side_in_processes_of_their_own():
    command = [sys.executable, "-m", "experiments", "--quick", "self_contact", "shear"]
    ended = subprocess.run(command, capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    assert "self_contact: done" in ended.stdout and "2 done" in ended.stdout


def test_an_unknown_experiment_is_refused_with_those_that_exist():
    refused = answer("--quick", "sheer")
    assert refused.exit_code == 2
    assert "sheer" in refused.output
