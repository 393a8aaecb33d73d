"""A buffer of rows that are written to the result file, with the state from which the run can be continued."""

import time
from collections.abc import Mapping
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..base import status
from ..observables import classes
from ..observables.rows import Row
from ..results.hdf5 import StoreError
from ..results.run_store import datasets_of, read_result
from ..results.run_writer import Writer
from ..stepping.state import State

SECONDS_BETWEEN_WRITES = 0.5  # this is the most that a killed run loses


def named(state: State) -> dict[str, np.ndarray]:
    """Returns the arrays of a state, by their names in the restart state of the file."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(state)
    return {jax.tree_util.keystr(path, simple=True, separator="/"): np.asarray(leaf) for path, leaf in leaves}


def restored(template: State, leaves: dict[str, np.ndarray], path: Path) -> State:
    """Returns the state with these arrays; the inverse of `named`.

    If the run stopped at its limit on the number of steps, the steps are counted from zero again.

    Raises:
        StoreError: the arrays in `path` are not those of `template`, as in a file of an earlier version.
    """
    names = list(named(template))
    if sorted(leaves) != sorted(names):
        found = read_result(path).attributes["version"]
        other = ", ".join(sorted({*leaves} ^ {*names}))
        raise StoreError(
            f"{path} holds a state of jaxves {found}, which has other parts ({other}) than this version continues from:"
            " continue it with that version, or start from its end with start= (--from)."
        )
    state = jax.tree.unflatten(jax.tree.structure(template), [jnp.asarray(leaves[name]) for name in names])
    if int(state.status) != status.TOO_MANY_STEPS:
        return state
    # The limit on the number of steps holds for each call of `run`.
    return eqx.tree_at(
        lambda s: (s.status, s.steps, s.rejected), state, (jnp.int32(status.RUNNING), *jnp.int32([0, 0]))
    )


class Rows:
    """A buffer of rows. They are written to the file from time to time, with the state after the last row.

    `start` is None for a run that cannot be continued. `began` is when this part of the run began (`perf_counter`).
    """

    state: State

    def __init__(self, writer: Writer, start: dict[str, np.ndarray] | None, began: float):
        self.writer = writer
        self.start = start
        self._began = began
        self._classified: dict[str, list[np.ndarray]] = {}  # the diagnostics of all rows from which classes follow
        self._waiting: list[Row] = []
        self._written = time.perf_counter()

    def add(self, row: Row, state: State) -> None:
        """Adds a row and the state after it; writes if the last write was some time ago."""
        if len(row.t):
            self._waiting.append(row)
            self.remember(row.diagnostics)
            self.state = state
        if time.perf_counter() > self._written + SECONDS_BETWEEN_WRITES:
            self.write()

    def remember(self, found: Mapping[str, np.ndarray]) -> None:
        """Keeps what classes follow from, of the diagnostics of one row or more."""
        for name in classes.DIAGNOSTICS:
            if name in found:
                self._classified.setdefault(name, []).extend(found[name])

    def has_reached(self, name: str) -> bool:
        """Returns whether every vesicle is in class `name` now, and not every one was at the start."""
        return bool(classes.has_reached({of: np.array(rows) for of, rows in self._classified.items()}, name))

    def write(self) -> None:
        """Writes all rows that are waiting."""
        if self._waiting:
            rows = datasets_of(jax.tree.map(lambda *parts: np.concatenate(parts), *self._waiting))
            block = {name: rows[name] for name in self.writer.names}
            restart = {} if self.start is None else named(self.state) | self.start
            self.writer.append(block, restart, time.perf_counter() - self._began)
            self._waiting = []
        self._written = time.perf_counter()
