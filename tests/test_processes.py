"""Several processes and one result file; runs that are extended; runs that start where another ended."""

import contextlib
import io
import os
import subprocess
import sys
import threading
import time
import tomllib
import types
from pathlib import Path

import h5py
import jax.numpy as jnp
import numpy as np
import pytest
from conftest import stored

import jaxves
from jaxves.cli.commands import answer
from jaxves.inputs.scene_files import parse
from jaxves.numerics import fourier
from jaxves.results import ownership, run_store, sweep_store
from jaxves.results.hdf5 import StoreError
from jaxves.results.ownership import writer_of, writing
from jaxves.runs import rows, runner
from jaxves.runs.adapt_nodes import Resolution
from jaxves.runs.earlier import started_from

SCENE = """t_end = {t_end}
saves = {saves}
[[vesicle]]
reduced_area = 0.9
angle = 90.0
[field]
beta = {beta}
conductivity_ratio = 0.1
[numerics]
nodes = 24
tolerance = 1e-2
certify = false
"""


def text(t_end=0.04, saves=4, beta=1.0):
    return SCENE.format(t_end=t_end, saves=saves, beta=beta)


def scene(**changes):
    return parse(tomllib.loads(text(**changes)))


def call(*arguments):
    """Exit status, standard output and standard error of one command, in this process."""
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        code = answer([str(argument) for argument in arguments])
    return code, out.getvalue(), err.getvalue().strip()


def names(folder):
    return sorted(path.name for path in folder.iterdir())


class After:
    """Does something once so many saved times have been computed, as progress is shown."""

    def __init__(self, rows, action):
        self.rows, self.action = rows, action

    def __call__(self, t, t_end, said):
        self.rows -= t > 0
        if self.rows == 0:
            self.action()


def say_running(path):
    with h5py.File(path, "r+") as file:
        file.attrs["status"] = "running"


def interrupt():
    raise KeyboardInterrupt


# --- one writer for each file -------------------------------------------------------------------

HOLDER = """
import sys
from pathlib import Path
from jaxves.runs.earlier import started_from
from jaxves.results.ownership import writing

with writing(Path(sys.argv[1])):
    print("holding", flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def holder(tmp_path):
    """A process that writes `out.h5` until it reads a line."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, tmp_path / "out.h5"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "holding\n"
        yield process
        process.kill()


@pytest.fixture
def finished(tmp_path):
    """The file of a run that is complete."""
    assert runner.run(scene(), tmp_path / "out.h5") == "complete"
    return tmp_path / "out.h5"


@pytest.mark.parametrize("how", ["--force", "--resume"])
def test_a_file_that_another_process_writes_is_refused_and_left_as_it_is(finished, holder, tmp_path, how):
    (tmp_path / "scene.toml").write_text(text())
    say_running(finished)
    before = finished.read_bytes()
    code, out, err = call("run", tmp_path / "scene.toml", "--out", finished, how)
    assert (code, out, err.count("\n")) == (2, "", 0)
    assert f"{finished} is being written by another run (process {holder.pid} on " in err and "another file" in err
    assert finished.read_bytes() == before


def test_the_lock_of_a_killed_process_blocks_no_one(finished, holder, tmp_path):
    assert writer_of(finished).startswith(f"process {holder.pid} on ")
    holder.kill()
    holder.wait()
    assert ".out.h5.lock" in names(tmp_path) and writer_of(finished) is None
    assert runner.run(scene(), finished, force=True) == "complete"
    assert names(tmp_path) == ["out.h5"]


def test_a_second_run_in_the_same_process_is_refused_even_before_the_file_exists(tmp_path):
    """The first is still compiling, or relaxing a vesicle."""
    path, refused = tmp_path / "out.h5", []

    def second(t, t_end, said):
        if said == "compiling":
            assert not path.exists()
            with pytest.raises(StoreError, match=f"being written by another run .process {os.getpid()} on"):
                runner.run(scene(beta=2.0), path)
            refused.append(said)

    assert runner.run(scene(), path, progress=second) == "complete"
    assert refused and "beta = 1.0" in run_store.read_result(path).scene
    assert names(tmp_path) == ["out.h5"]


