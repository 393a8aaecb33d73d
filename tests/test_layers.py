"""The folders of the package are layers: imports go one way, and input and files are handled without JAX.

Files and functions are short, and no file uses a private name of another one.
"""

import ast
import shutil
import statistics
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


def contracts(folder: Path) -> subprocess.CompletedProcess:
    command = [sys.executable, "-c", "from importlinter.cli import lint_imports_command as main; main()"]
    return subprocess.run([*command, "--no-cache"], cwd=folder, capture_output=True, text=True, timeout=300)


def test_imports_go_one_way():
    found = contracts(ROOT)
    assert found.returncode == 0 and "0 broken" in found.stdout, found.stdout + found.stderr


@pytest.mark.parametrize(
    ("file", "turned", "broken"),
    [
        ("numerics/fourier.py", "from ..equation import equation", "folders below"),
        ("geometry/curve.py", "from .shapes import circle", "each other"),
        ("results/hdf5.py", "import jax", "without JAX"),
        ("inputs/uses.py", "from ..numerics import arrays", "without JAX"),
    ],
)
def test_an_arrow_that_is_turned_is_found(file, turned, broken, tmp_path):
    shutil.copytree(ROOT / "jaxves", tmp_path / "jaxves", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    path = tmp_path / "jaxves" / file
    path.write_text(path.read_text(encoding="utf-8") + f"\n{turned}\n", encoding="utf-8")
    found = contracts(tmp_path)
    lines = [line for line in " ".join(found.stdout.split()).split("BROKEN")]
    assert found.returncode == 1 and any(broken in line[-120:] for line in lines[:-1]), found.stdout + found.stderr


def sources() -> dict[Path, str]:
    return {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in ROOT.glob("jaxves/**/*.py")}


def test_no_file_is_longer_than_can_be_read_at_once():
    lengths = {path: len(text.splitlines()) for path, text in sources().items()}
    assert {path: length for path, length in lengths.items() if length > 300} == {}
    assert statistics.median(lengths.values()) <= 120


def test_no_function_is_longer_than_a_screen():
    """With its docstring."""
    long = []
    for path, text in sources().items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and node.end_lineno - node.lineno + 1 > 60:
                long.append(f"{path}:{node.lineno} {node.name}")
    assert long == []


def test_no_file_imports_a_private_name_of_another():
    found = []
    for path, text in sources().items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and node.level:
                private = [name.name for name in node.names if name.name.startswith("_") and name.name != "__version__"]
                found += [f"{path}:{node.lineno} {name}" for name in private]
    assert found == []
