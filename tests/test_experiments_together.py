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


def test_a_quick_run_calls_run_with_the_toy_arguments_and_names_what_failed(monkeypatch):
    from experiments import shear, solvers, throughput

    called = {}
    monkeypatch.setattr(shear, "run", lambda **arguments: called.update(arguments))
    monkeypatch.setattr(solvers, "run", lambda **arguments: 1 / 0)
    monkeypatch.delattr(throughput, "QUICK")
    # In this process, where the replacements are.
    monkeypatch.setattr(together, "outcomes", lambda chosen, quick: map(_running.run_quickly, chosen))
    found = answer("--quick", "shear", "solvers", "throughput")
    assert called == shear.QUICK
    assert found.exit_code == 1
    assert "failed: solvers: ZeroDivisionError" in found.output
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