def test_a_command_is_refused_before_anything_slow_is_imported(finished, holder, tmp_path):
    (tmp_path / "scene.toml").write_text(text())
    program = "import sys; from jaxves.cli.commands import answer; print(answer(sys.argv[1:]), 'jax' in sys.modules)"
    for how in ("--force", "--resume"):
        arguments = ["run", tmp_path / "scene.toml", "--out", finished, how]
        done = subprocess.run([sys.executable, "-c", program, *arguments], capture_output=True, text=True, check=True)
        assert done.stdout == "2 False\n" and done.stderr.count("\n") == 1
        assert f"being written by another run (process {holder.pid} on " in done.stderr


@pytest.mark.parametrize("alive", [False, True])
def test_a_lock_file_of_another_user_blocks_no_one_unless_that_one_still_writes(tmp_path, holder, monkeypatch, alive):
    path, opens = tmp_path / "out.h5", os.open
    mine = tmp_path / ".out.h5.lock"
    if not alive:
        holder.kill()
        holder.wait()
    others = mine.stat().st_ino

    def refused(name, flags, *mode):
        if Path(name) == mine and mine.exists() and mine.stat().st_ino == others and flags & os.O_RDWR:
            raise PermissionError(13, "Permission denied")
        return opens(name, flags, *mode)

    monkeypatch.setattr(os, "open", refused)
    if alive:
        with pytest.raises(StoreError, match=f"another run .process {holder.pid} on"), writing(path):
            pass
    else:
        with writing(path):
            assert writer_of(path).startswith(f"process {os.getpid()} on ")
        assert names(tmp_path) == []


def test_on_windows_there_is_one_writer_as_well(tmp_path, monkeypatch):
    """Its lock is on one byte, in the way of whoever reads that byte, and an open file cannot be removed."""
    flock, exclusive = ownership.fcntl.flock, ownership.fcntl.LOCK_EX | ownership.fcntl.LOCK_NB

    def locking(descriptor, mode, count):
        assert (mode, count) == ("LK_NBLCK", 1)
        assert os.lseek(descriptor, 0, os.SEEK_CUR) > 1000  # beyond what is read
        try:
            flock(descriptor, exclusive)
        except BlockingIOError:
            raise PermissionError(13, "Permission denied") from None

    windows = types.SimpleNamespace(LK_NBLCK="LK_NBLCK", locking=locking)
    monkeypatch.setattr(ownership, "fcntl", None)
    monkeypatch.setattr(ownership, "msvcrt", windows, raising=False)
    path = tmp_path / "out.h5"
    for _ in range(2):
        with writing(path):
            assert writer_of(path).startswith(f"process {os.getpid()} on ")
            with pytest.raises(StoreError, match=f"another run .process {os.getpid()} on"), writing(path):
                pass
        assert writer_of(path) is None


def test_of_many_that_want_to_write_at_once_one_does(tmp_path):
    path, inside, most, outcomes = tmp_path / "out.h5", [0], [0], []

    def want():
        try:
            with writing(path):
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                time.sleep(0.01)
                inside[0] -= 1
            outcomes.append("wrote")
        except StoreError:
            outcomes.append("refused")

    threads = [threading.Thread(target=want) for _ in range(40)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1] and len(outcomes) == 40 and "wrote" in outcomes
    assert names(tmp_path) == []


def test_show_tells_a_living_run_from_one_whose_process_has_ended(finished, holder):
    say_running(finished)
    said = call("show", finished)[1].splitlines()[0]
    assert f"running, written by process {holder.pid} on " in said
    assert "t = 0.04 so far with 5 of 5 saved times" in said and "--resume" not in said
    holder.kill()
    holder.wait()
    said = call("show", finished)[1].splitlines()[0]
    assert "cut off (its attribute `status` is still 'running') at t = 0.04 after " in said and "--resume" in said
    assert jaxves.load(finished).word == "cut off"


def remove(path):
    path.unlink()


def replace(path):
    path.with_name("new").write_bytes(b"of someone else")
    path.with_name("new").replace(path)


def move(path):
    path.rename(path.with_name("moved.h5"))


