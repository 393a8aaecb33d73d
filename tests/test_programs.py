"""Programs that runs compile: quickly or optimised, and kept on disk for later processes."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.base.compiling import FOR_LONG_RUNS, FOR_SHORT_RUNS, flags, use_flags
from jaxves.runs import kept_programs
from jaxves.runs.programs import compiled, is_long

# A factorisation, a static argument, a result that is not an array, and how many programs were compiled for it.
SCRIPT = """
import jax, numpy as np
import jaxves
from jaxves.runs.programs import compiled

names = []
jax.monitoring.register_event_duration_secs_listener(
    lambda name, seconds, **about: names.append((name, str(about.get("fun_name", "")))))

def solved(A, b, *, kind):
    return {kind: jax.numpy.linalg.solve(A @ A.T, b), "L": jax.numpy.linalg.cholesky(A @ A.T)}, kind

A = np.array([[2.0, 1.0], [0.5, 3.0]])
found, kind = compiled(solved)(A, np.array([1.0, 2.0]), kind="x")
made = sum("backend_compile" in name and "flat" in about for name, about in names)
print(found["x"].tobytes().hex(), found["L"].tobytes().hex(), kind, made)
"""


def process(folder, devices=1):
    flags = f"--xla_force_host_platform_device_count={devices}"
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(folder), "XLA_FLAGS": flags}
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    *values, kind, made = done.stdout.split()
    return values, kind, int(made)


@pytest.mark.parametrize("devices", [1, 2])
def test_a_second_process_does_not_compile_and_finds_the_same_bits_also_beside_a_damaged_file(tmp_path, devices):
    first, second = process(tmp_path, devices), process(tmp_path, devices)
    assert (first[1:], second[1:]) == (("x", 1), ("x", 0))
    assert first[0] == second[0]
    (file,) = (tmp_path / "programs").iterdir()
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    third = process(tmp_path, devices)
    assert third == first


@pytest.fixture
def folder(tmp_path):
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def scaled(x, factor):
    return factor * x


def test_everything_that_determines_a_program_is_in_the_name_of_its_file(folder, monkeypatch):
    x, options = np.ones(3), FOR_SHORT_RUNS

    def name(function=scaled, options=options, arguments=((x, 2.0), {})):
        return kept_programs._path(function, options, arguments)

    same = "".join(["fac", "tor"])
    names = [
        name(),
        name(options=FOR_LONG_RUNS | {"other": 1}),
        name(arguments=((np.ones(4), 2.0), {})),
        name(arguments=((np.ones(3, np.float32), 2.0), {})),
        name(arguments=((x, 3.0), {})),
        name(arguments=((x,), {"factor": 2.0})),
        name(function=process),
    ]
    monkeypatch.setattr(kept_programs, "_environment", lambda: "another version")
    names.append(name())
    assert len(set(names)) == len(names)
    assert name(arguments=((x, "factor", same), {})) == name(arguments=((x, "factor", "factor"), {}))


def test_without_a_folder_or_with_arguments_of_this_process_only_nothing_is_stored(folder):
    assert kept_programs._path(scaled, {}, ((lambda x: x,), {})) is None
    jax.config.update("jax_compilation_cache_dir", None)
    assert kept_programs._path(scaled, {}, ((np.ones(3),), {})) is None
    np.testing.assert_array_equal(compiled(scaled)(jnp.arange(3.0), 2.0), [0.0, 2.0, 4.0])


def test_whether_a_run_is_long_depends_on_its_steps_and_nodes():
    assert not is_long(0, 64) and is_long(5000, 64)
    assert is_long(0, 64 * 128)


def test_flags_that_the_user_has_set_are_kept(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_use_fusion_emitters=true --other=1")
    use_flags()
    assert os.environ["XLA_FLAGS"] == "--xla_cpu_use_fusion_emitters=true --other=1"
    monkeypatch.setenv("XLA_FLAGS", "")
    use_flags(FOR_SHORT_RUNS)
    assert os.environ["XLA_FLAGS"] == flags(FOR_SHORT_RUNS)
    assert "--xla_backend_optimization_level=0" in flags(FOR_SHORT_RUNS)
