"""Computes many cases with one compiled program on the devices of this process, in batches.

Each call gives every device `batch` cases. A CPU computes them one after the other (`lax.map`): the matrices of one
case already fill the caches, so batching would not be faster, and a slow case delays only the other cases of its batch.
A GPU computes them together (`vmap`), as many as fit into its memory.

The result of a case does not depend on its batch.
"""

import dataclasses
import functools
import math
import os
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Float

from ..base.compiling import options_for
from ..inputs.checking import SceneError
from ..inputs.scene_tables import SceneFile
from ..inputs.sweep_tables import SweepFile
from ..inputs.uses import SWEEP, for_use
from ..runs import problem
from ..runs.build import scene_of
from ..runs.case import Case
from ..stepping.adaptive import Adaptive
from .case_summary import outcome

METHODS = ("map", "vmap")
_IN_FLIGHT = 2  # calls dispatched before the result of the first is fetched, so that no device is idle
_BATCH = {"map": 4, "vmap": 256}
_SHARE = 0.8  # fraction of the free memory that is used


class Program(NamedTuple):
    """Everything that determines the compiled program, which is the same for all cases."""

    scene_file: SceneFile
    keep: tuple[str, ...]
    names: tuple[str, ...]
    method: str
    batch: int
    devices: tuple[jax.Device, ...]

    @property
    def size(self) -> int:
        """The number of cases in one call."""
        return self.batch * len(self.devices)

    @property
    def sharding(self) -> NamedSharding:
        """The sharding of the cases, along the first axis."""
        return NamedSharding(Mesh(np.array(self.devices), "d"), PartitionSpec("d"))

    def each(self, function):
        """Returns `function` mapped over the cases of one device."""
        return jax.vmap(function) if self.method == "vmap" else lambda xs: lax.map(function, xs)

    def scene(self, row):
        """Returns the scene of one case."""
        return scene_of(self.scene_file, dict(zip(self.names, row, strict=True)))

    def outcome(self, max_steps: int, scene):
        """Runs one case and returns what the sweep keeps of it (`case_summary.outcome`)."""
        case = Case.of(self.scene_file, SWEEP)
        march = case.march()
        if isinstance(march, Adaptive):
            march = dataclasses.replace(march, max_steps=max_steps)
        return outcome(case, self.keep, march, scene)


@functools.lru_cache(maxsize=16)
def _builder(program: Program):
    return jax.jit(program.each(program.scene))


@functools.lru_cache(maxsize=16)
def _compiled(program: Program, max_steps: int):
    def one(case):
        scene, live = case
        run = functools.partial(program.outcome, max_steps)
        nothing = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(run, scene))
        return lax.cond(live, run, lambda _: nothing, scene)

    rows = jax.ShapeDtypeStruct((program.size, len(program.names)), float)
    arguments = jax.tree.map(
        lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype, sharding=program.sharding),
        (jax.eval_shape(_builder(program), rows), jax.ShapeDtypeStruct((program.size,), bool)),
    )
    spec = program.sharding.spec
    # Scenes are built outside, because the root finder for ellipses cannot be used inside `shard_map`.
    spread = jax.shard_map(
        lambda *cases: program.each(one)(cases),
        mesh=program.sharding.mesh,
        in_specs=spec,
        out_specs=spec,
        check_vma=False,
    )
    options = options_for(program.devices[0].platform, quickly=False)
    return jax.jit(spread).lower(*arguments).compile(compiler_options=options or None)


