"""Shapes that many tests loop over, and the exact solutions on a circle."""

import ctypes
import os
import sys

from experiments._compiling import QUICKLY

# Small LAPACK calls and small products are slower on two threads than on one, the more so beside other tests; set
# before NumPy loads and JAX starts.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("XLA_FLAGS", f"--xla_cpu_multi_thread_eigen=false {QUICKLY}")

import h5py
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.experimental.compilation_cache import compilation_cache

import jaxves  # noqa: F401  (switches double precision on)
from jaxves.equation.equation import equation_for
from jaxves.numerics import fourier
from jaxves.observables import diagnostics
from jaxves.runs import programs

_COMPILED = jax.config.jax_compilation_cache_dir


@pytest.fixture(autouse=True, scope="module")
def _forget_what_was_compiled():
    """Programs of one file are of no use to the next, and together they would fill the memory."""
    yield
    jax.clear_caches()
    programs.forget()
    if jax.config.jax_compilation_cache_dir != _COMPILED:
        # Commands keep on disk what they compile; the tests of other files would go on writing there.
        jax.config.update("jax_compilation_cache_dir", _COMPILED)
        compilation_cache.reset_cache()
    if sys.platform == "linux":
        # The C library would keep what was freed for later: two GB after a file, instead of a third of one.
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(0)


def circle(N, radius=1.0):
    alpha = fourier.grid(N)
    return radius * jnp.stack([jnp.cos(alpha), jnp.sin(alpha)], axis=-1)


def ellipse(N, a=1.4, b=0.7):
    """In its own angle: nodes not equispaced in arc length."""
    alpha = fourier.grid(N)
    return jnp.stack([a * jnp.cos(alpha), b * jnp.sin(alpha)], axis=-1)


def star(N):
    alpha = fourier.grid(N)
    return (1 + 0.2 * jnp.cos(3 * alpha))[:, None] * jnp.stack([jnp.cos(alpha), jnp.sin(alpha)], axis=-1)


@pytest.fixture(params=[ellipse, star], ids=["ellipse", "star"])
def shape(request):
    """A function N -> nodes (N, 2)."""
    return request.param


def stored(path):
    """Every dataset of a result file but the state to continue from, as bytes."""
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset) and not name.startswith("restart"):
            found[name] = (item.shape, item[()].tobytes() if item.dtype != object else list(np.ravel(item[()])))

    with h5py.File(path) as file:
        file.visititems(visit)
    return found


class Stops:
    """Ctrl-C after so many saved times, as progress is shown."""

    def __init__(self, rows):
        self.rows = rows

    def __call__(self, t, t_end, text):
        self.rows -= text.endswith("steps")
        if self.rows == 0:
            raise KeyboardInterrupt


@jax.jit
def motion_of(scene, y):
    """What holds at t = 0 in the state y of a scene."""
    return equation_for(scene).motion(jnp.zeros(()), y)


@jax.jit
def diagnosed(scene, y):
    """The diagnostics of the state y of a scene at t = 0."""
    equation = equation_for(scene)
    return diagnostics.diagnose(equation, jnp.zeros(()), y, equation.motion(jnp.zeros(()), y))


def observed_order(sizes, errors):
    """Slope of log(error) against log(size)."""
    return np.polyfit(np.log(np.asarray(sizes)), np.log(np.asarray(errors)), 1)[0]


def of_equal_cells(in_cell, lattice, x):
    """What `in_cell(lattice, x)` gives without overflow: as asked, with another basis, and with a vesicle moved.

    The other pair of vectors spans the same lattice, and the vesicle is moved by a vector of the lattice.
    """
    compiled = jax.jit(in_cell)
    wanted, overflow = compiled(lattice, x)
    sheared, more = compiled(np.array([lattice[0], lattice[1] - lattice[0]]), x)
    moved, most = compiled(lattice, x.at[2].add(lattice[0] - 2 * lattice[1]))
    assert not (overflow or more or most)
    return wanted, sheared, moved


@pytest.fixture
def calls_of(monkeypatch):
    """A function (module, name) -> list that grows with every call of that function; inside a program, every trace."""

    def counted(module, name):
        calls, function = [], getattr(module, name)
        monkeypatch.setattr(module, name, lambda *arguments: calls.append(arguments) or function(*arguments))
        return calls

    return counted
