"""What interrupts long work, and what is left of it: signals, a limit of time, and one exit status for each."""

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from jaxves.cli import interrupts
from jaxves.cli.commands import answer
from jaxves.results import hdf5, ownership, restart, run_store, run_writer, sweep_store, sweep_writer
from jaxves.runs import runner
from jaxves.sweeps import sweeping

SCENE = "t_end = 1.0\n[[vesicle]]\nreduced_area = 0.9\n"
SWEEP = "[scene]\nt_end = 1.0\n[[scene.vesicle]]\nreduced_area = 0.9\n[axes]\n'vesicle.bending' = [1.0, 2.0]\n"


def call(*arguments):
    """Exit status, standard output and standard error of one command, in this process."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = answer([str(argument) for argument in arguments])
    return code, out.getvalue(), err.getvalue().strip()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("5400", 5400.0),
        ("0.5", 0.5),
        (".5", 0.5),
        ("90s", 90.0),
        ("90m", 5400.0),
        ("1.5h", 5400.0),
        ("2d", 172800.0),
        ("1:30:00", 5400.0),
        ("30:00", 1800.0),
        ("00:00:01", 1.0),
        ("2-12:00:00", 216000.0),
    ],
)
def test_a_limit_of_time_is_given_in_seconds_in_other_units_or_as_on_a_clock(text, expected):
    assert interrupts.seconds(text) == expected


@pytest.mark.parametrize(
    "text", ["0", "0:00", "0h", "-5", "soon", "", "1e3", "nan", "inf", "1.5:00", "1:2:3:4", "1-30", "90 m", "90x", "١"]
)
@pytest.mark.parametrize("command", ["run", "sweep"])
def test_what_is_no_positive_time_is_refused_in_one_line(tmp_path, command, text):
    code, out, err = call(command, "pop", "--out", tmp_path / "out.h5", f"--max-time={text}")
    assert (code, out, err.count("\n")) == (2, "", 0)
    assert err.startswith(f"jaxves: --max-time = {text}, expected a positive time")
    assert list(tmp_path.iterdir()) == []


class Work:
    """Stands for a run or a sweep: shows progress for ever, and ends as those do."""

    def __init__(self, folder, *, at_first=lambda: None, at_the_end=lambda: None):
        self.out, self.scene, self.sweep = folder / "out.h5", folder / "scene.toml", folder / "sweep.toml"
        self.scene.write_text(SCENE)
        self.sweep.write_text(SWEEP)
        self.at_first, self.at_the_end, self.ended = at_first, at_the_end, 0

    def run(self, scene_file, path, *, progress, **how):
        datasets = {name: described for name, described in run_store.HISTORY.items() if name != "V_m"}
        options = {"times": np.arange(9.0), "vesicles": 1, "nodes": 8, "datasets": datasets}
        with run_writer.Writer(path, scene_text="", attributes={}, **options) as writer:
            with contextlib.suppress(KeyboardInterrupt):
                self.forever(lambda: progress(0.5, 1.0, "half"))
            self.at_the_end()
            writer.finish("interrupted", "advice", 1.0)
        self.ended += 1
        return "interrupted"

    def swept(self, file, results, *, progress, **how):
        try:
            self.forever(lambda: progress(1, 2, "cases"))
        finally:
            self.at_the_end()
            self.ended += 1

    def forever(self, show):
        self.at_first()
        end = time.monotonic() + 20
        while time.monotonic() < end:
            show()
            time.sleep(0.01)
        raise TimeoutError


def send(*signals):
    def sends():
        for signum in signals:
            os.kill(os.getpid(), signum)

    return sends


@pytest.fixture
def work(tmp_path, monkeypatch):
    def made(**when):
        work = Work(tmp_path, **when)
        monkeypatch.setattr(runner, "run", work.run)
        monkeypatch.setattr(sweeping, "sweep", work.swept)
        return work

    handlers = [signal.getsignal(signum) for signum in (signal.SIGINT, signal.SIGTERM)]
    yield made
    assert [signal.getsignal(signum) for signum in (signal.SIGINT, signal.SIGTERM)] == handlers


@pytest.mark.parametrize(
    ("first", "later", "expected"),
    [
        ([signal.SIGINT], [], 130),
        ([signal.SIGTERM], [], 143),
        ([signal.SIGTERM, signal.SIGTERM], [signal.SIGTERM], 143),
        ([signal.SIGINT], [signal.SIGTERM, signal.SIGINT], 130),
        ([signal.SIGTERM], [signal.SIGINT], 143),
    ],
)
def test_the_first_signal_decides_the_exit_status_and_later_ones_do_not_disturb_the_end(work, first, later, expected):
    doing = work(at_first=send(*first), at_the_end=send(*later))
    code, out, err = call("run", doing.scene, "--out", doing.out)
    assert (code, doing.ended, err) == (expected, 1, "")
    assert "interrupted" in out and run_store.read_result(doing.out).status == "interrupted"
    code, _, err = call("sweep", doing.sweep, "--out", doing.out.with_name("sweep.h5"))
    assert (code, doing.ended, err) == (expected, 2, "")


def limit_in(seconds):
    """The limit of time that interrupts in so many seconds: a tenth of it, at most a minute, is left after that."""
    due = time.monotonic() - interrupts._BEGAN + seconds
    return min(due / (1 - interrupts._SHARE), due + interrupts._RESERVE)


@pytest.mark.parametrize("age", [0.0, 3600.0])
def test_a_limit_of_time_interrupts_in_time_and_says_so(age, work, monkeypatch):
    """Of a process that has just begun, and of one an hour old, for which a minute is left at the end."""
    monkeypatch.setattr(interrupts, "_BEGAN", time.monotonic() - age)
    began, doing = time.monotonic(), work()
    code, out, err = call("run", doing.scene, "--out", doing.out, "--max-time", f"{limit_in(0.5):.6f}")
    assert (code, doing.ended) == (130, 1) and time.monotonic() < began + 10
    assert "interrupted" in out and err == "jaxves: interrupted before the time limit of --max-time."
    code, _, err = call("sweep", doing.sweep, "--out", doing.out.with_name("sweep.h5"), "--max-time", "1s")  # long over
    assert code == 130 and "--max-time" in err


def test_work_that_ends_by_itself_is_not_disturbed_by_its_limit():
    with interrupts.heard(limit_in(0.3)) as found:
        pass
    time.sleep(0.5)
    assert found.signals == [] and not found.time_is_up


def terminated_in(module):
    """SIGTERM comes while code of this module runs."""
    exec(compile("import signal; signal.raise_signal(signal.SIGTERM)", module.__file__, "exec"), {})


@pytest.mark.parametrize("module", [run_store, run_writer, hdf5, restart, ownership, sweep_store, sweep_writer, json])
def test_a_signal_waits_while_a_file_is_written_or_other_code_runs(module):
    """It may not leave a row or the end of a run half written, nor a library in the middle of something."""
    with interrupts.heard() as found:
        terminated_in(module)
        assert found.signals == [signal.SIGTERM]
        with pytest.raises(KeyboardInterrupt):
            found.check()


def test_a_signal_is_raised_at_once_in_other_code_of_the_package():
    with interrupts.heard() as found:
        with pytest.raises(KeyboardInterrupt):
            terminated_in(runner)
        terminated_in(runner)
        assert found.signals == [signal.SIGTERM] * 2 and found.exit_status == 143


COMPILING = """
import sys, time
from jaxves.cli import interrupts

with interrupts.heard(time.monotonic() - interrupts._BEGAN + 1.0):
    {}
"""


@pytest.mark.parametrize("busy", ["time.sleep(60)", "[time.sleep(0.01) for _ in range(6000)]"])
def test_a_process_that_cannot_be_interrupted_ends_at_its_limit(busy):
    """As in compiled code, where nothing is heard, or in a library in which nothing is raised."""
    began, program = time.monotonic(), COMPILING.format(busy)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=50, check=False)
    assert done.returncode == 130 and time.monotonic() < began + 40
    assert done.stderr.startswith("jaxves: stopped by --max-time") and done.stderr.count("\n") == 1
