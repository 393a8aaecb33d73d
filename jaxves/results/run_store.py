"""The contents of the result file of a run, and functions that read it. `run_writer` describes how it is written.

`/t` has all saved times from the start, also those whose rows are not written yet and are NaN. The file can therefore
be opened and selected by time while it is written. The root attribute `saved` is the number of valid rows.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from ..base import status
from ..observables import quantities
from ..observables.rows import Row
from . import restart
from .hdf5 import Description, StoreError, datasets_below, histories, named_errors, opened, refuse_special
from .ownership import writer_of
from .views import Viewed

SCHEMA_VERSION = 2

HISTORY = {
    "t": Description("t_kappa", "time", ("t",)),
    "x": Description("a", "position of the nodes", ("t", "vesicle", "node", "xy")),
    "V_m": Description("a E_inf", "transmembrane potential", ("t", "vesicle", "node")),
    "tension": Description("kappa_B/a^2", "membrane tension", ("t", "vesicle", "node")),
    "nodes": Description("1", "nodes used in the computation", ("t", "vesicle"), int),
    "steps": Description("1", "accepted steps until then", ("t",), int),
}
_NODES = ("t", "vesicle", "node")
# The scalars of a state besides V_m, as far as the model of charging has them.
SCALARS = {
    "Q": Description("eps_e E_inf", "charge of the interface, both faces together", _NODES),
    "W": Description("a E_inf", "half the difference of the charges of the faces, over C_m", _NODES),
}
# In an AC field that is averaged over its period, envelopes: the scalar is its mean + Re[(real + i imag) e^{iωt}].
SCALARS |= {
    f"{name}_{part}": Description(of.units, f"{part} part of the envelope of {name}", _NODES)
    for name, of in (*SCALARS.items(), ("V_m", HISTORY["V_m"]))
    for part in ("real", "imag")
}

_DIAGNOSTICS = "diagnostics/"  # where a file has the diagnostics of the saved times
_SCALARS = "scalars/"  # where it has the scalars besides V_m


def datasets_of(row: Row) -> dict[str, np.ndarray]:
    """Returns the arrays of a row by their paths in a result file."""
    found = {name: getattr(row, name) for name in HISTORY if getattr(row, name) is not None}
    found |= {f"{_SCALARS}{name}": value for name, value in (row.scalars or {}).items()}
    return found | {f"{_DIAGNOSTICS}{name}": value for name, value in row.diagnostics.items()}


def row_of(datasets: Mapping[str, np.ndarray]) -> Row:
    """Returns the row with these arrays by their paths, the inverse of `datasets_of`; others are left out."""

    def below(folder: str) -> dict[str, np.ndarray]:
        return {name.removeprefix(folder): datasets[name] for name in datasets if name.startswith(folder)}

    history = {name: datasets.get(name) for name in HISTORY}
    return Row(diagnostics=below(_DIAGNOSTICS), scalars=below(_SCALARS), **history)


def description(path: str, axes: int = 2) -> Description:
    """Returns what the dataset at this path holds. `axes` is the number of axes, which tells it of unknown names."""
    if path in HISTORY:
        return HISTORY[path]
    if path.startswith(_SCALARS):
        return SCALARS[path.removeprefix(_SCALARS)]
    return Description(*quantities.described(path.removeprefix(_DIAGNOSTICS), axes))


@dataclass(frozen=True, repr=False)
class Record(Viewed):
    """The contents of the result file of a run. The first axis of arrays is the saved times, except in `averages`.

    `t` (T,), `x` (T, M, N, 2), `V_m` (T, M, N) or None without a field, `tension` (T, M, N), `nodes` (T, M),
    `steps` (T,), or None for a result that Python saved. `scalars` are the scalars of the state besides V_m by name,
    (T, M, N) each. `scene` is the scene as TOML. `is_cut_off` says that the process which wrote the file was ended
    before it could store how the run ended.
    """

    t: np.ndarray
    x: np.ndarray
    V_m: np.ndarray | None
    tension: np.ndarray
    nodes: np.ndarray
    steps: np.ndarray | None
    scalars: dict[str, np.ndarray]
    diagnostics: dict[str, np.ndarray]
    averages: dict[str, np.ndarray] | None
    attributes: dict
    status: str
    scene: str
    is_cut_off: bool = False

    @property
    def word(self) -> str:
        """How the run ended: `status`, or "cut off" if this is "running" although no process writes the file."""
        return "cut off" if self.is_cut_off else self.status


def read_result(path: str | os.PathLike) -> Record:
    """Reads a result file up to the last saved row. The run may be complete, interrupted or still running.

    Raises:
        StoreError: the file does not exist, is not a result file, or has a later version.
    """
    path = Path(path)
    # A run may be writing the file. It only adds rows, so reading at the same time is safe.
    with named_errors("read", path), open_result(path) as file:
        attributes = {k: v.item() if isinstance(v, np.generic) else v for k, v in file.attrs.items()}
        rows = {name: dataset[: attributes["saved"]] for name, dataset in histories(file).items()}
        averages = None
        if "averages" in file:
            averages = {name: dataset[()] for name, dataset in datasets_below(file["averages"]).items()}
    return Record(
        **row_of(rows)._asdict(),
        averages=averages,
        attributes=attributes,
        status=attributes["status"],
        is_cut_off=attributes["status"] == status.WORDS[status.RUNNING] and writer_of(path) is None,
        scene=attributes["scene"],
    )


def state(path: str | os.PathLike) -> dict[str, np.ndarray]:
    """Returns the arrays of the restart state, by name. The file is not changed.

    Raises:
        StoreError: the file is not a result file, or has no restart state.
    """
    path = Path(path)
    with named_errors("resume", path), open_result(path) as file:
        valid, _ = restart.slots(file)
        leaves = restart.leaves_in(valid)
    if not leaves:
        raise StoreError(f"{path} holds no state to resume from.")
    return leaves


def open_result(path: Path) -> h5py.File:
    """Opens the file of a run for reading.

    Raises:
        StoreError: the file does not exist, is not a result file, or has a later version.
    """
    refuse_special(path)
    if not path.exists():
        raise StoreError(f"{path} does not exist.")
    if not h5py.is_hdf5(path):
        raise StoreError(f"{path} is not a jaxves result file.")
    file = opened(path, "r")
    schema = file.attrs.get("schema_version")
    if schema is None or "saved" not in file.attrs:
        file.close()
        raise StoreError(f"{path} is not a jaxves result file.")
    if schema > SCHEMA_VERSION:
        file.close()
        raise StoreError(f"{path} has schema version {schema}, later than {SCHEMA_VERSION}: a newer jaxves reads it.")
    return file