class Batches:
    """Runs the cases of one sweep.

    Args:
        sweep_file: the sweep, with a fixed number of nodes.
        names: the numbers that vary.
        devices: the devices of this process, which share the cases.
        method: "map" or "vmap"; chosen by platform if None.
        batch: cases per device and call. The default is 4 for "map". For "vmap" it is 256, or fewer if memory is short.

    Raises:
        SceneError: one case, or the number of cases asked for, does not fit into memory.
    """

    def __init__(
        self,
        sweep_file: SweepFile,
        names: tuple[str, ...],
        devices: list[jax.Device],
        method: str | None = None,
        batch: int | None = None,
    ):
        method = method or ("map" if devices[0].platform == "cpu" else "vmap")
        first, _ = sweep_file.max_steps
        scene = for_use(sweep_file.scene, SWEEP)
        program = Program(scene, sweep_file.keep, names, method, batch or _BATCH[method], tuple(devices))
        while (need := _bytes(_compiled(program, first))) > (free := _free(devices)):
            fits = math.floor(program.batch * free / need)
            if batch or not fits:
                raise SceneError(_too_large(program, need, free, fits))
            program = program._replace(batch=fits)
        self.program, self._first = program, first

    def outcomes(self, max_steps: int, values: Float[np.ndarray, "cases names"]) -> Iterator[tuple[slice, dict]]:
        """Yields slices of the cases and the arrays for them (`case_summary.outcome`), in order, as they finish."""
        program, compiled = self.program, _compiled(self.program, max_steps)
        starts = list(range(0, len(values), program.size))
        waiting: deque = deque()

        def scenes(k):
            if k >= len(starts):
                return None
            part = values[starts[k] : starts[k] + program.size]
            live = np.arange(program.size) < len(part)
            rows = np.concatenate([part, np.broadcast_to(part[:1], (program.size - len(part), part.shape[1]))])
            return jax.device_put((_builder(program)(rows), live), program.sharding)

        # One batch of scenes is built in advance. Otherwise the first device would build them while the others wait.
        ahead = scenes(0)
        for k in range(len(starts)):
            here, ahead = ahead, scenes(k + 1)
            waiting.append((starts[k], compiled(*here)))
            if len(waiting) > _IN_FLIGHT:
                yield _fetched(*waiting.popleft(), len(values))
        while waiting:
            yield _fetched(*waiting.popleft(), len(values))

    def shapes(self) -> dict[str, jax.ShapeDtypeStruct]:
        """Returns the shapes of the arrays that `outcomes` yields, for one case."""
        row = jax.ShapeDtypeStruct((len(self.program.names),), float)
        return jax.eval_shape(lambda row: self.program.outcome(self._first, self.program.scene(row)), row)


def _too_large(program: Program, need: int, free: int, fits: int) -> str:
    said = f"{program.batch} cases at a time need {_gib(need)} of memory per device, of which {_gib(free)} are free"
    if fits:
        return f"batch = {program.batch}, expected at most {fits}: {said}."
    nodes = program.scene_file.numerics.nodes
    # Most of the memory is matrices, whose size grows with the square of the number of nodes.
    fewer = 2 * math.floor(0.5 * nodes * math.sqrt(free / need))
    return f"numerics.nodes = {nodes}, expected about {fewer} or fewer: {said}."


def _fetched(start: int, outcomes: dict, cases: int) -> tuple[slice, dict[str, np.ndarray]]:
    found = {name: np.asarray(value) for name, value in problem.awaited(outcomes).items()}
    count = min(len(found["status"]), cases - start)
    return slice(start, start + count), {name: value[:count] for name, value in found.items()}


def _bytes(program) -> int:
    """Returns the memory that a program needs on each device, with the calls in flight."""
    needs = program.memory_analysis()
    return needs.temp_size_in_bytes + (_IN_FLIGHT + 1) * (needs.output_size_in_bytes + needs.argument_size_in_bytes)


def _free(devices: list[jax.Device]) -> int:
    """Returns the number of bytes that each device may use."""
    known = devices[0].memory_stats()
    if known and "bytes_limit" in known:
        return int(_SHARE * (known["bytes_limit"] - known.get("bytes_in_use", 0)))
    return int(_SHARE * _free_on_host() / len(devices))


def _free_on_host() -> int:
    try:
        with open("/proc/meminfo") as file:
            lines = dict(line.split(":") for line in file)
        return 1024 * int(lines["MemAvailable"].split()[0])
    except (OSError, KeyError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _gib(size: int) -> str:
    return f"{size / 2**30:.2g} GiB"
