"""Where the output goes does not change how a command ends; nor does it matter where compiled programs can be kept."""

import gzip
import io
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import platformdirs
import pytest

from jaxves.__main__ import main
from jaxves.base.compiling import fast_start

OLD = Path(__file__).parent / "data" / "version-1-complete.h5.gz"
QUANTITIES = {"a": 1e-5, "E": 1e5, "sigma-i": 1e-4, "sigma-e": 1e-3, "epsilon": 7e-10, "C-m": 1e-2, "kappa-B": 1e-19}
UNITS = [text for name, value in (QUANTITIES | {"mu": 1e-3}).items() for text in (f"--{name}", str(value))]
COMMANDS = ("run", "sweep", "show", "plot", "check-grad", "scenes", "init", "units")
PAGES = [["--help"], *([name, "--help"] for name in COMMANDS)]
SWEEP = "[scene]\nt_end = 1.0\n[[scene.vesicle]]\nreduced_area = 0.9\n[axes]\n'vesicle.größe' = [1.0]\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Files with names that few encodings have."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "größe κ.h5").write_bytes(gzip.decompress(OLD.read_bytes()))
    (tmp_path / "größe κ.toml").write_text("größe = 1.0\n", encoding="utf-8")
    (tmp_path / "sweep κ.toml").write_text(SWEEP, encoding="utf-8")
    return tmp_path


@pytest.fixture
def said(monkeypatch):
    """A function (arguments, encoding) -> exit status, standard output and standard error, as bytes."""

    def said(arguments, encoding):
        streams = [io.BytesIO(), io.BytesIO()]
        for name, errors, stream in zip(("stdout", "stderr"), ("strict", "backslashreplace"), streams, strict=True):
            monkeypatch.setattr(sys, name, io.TextIOWrapper(stream, encoding, errors))
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        sys.stdout.flush()
        sys.stderr.flush()
        return ended.value.code, *(stream.getvalue() for stream in streams)

    handlers = {signum: signal.getsignal(signum) for signum in (signal.SIGINT, signal.SIGTERM)}
    yield said
    for signum, handler in handlers.items():
        signal.signal(signum, handler)


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1", "cp437", "utf-8"])
@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        *((page, 0) for page in PAGES),
        (["scenes"], 0),
        (["units", *UNITS], 0),
        (["show", "größe κ.h5"], 0),
        (["plot", "größe κ.h5", "--what", "history", "--out", "κ"], 0),
        (["init", "neu κ.toml"], 0),
        (["run", "größe κ.toml", "--out", "x.h5"], 2),
        (["run", "κ", "--out", "x.h5"], 2),
        (["run", "pop", "--out", "größe κ.h5"], 2),
        (["sweep", "sweep κ.toml", "--out", "x.h5"], 2),
        (["plot", "größe κ.h5", "--what", "κ"], 2),
        (["show", "keine κ.h5"], 2),
        (["κ"], 2),
    ],
)
def test_every_command_ends_with_the_status_of_its_work_in_any_encoding(folder, said, arguments, code, encoding):
    found, out, err = said(arguments, encoding)
    assert found == code
    assert (out != b"", err != b"") == (code == 0, code == 2)
    if encoding == "utf-8" and code == 0 and arguments[-1] != "--help":
        assert any(letter in out.decode() for letter in "κ·ö") or arguments == ["scenes"]
    assert "Traceback" not in err.decode(encoding)


def command(*arguments, **how):
    return subprocess.run(
        [sys.executable, "-m", "jaxves", *arguments], stderr=subprocess.PIPE, text=True, check=False, **how
    )


def test_a_reader_that_goes_away_changes_nothing(folder):
    read, write = os.pipe()
    os.close(read)
    try:
        done = command("show", "größe κ.h5", stdout=write)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a disk that is always full")
def test_output_that_finds_no_room_is_told_in_one_line(folder):
    with open("/dev/full", "w") as full:
        done = command("show", "größe κ.h5", stdout=full)
    assert done.returncode == 3
    assert done.stderr == "jaxves: [Errno 28] No space left on device\n"


@pytest.mark.parametrize("arguments", [["run", "pop", "--out", "x.h5"], ["check-grad", "pop"]])
def test_single_precision_is_refused_in_one_line(tmp_path, arguments):
    done = command(*arguments, cwd=tmp_path, env=os.environ | {"JAX_ENABLE_X64": "0"})
    assert done.returncode == 2 and not list(tmp_path.iterdir())
    assert done.stderr == (
        "jaxves: JAX_ENABLE_X64 = 0, expected 1, or no such variable: jaxves needs double precision.\n"
    )


# --- where compiled programs are kept -----------------------------------------------------------


@pytest.fixture
def kept(monkeypatch):
    """A function that returns the folder which JAX is told, None for none."""

    def kept():
        fast_start()
        return jax.config.jax_compilation_cache_dir

    before = jax.config.jax_compilation_cache_dir, jax.config.jax_persistent_cache_min_compile_time_secs
    jax.config.update("jax_compilation_cache_dir", None)
    yield kept
    jax.config.update("jax_compilation_cache_dir", before[0])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", before[1])


def test_programs_are_kept_in_the_users_cache_folder(kept, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "größe" / "cache"))
    folder = Path(kept())
    assert folder.is_dir() and list(folder.iterdir()) == []
    if sys.platform == "linux":
        assert folder.parent == tmp_path / "größe" / "cache" / "jaxves"


def test_without_xdg_it_is_that_of_the_home(kept, monkeypatch, tmp_path):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    if sys.platform == "linux":
        assert Path(kept()).parent == tmp_path / ".cache" / "jaxves"


def test_a_folder_that_is_named_already_is_taken(kept, tmp_path):
    jax.config.update("jax_compilation_cache_dir", str(tmp_path / "mine"))
    assert kept() == str(tmp_path / "mine")


@pytest.mark.parametrize("home", ["/dev/null", "/proc"])
def test_where_no_folder_can_be_made_nothing_is_kept_nor_left(kept, monkeypatch, tmp_path, home):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", home)
    assert kept() is None
    assert list(tmp_path.iterdir()) == []


def test_where_the_home_is_not_known_nothing_is_kept_nor_left(kept, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda *given, **how: Path("~/.cache/jaxves"))
    assert kept() is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("error", [28, 30, 13, 122])  # no space, read-only, no permission, over quota
def test_on_a_disk_that_takes_nothing_nothing_is_kept(kept, monkeypatch, tmp_path, error):
    def refused(**how):
        raise OSError(error, os.strerror(error))

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(tempfile, "TemporaryFile", refused)
    assert kept() is None


COMPILED = """
import jax
from jaxves import fast_start

fast_start()
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
print(jax.jit(lambda x: 2 * x)(21))
"""


@pytest.mark.parametrize("cache", ["/dev/null/cache", "/proc/cache", "file"])
def test_a_named_folder_that_cannot_be_written_gives_no_warning(tmp_path, cache):
    (tmp_path / "file").write_text("")
    env = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / cache)}
    done = subprocess.run([sys.executable, "-c", COMPILED], capture_output=True, text=True, check=False, env=env)
    assert (done.returncode, done.stdout, done.stderr) == (0, "42\n", "")
