"""What pyproject.toml asks for is what the code uses, and what is too old or has moved is named in one line."""

import ast
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jax
import pytest

import jaxves
from jaxves.base import jax_parts
from jaxves.sweeps import processes

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
DECLARED = {"jaxves": PROJECT["dependencies"], "dev": PROJECT["optional-dependencies"]["dev"]}
OTHERS = [one for name, extra in PROJECT["optional-dependencies"].items() if name != "dev" for one in extra]
# Modules with another name than the distribution; `pydantic` requires exactly one release of `pydantic-core`.
INSTALLED_BY = {"pydantic_core": "pydantic", "PIL": "pillow"}
# JAX and xarray load these, and the tests run these.
NOT_IMPORTED = {
    *("jaxlib", "h5netcdf", "netCDF4", "beartype", "ipykernel", "pytest-xdist", "ruff", "import-linter"),
    *("furo", "myst-nb", "sphinx-copybutton"),
}


def names(requirements):
    return {re.match(r"[\w-]+", requirement)[0] for requirement in requirements}


def imported(*folders):
    """The names of the distributions that the modules in these folders import, other than Python's own and ours."""
    found = set()
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module.partition(".")[0])
    ours = {"jaxves", "experiments", "tests"} | {p.stem for of in ("tests", "docs") for p in (ROOT / of).glob("*.py")}
    return {INSTALLED_BY.get(name, name).replace("_", "-") for name in found - ours - sys.stdlib_module_names}


def test_the_package_imports_what_it_requires_and_nothing_else():
    required = names(DECLARED["jaxves"])
    optional = names(PROJECT["optional-dependencies"]["xarray"] + PROJECT["optional-dependencies"]["vtk"])
    assert imported("jaxves") <= required | optional
    assert required - imported("jaxves") <= NOT_IMPORTED


def test_tests_and_experiments_import_what_the_dev_extra_requires_and_nothing_else():
    required = names(DECLARED["jaxves"]) | names(DECLARED["dev"])
    used = imported("tests", "experiments", "docs")
    assert used <= required
    assert names(DECLARED["dev"]) - used <= NOT_IMPORTED


def test_the_dev_extra_has_all_others():
    assert set(OTHERS) <= set(DECLARED["dev"])


def test_every_requirement_has_a_lower_bound_and_no_other():
    for requirement in DECLARED["jaxves"] + DECLARED["dev"] + OTHERS:
        assert re.fullmatch(r"[\w-]+>=[\d.]+", requirement), requirement


def imported_beside(folder, version):
    """What a process says that imports jaxves while the metadata found first tell of this release of JAX."""
    metadata = folder / f"jax-{version}.dist-info" / "METADATA"
    metadata.parent.mkdir()
    metadata.write_text(f"Metadata-Version: 2.1\nName: jax\nVersion: {version}\n")
    environment = os.environ | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    command = [sys.executable, "-c", "import jaxves"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("version", ["0.6.0", "0.9.2", "0.9.0.1"])
def test_an_older_jax_is_refused_on_import_in_one_line(tmp_path, version):
    (needed,) = (name.partition(">=")[2] for name in DECLARED["jaxves"] if name.startswith("jax>="))
    done = imported_beside(tmp_path, version)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        f"ImportError: jaxves needs jax >= {needed}, found {version}: python -m pip install --upgrade jax jaxlib"
    )


@pytest.mark.parametrize("version", [jaxves._OLDEST_JAX, "0.10.0.dev20260401", "0.11.1", "1.0.0"])
def test_the_oldest_jax_and_newer_ones_are_taken(tmp_path, version):
    assert imported_beside(tmp_path, version).returncode == 0


def test_a_barrier_that_has_moved_in_jax_is_named_by_processes_that_need_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "jax._src.distributed", None)
    processes.wait("alone")
    monkeypatch.setattr(jax, "process_count", lambda: 2)
    with pytest.raises(RuntimeError, match=r"jax._src.distributed.*use one process") as refusal:
        processes.wait("together")
    assert jax.__version__ in str(refusal.value) and "\n" not in str(refusal.value)


def test_parts_of_jax_that_are_not_public_are_used_in_one_file():
    private = re.compile(r"\bjax\._src\b|\bjax\.core\b|\bjax\.interpreters\b|\bjax\.extend\b|\bjaxlib\._[a-z]")
    files = {path.name for path in (ROOT / "jaxves").rglob("*.py") if private.search(path.read_text(encoding="utf-8"))}
    assert files == {"jax_parts.py"}


def test_a_jax_without_the_class_of_traced_values_is_named_in_one_line(monkeypatch):
    monkeypatch.setattr(jax, "core", None)
    with pytest.raises(ImportError, match=r"lacks jax\.core\.Tracer .*pip install jax==") as refusal:
        jax_parts.tracer_type()
    assert "\n" not in str(refusal.value)
