"""The restart state of a run in its result file: two slots, `/restart/a` and `/restart/b`, which are written in turn.

The dataset `state` of a slot has the arrays of the state as the bytes of a NumPy archive (`.npz`). Their number is
constant as long as no array changes its shape. The dataset is its own dimension scale, because netCDF requires named
dimensions and xarray would not open the file otherwise. The attribute `saved` of a slot is the number of rows to which
its state belongs. The valid slot is the one whose `saved` equals that of the root.

Files of schema version 1 have one dataset for each array instead.
"""

import io

import h5py
import numpy as np

from .hdf5 import datasets_below

SLOTS = ("restart/a", "restart/b")
_RENAMED = {"y/V_m": "y/scalars/V_m"}  # for files from before a state had several scalars


def packed(leaves: dict[str, np.ndarray]) -> np.ndarray:
    """Returns the arrays of a state, by name, as bytes (B,); empty if there are no arrays."""
    if not leaves:
        return np.zeros(0, np.uint8)
    archive = io.BytesIO()
    np.savez(archive, **leaves)
    return np.frombuffer(archive.getvalue(), np.uint8)


def leaves_in(slot: h5py.Group) -> dict[str, np.ndarray]:
    """Returns the arrays of the state in a slot, by name; {} if the slot is empty."""
    if slot.file.attrs["schema_version"] == 1:
        found = {name: np.asarray(leaf[()]) for name, leaf in datasets_below(slot).items()}
    elif "state" not in slot:
        return {}
    else:
        with np.load(io.BytesIO(slot["state"][...].tobytes()), allow_pickle=False) as archive:
            found = dict(archive.items())
    return {_RENAMED.get(name, name): leaf for name, leaf in found.items()}


def create_slot(file: h5py.File, name: str, state: np.ndarray) -> None:
    """Creates a slot with the bytes of `state` that is not valid for any row; replaces an existing one."""
    if name in file:
        del file[name]
    slot = file.create_group(name)
    slot.attrs["saved"] = 0
    if len(state):
        slot["state"] = state
        slot["state"].make_scale("state")
        slot["state"].attrs.update(units="1", long_name="bytes of a NumPy archive: what the run continues from")


def room(slot: h5py.Group) -> int:
    """Returns the number of bytes of the state in this slot."""
    return len(slot["state"]) if "state" in slot else 0


def slots(file: h5py.File) -> tuple[h5py.Group, h5py.Group]:
    """Returns the slot that belongs to the saved rows, and the other one."""
    a, b = (file[name] for name in SLOTS)
    return (a, b) if a.attrs["saved"] == file.attrs["saved"] else (b, a)


def convert(file: h5py.File) -> None:
    """Converts the slots of a file of schema version 1 to the form of this version."""
    found = {name: (packed(leaves_in(file[name])), file[name].attrs["saved"]) for name in SLOTS}
    for name, (state, saved) in found.items():
        create_slot(file, name, state)
        file[name].attrs["saved"] = saved
