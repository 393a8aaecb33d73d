"""The state that a run continues from, in its result file: two slots, `/restart/a` and `/restart/b`, written in turn.

The dataset `state` of a slot holds the arrays of the state as the bytes of a NumPy archive (`.npz`), which are as many
every time as long as no array changes its shape. It is its own dimension scale: netCDF has no arrays without named
dimensions, and xarray would not open a file with some. The attribute `saved` of a slot says how many rows of the file
its state belongs to; the valid slot is the one that agrees with the root's `saved`.

Files of schema version 1 have one dataset for each array instead.
"""

import io

import h5py
import numpy as np

from .hdf5 import datasets_below

SLOTS = ("restart/a", "restart/b")
_RENAMED = {"y/V_m": "y/scalars/V_m"}  # of files that were written before a state had several scalars


def packed(leaves: dict[str, np.ndarray]) -> np.ndarray:
    """The arrays of a state, by name, as bytes (B,); none for no array."""
    if not leaves:
        return np.zeros(0, np.uint8)
    archive = io.BytesIO()
    np.savez(archive, **leaves)
    return np.frombuffer(archive.getvalue(), np.uint8)


def leaves_in(slot: h5py.Group) -> dict[str, np.ndarray]:
    """The arrays of the state in a slot, by name; {} if it holds none."""
    if slot.file.attrs["schema_version"] == 1:
        found = {name: np.asarray(leaf[()]) for name, leaf in datasets_below(slot).items()}
    elif "state" not in slot:
        return {}
    else:
        with np.load(io.BytesIO(slot["state"][...].tobytes()), allow_pickle=False) as archive:
            found = dict(archive.items())
    return {_RENAMED.get(name, name): leaf for name, leaf in found.items()}


def create_slot(file: h5py.File, name: str, state: np.ndarray) -> None:
    """A slot with room for the bytes of `state`, valid for no row; replaces the one that is there."""
    if name in file:
        del file[name]
    slot = file.create_group(name)
    slot.attrs["saved"] = 0
    if len(state):
        slot["state"] = state
        slot["state"].make_scale("state")
        slot["state"].attrs.update(units="1", long_name="bytes of a NumPy archive: what the run continues from")


def room(slot: h5py.Group) -> int:
    """How many bytes a state in this slot has."""
    return len(slot["state"]) if "state" in slot else 0


def slots(file: h5py.File) -> tuple[h5py.Group, h5py.Group]:
    """The slot which belongs to the saved rows, and the other."""
    a, b = (file[name] for name in SLOTS)
    return (a, b) if a.attrs["saved"] == file.attrs["saved"] else (b, a)


def convert(file: h5py.File) -> None:
    """Brings the slots of a file of schema version 1 to the form of this version."""
    found = {name: (packed(leaves_in(file[name])), file[name].attrs["saved"]) for name in SLOTS}
    for name, (state, saved) in found.items():
        create_slot(file, name, state)
        file[name].attrs["saved"] = saved
