"""Compiles the functions of runs, quickly for short runs and with all optimisations for long ones.

The result of a program may depend on its compiler options in the last bits. Which options are used therefore depends
only on the state of a run. A run that was interrupted is then continued with the same bits.
"""

import functools
from collections.abc import Callable

import jax

from ..base.compiling import options_for
from .kept_programs import is_traced, program

# A step with 64 nodes saves about a millisecond in an optimised program, which takes five seconds longer to compile.
_MANY_STEPS = 5000
_FEW_NODES = 64


def is_long(steps: int, nodes: int) -> bool:
    """Returns whether a run that has made `steps` steps with this many nodes in all is worth optimising.

    The work of a step grows at least with the square of the number of nodes. A run of 4000 nodes is long before its
    first step.
    """
    return (steps + 1) * (nodes / _FEW_NODES) ** 2 > _MANY_STEPS


def compiled(function: Callable, *, quickly: bool = True) -> Callable:
    """Returns `function`, compiled when it is called. On a CPU it is compiled `quickly`, or with all optimisations.

    Arguments that are not arrays are static. The function cannot be used inside other compiled functions.
    """
    return _of(function, tuple(options_for(jax.default_backend(), quickly=quickly).items()))


@functools.cache
def _of(function: Callable, options: tuple[tuple[str, int], ...]) -> Callable:
    programs: dict = {}

    @functools.wraps(function)
    def call(*positional, **named):
        arguments = positional, named
        leaves, treedef = jax.tree.flatten(arguments)
        key = treedef, tuple(_kind(leaf) if is_traced(leaf) else leaf for leaf in leaves)
        if key not in programs:
            programs[key] = program(function, dict(options), arguments)
        return programs[key].result([leaf for leaf in leaves if is_traced(leaf)])

    return call


def _kind(leaf) -> tuple:
    """Returns what a program must know of an array. A file needs it in words (`Kind`), which take longer to make."""
    return leaf.shape, leaf.dtype, getattr(leaf, "weak_type", False)


def forget() -> None:
    """Frees the programs of this process. Those on disk remain."""
    _of.cache_clear()
