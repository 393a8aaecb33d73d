"""Compiled programs on disk: a later process neither traces nor compiles what an earlier one has compiled.

JAX's compilation cache saves compiling but not tracing, which is half of what is left. A program is therefore stored as
a whole, in the folder `programs` inside the folder of JAX's cache. Without that folder nothing is stored. The name of a
file is a hash of everything that determines the program: the source code of this package, the versions of the packages
that it uses, the machine, the compiler options, and the structure of the arguments.
"""

import contextlib
import functools
import hashlib
import io
import math
import os
import pickle
import platform
import tempfile
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jax.experimental import serialize_executable

_PACKAGES = ("jax", "jaxlib", "equinox", "lineax", "optimistix", "numpy")


def is_traced(leaf: Any) -> bool:
    """Returns whether a part of the arguments is an array. Everything else is a constant of the program."""
    return isinstance(leaf, jax.Array | np.ndarray | np.generic)


class Kind(NamedTuple):
    """What a program must know of an array."""

    shape: str
    dtype: str
    weak: bool

    @classmethod
    def of(cls, leaf) -> "Kind":
        return cls(str(leaf.shape), str(leaf.dtype), bool(getattr(leaf, "weak_type", False)))


class Program(NamedTuple):
    """A compiled function from arrays to arrays, and the structure of its result (numbers in place of arrays)."""

    call: Callable[..., list]
    arrays: Any
    others: Any

    def result(self, leaves: list) -> Any:
        """Runs the program."""
        treedef = jax.tree.structure(self.arrays)
        return eqx.combine(jax.tree.unflatten(treedef, self.call(*leaves)), self.others)


def program(function: Callable, options: dict[str, int], arguments: tuple) -> Program:
    """Returns the program of `function` for arguments of this structure: read from its file, or compiled and stored.

    `arguments` are the positional arguments and those by name.
    """
    path = _path(function, options, arguments)
    found = None if path is None else _read(path, arguments)
    return _compiled(function, options, arguments, path) if found is None else found


def _compiled(function: Callable, options: dict[str, int], arguments: tuple, path: Path | None) -> Program:
    dynamic, static = eqx.partition(arguments, is_traced)
    leaves, treedef = jax.tree.flatten(dynamic)
    structure = []

    def flat(*leaves):
        positional, named = eqx.combine(jax.tree.unflatten(treedef, leaves), static)
        arrays, others = eqx.partition(function(*positional, **named), is_traced)
        out, out_tree = jax.tree.flatten(arrays)
        structure.append((jax.tree.unflatten(out_tree, range(len(out))), others))
        return out

    lowered = jax.jit(flat).lower(*leaves)
    with _not_in_the_cache_of_jax():
        call = lowered.compile(compiler_options=options or None)
    made = Program(call, *structure[-1])
    if path is not None:
        _write(path, made)
    return made


@contextlib.contextmanager
def _not_in_the_cache_of_jax() -> Iterator[None]:
    """Keeps programs out of JAX's cache: one that comes from there lacks functions when it is serialised."""
    name = "jax_persistent_cache_min_compile_time_secs"
    before = getattr(jax.config, name)
    jax.config.update(name, math.inf)
    try:
        yield
    finally:
        jax.config.update(name, before)


def _write(path: Path, made: Program) -> None:
    """Stores a program. If it cannot be stored nothing happens, because results do not depend on it."""
    try:
        payload, _, _ = serialize_executable.serialize(made.call)
        content = pickle.dumps((payload, made.arrays, made.others))
        path.parent.mkdir(parents=True, exist_ok=True)
        # The file appears as a whole: another process may read it at any time.
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            part = Path(folder) / path.name
            part.write_bytes(hashlib.sha256(content).digest() + content)
            os.replace(part, path)
    except (OSError, ValueError, TypeError, AttributeError, pickle.PicklingError, jax.errors.JaxRuntimeError):
        return


def _read(path: Path, arguments: tuple) -> Program | None:
    """Returns the program in a file, None if there is none or it is damaged."""
    try:
        stored = path.read_bytes()
        digest, content = stored[:32], stored[32:]
        if hashlib.sha256(content).digest() != digest:
            return None
        payload, arrays, others = pickle.loads(content)
        leaves = jax.tree.leaves(eqx.filter(arguments, is_traced))
        trees = jax.tree.structure((tuple(leaves), {})), jax.tree.structure(jax.tree.leaves(arrays))
        _load_lapack()
        # The program is for one device. JAX would load it for all that there are.
        call = serialize_executable.deserialize_and_load(payload, *trees, execution_devices=jax.devices()[:1])
        return Program(call, arrays, others)
    except (OSError, ValueError, TypeError, AttributeError, pickle.UnpicklingError, jax.errors.JaxRuntimeError):
        return None


@functools.cache
def _load_lapack() -> None:
    """Makes LAPACK known to XLA, which JAX does when it lowers a factorisation. Without it a read program crashes."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((1, 1), float))


def _path(function: Callable, options: dict[str, int], arguments: tuple) -> Path | None:
    """Returns the file of a program, None if programs are not kept."""
    folder = jax.config.jax_compilation_cache_dir
    if folder is None:
        return None
    described = jax.tree.map(lambda leaf: Kind.of(leaf) if is_traced(leaf) else leaf, arguments)
    parts = (function.__module__, function.__qualname__, sorted(options.items()), described, _environment())
    content = io.BytesIO()
    pickler = pickle.Pickler(content)
    pickler.fast = True  # equal values then have equal bytes, also if parts of them are the same object
    try:
        pickler.dump(parts)
    except (TypeError, AttributeError, pickle.PicklingError):  # an argument that exists only in this process
        return None
    return Path(folder) / "programs" / hashlib.sha256(content.getvalue()).hexdigest()


@functools.cache
def _environment() -> tuple:
    """Everything outside the arguments that determines a program."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(file.read_bytes())
    versions = tuple(version(name) for name in _PACKAGES)
    device = jax.devices()[0]
    flags = os.environ.get("XLA_FLAGS", ""), jax.config.jax_enable_x64, jax.config.jax_default_matmul_precision
    return digest.hexdigest(), versions, device.platform, device.device_kind, len(jax.devices()), _processor(), flags


def _processor() -> str:
    """Returns the processor and its instruction set, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    return "".join(sorted({line for line in lines if line.startswith(("model name", "flags", "Features"))}))