@pytest.mark.parametrize("taken", [remove, replace, move])
@pytest.mark.parametrize("seconds", [0.0, 1e9], ids=["while it runs", "at its end"])
def test_a_run_whose_file_is_taken_away_keeps_its_rows_elsewhere_and_says_so(tmp_path, monkeypatch, taken, seconds):
    path, kept = tmp_path / "out.h5", tmp_path / "out.lost.h5"
    (tmp_path / "scene.toml").write_text(text())
    monkeypatch.setattr(rows, "SECONDS_BETWEEN_WRITES", seconds)
    stepped = Resolution.stepped

    def then_taken(self, state, t_save, say):
        if t_save == 0.02:
            taken(path)
        return stepped(self, state, t_save, say)

    with monkeypatch.context() as patch:
        patch.setattr(Resolution, "stepped", then_taken)
        code, out, err = call("run", tmp_path / "scene.toml", "--out", path)
    assert (code, out) == (3, "")
    assert "\n" not in err and str(path) in err and str(kept) in err
    assert path.exists() == (taken is replace)
    if taken is replace:
        assert path.read_bytes() == b"of someone else"
    assert {".out.h5.lock", "out.h5.part"}.isdisjoint(names(tmp_path))
    # Nothing is lost: the copy goes on to the bits of a run that nobody disturbed.
    assert len(run_store.read_result(kept).t) == (3 if seconds == 0 else 5)
    assert runner.run(scene(), kept, resume=True) == "complete"
    assert runner.run(scene(), tmp_path / "whole.h5") == "complete"
    assert stored(kept) == stored(tmp_path / "whole.h5")


def test_a_lost_run_does_not_overwrite_what_an_earlier_one_saved(tmp_path, monkeypatch):
    path = tmp_path / "out.h5"
    (tmp_path / "out.lost.h5").write_bytes(b"precious")
    with pytest.raises(runner.Broken, match=r"out\.lost1\.h5"):
        runner.run(scene(), path, progress=After(2, path.unlink))
    assert (tmp_path / "out.lost.h5").read_bytes() == b"precious"
    assert len(run_store.read_result(tmp_path / "out.lost1.h5").t) == 5


def test_a_symbolic_link_stays_one_and_its_file_has_one_writer(tmp_path):
    (tmp_path / "there").mkdir()
    real, link = tmp_path / "there" / "real.h5", tmp_path / "link.h5"
    link.symlink_to(real)
    with writing(real), pytest.raises(StoreError, match="being written by another run"):
        runner.run(scene(), link)
    assert runner.run(scene(), link) == "complete"
    assert link.is_symlink() and run_store.read_result(real).status == "complete"
    assert names(tmp_path) == ["link.h5", "there"] and names(tmp_path / "there") == ["real.h5"]


def test_names_with_spaces_and_umlauts_are_names_like_others(tmp_path):
    path = tmp_path / "zwei Bläschen %d.h5"
    with writing(path):
        assert writer_of(path)
        with pytest.raises(StoreError, match="zwei Bläschen %d"):
            runner.run(scene(), path)
    assert runner.run(scene(), path) == "complete"
    assert names(tmp_path) == [path.name]


def test_a_folder_that_cannot_be_written_or_is_none_is_named_in_one_line(tmp_path, monkeypatch):
    with pytest.raises(StoreError, match=r"cannot write .*nowhere/out\.h5: No such file or directory"):
        runner.run(scene(), tmp_path / "nowhere" / "out.h5")

    def denied(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(ownership.os, "open", denied)  # the superuser may write everywhere
    with pytest.raises(StoreError, match=r"cannot write .*out\.h5: Permission denied"):
        runner.run(scene(), tmp_path / "out.h5")


SWEEP = {"scene": tomllib.loads(text(t_end=0.02, saves=2)), "axes": {"field.beta": [0.5, 1.0, 1.5]}}


def test_the_file_of_a_sweep_has_one_writer_and_is_not_overwritten_when_taken_away(tmp_path):
    path = tmp_path / "sweep.h5"

    def at_first_case(done, total, said):
        if said == "cases" and done == 1:
            with pytest.raises(StoreError, match="being written by another run"):
                jaxves.sweep(SWEEP, path, devices=1, batch=1, force=True)
            replace(path)

    with pytest.raises(ownership.LostFile, match=r"sweep\.lost\.h5"):
        jaxves.sweep(SWEEP, path, devices=1, batch=1, progress=at_first_case)
    assert path.read_bytes() == b"of someone else"
    kept = tmp_path / "sweep.lost.h5"
    assert sweep_store.read_sweep(kept).counts() == {"complete": 2, "pending": 1}
    assert "sweep cut off" in call("show", kept)[1]
    with writing(kept):
        assert "sweep running" in call("show", kept)[1]
    assert jaxves.sweep(SWEEP, kept, devices=1, batch=1, resume=True).counts() == {"complete": 3}
    assert names(tmp_path) == ["sweep.h5", "sweep.lost.h5"]


# --- a run goes on to a larger t_end ------------------------------------------------------------

STOP = "[stop]\nsteady = {}\n[numerics]\n"


def extended(t_end=0.08, saves=8, **changes):
    return scene(t_end=t_end, saves=saves, **changes)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The file of a run that had the larger t_end from the start."""
    path = tmp_path_factory.mktemp("whole") / "whole.h5"
    assert runner.run(extended(), path) == "complete"
    return path


def test_an_interrupted_run_is_extended_twice_and_by_one_saved_time(tmp_path, whole):
    path = tmp_path / "out.h5"
    assert runner.run(scene(), path, progress=After(2, interrupt)) == "interrupted"
    longer = extended(t_end=0.05, saves=5)
    assert runner.run(longer, path, resume=True, progress=After(1, interrupt)) == "interrupted"
    assert len(run_store.read_result(path).t) == 4
    assert runner.run(longer, path, resume=True) == "complete"
    assert len(run_store.read_result(path).t) == 6
    assert runner.run(extended(), path, resume=True) == "complete"
    assert stored(path) == stored(whole)


def test_what_was_found_at_the_end_is_found_anew(tmp_path):
    """Averages, certificate and error belong to the whole run, and to no part of it when that is interrupted."""

    def longer(t_end, saves):
        words = text(t_end=t_end, saves=saves).replace("certify = false\n", "")
        return parse(tomllib.loads("average = [0.01, 0.035]\n" + words))

    path = tmp_path / "out.h5"
    runner.run(longer(0.04, 4), path)
    first = run_store.read_result(path)
    assert first.averages and first.attributes["error"] > 0
    assert runner.run(longer(0.08, 8), path, resume=True, progress=After(1, interrupt)) == "interrupted"
    assert "error" not in run_store.read_result(path).attributes
    runner.run(longer(0.08, 8), path, resume=True)
    runner.run(longer(0.08, 8), tmp_path / "whole.h5")
    again, straight = run_store.read_result(path), run_store.read_result(tmp_path / "whole.h5")
    assert again.attributes["error"] == straight.attributes["error"]
    assert stored(path) == stored(tmp_path / "whole.h5")


def test_a_run_that_met_its_stop_condition_is_not_extended(tmp_path):
    def stopping(**changes):
        return text(**changes).replace("[numerics]\n", STOP.format(1e6))

    (tmp_path / "short.toml").write_text(stopping())
    (tmp_path / "long.toml").write_text(stopping(t_end=0.08, saves=8))
    out = tmp_path / "out.h5"
    assert call("run", tmp_path / "short.toml", "--out", out)[0] == 0
    before = out.read_bytes()
    code, said, _ = call("run", tmp_path / "long.toml", "--out", out, "--resume")
    assert code == 0 and "is done (steady): there is nothing to resume. Its stop condition is met; --from" in said
    assert out.read_bytes() == before


# --- a run starts where another one ended --------------------------------------------------------

FINE = "[numerics]\nnodes = {nodes}\ntolerance = 1e-6\ncertify = false\n"


def other(t_end=0.04, saves=4, nodes=32, beta=1.0, table="", shape="angle = 90.0\n"):
    words = text(t_end=t_end, saves=saves, beta=beta).split("[numerics]")[0].replace("angle = 90.0\n", shape)
    if beta is None:
        words = words.split("[field]")[0]
    return parse(tomllib.loads(words + table + FINE.format(nodes=nodes)))


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """The file of a run to t = 0.08; its vesicle is stretched by a field, and its membrane is charged."""
    path = tmp_path_factory.mktemp("earlier") / "a.h5"
    assert runner.run(other(0.08, 8), path) == "complete"
    return path


def test_a_run_that_starts_where_another_was_goes_the_same_way(earlier, tmp_path):
    """Within the tolerance of the steps: a start without V_m would be far off."""
    path = tmp_path / "b.h5"
    assert runner.run(other(shape="angle = 17.0\ncenter = [3.0, 1.0]\n"), path, start=earlier, at=0.041) == "complete"
    a, b = run_store.read_result(earlier), run_store.read_result(path)
    np.testing.assert_allclose(b.t, [0, 0.01, 0.02, 0.03, 0.04], atol=1e-15)
    np.testing.assert_allclose(b.x[0], a.x[4], atol=1e-12)
    np.testing.assert_allclose(b.V_m[0], a.V_m[4], atol=1e-12)
    assert np.max(np.abs(a.V_m[4])) > 1e-2
    np.testing.assert_allclose(b.x, a.x[4:], atol=1e-4)
    np.testing.assert_allclose(b.V_m, a.V_m[4:], atol=1e-4)
    assert b.attributes["started_from"] == f"{earlier} at t = 0.04"
    assert f"started from {earlier} at t = 0.04" in call("show", path)[1]


def test_it_is_resumed_to_the_last_bit_without_the_file_it_started_from(earlier, tmp_path):
    gone = tmp_path / "gone.h5"
    gone.write_bytes(earlier.read_bytes())
    assert runner.run(other(), tmp_path / "whole.h5", start=gone) == "complete"
    assert runner.run(other(), tmp_path / "parts.h5", start=gone, progress=After(2, interrupt)) == "interrupted"
    gone.unlink()
    assert runner.run(other(), tmp_path / "parts.h5", resume=True) == "complete"
    assert stored(tmp_path / "parts.h5") == stored(tmp_path / "whole.h5")


@pytest.mark.parametrize(("nodes", "expected"), [(24, 24), (48, 48), ('"auto"', 64)])
def test_another_number_of_nodes_describes_the_same_curve(earlier, nodes, expected):
    scene_file, record = other(nodes=nodes), run_store.read_result(earlier)
    start, _ = started_from(earlier, None, scene_file)
    assert start.x.shape == (1, expected, 2) and start.V_m.shape == (1, expected)
    # A point of the new curve lies on the old one, with the potential that is there.
    both = jnp.asarray(np.concatenate([record.x[-1], record.V_m[-1][..., None]], -1))
    fine = np.asarray(fourier.resample(both, 4096, axis=1)[0])
    apart = np.linalg.norm(fine[:, None, :2] - start.x[0][None], axis=-1)
    assert np.max(np.min(apart, axis=0)) < 2e-3
    np.testing.assert_allclose(fine[np.argmin(apart, axis=0), 2], start.V_m[0], atol=5e-3)


def test_a_membrane_potential_is_taken_over_where_both_have_a_field(earlier, tmp_path):
    without = other(0.02, 2, beta=None)
    assert runner.run(without, tmp_path / "none.h5", start=earlier) == "complete"
    assert run_store.read_result(tmp_path / "none.h5").V_m is None
    start, _ = started_from(tmp_path / "none.h5", None, other())
    assert start.V_m is None and start.field is not None


def test_what_cannot_be_started_from_is_refused_in_one_line(earlier, tmp_path):
    scenes = tmp_path / "scene.toml"
    scenes.write_text(text())
    (tmp_path / "text.h5").write_text("no")
    pair = parse(tomllib.loads(text().replace("[field]", "[pair]\nseparation = 4.0\n[field]")))
    out = tmp_path / "out.h5"
    with pytest.raises(StoreError, match=r"a\.h5 holds 1 vesicles, but the scene has 2"):
        runner.run(pair, out, start=earlier)
    for arguments, words in (
        (["--from", tmp_path / "none.h5"], "none.h5 does not exist"),
        (["--from", tmp_path / "text.h5"], "text.h5 is not a jaxves result file"),
        (["--from", earlier, "--at", 0.09], "at = 0.09, expected a time in [0, 0.08]"),
        (["--from", earlier, "--at", "nan"], "at = nan, expected a time in [0, 0.08]"),
        (["--at", 0.01], "--at = 0.01, expected --from"),
        (["--from", earlier, "--resume"], "--from is for a new run"),
    ):
        code, said, err = call("run", scenes, "--out", out, *arguments)
        assert (code, said) == (2, "") and words in err and "\n" not in err
    for how in ({"at": 0.01}, {"start": earlier, "resume": True}):
        with pytest.raises(ValueError, match="expected no"):
            runner.run(scene(), out, **how)
    assert names(tmp_path) == ["scene.toml", "text.h5"]
