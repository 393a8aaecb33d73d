"""Results as labelled data: datasets of xarray with units, names and coordinates."""

from typing import Any

import numpy as np

from ..observables.quantities import QUANTITIES, described

_ARRAYS = {
    "x": ("a", "position of the nodes", ("t", "vesicle", "node", "xy")),
    "V_m": ("a E_inf", "transmembrane potential", ("t", "vesicle", "node")),
    "tension": ("kappa_B/a^2", "membrane tension", ("t", "vesicle", "node")),
}


def _xarray() -> Any:
    try:
        import xarray
    except ImportError:
        raise ImportError("to_xarray needs xarray: python -m pip install xarray h5netcdf") from None
    return xarray


def dataset_of_run(record: Any) -> Any:
    """Returns the arrays and diagnostics of one run as an `xarray.Dataset`."""
    xarray = _xarray()
    T, (M, N) = record.saved, np.shape(record.x)[1:3]
    coordinates = {
        "t": ("t", np.asarray(record.t)[:T], {"units": "t_kappa", "long_name": "time"}),
        "vesicle": np.arange(M),
        "node": np.arange(N),
        "xy": ["x", "y"],
    }
    found = {name: (label, getattr(record, name)) for name, label in _ARRAYS.items()}
    found |= {name: (described(name, np.ndim(value)), value) for name, value in record.diagnostics.items()}
    variables = {
        name: (dims, np.asarray(value)[:T], {"units": units, "long_name": long_name})
        for name, ((units, long_name, dims), value) in found.items()
        if value is not None
    }
    return xarray.Dataset(variables, coordinates, {"status": record.word, "digits": record.digits})


def dataset_of_sweep(record: Any) -> Any:
    """Returns the quantities of all cases as an `xarray.Dataset` with the numbers as coordinates."""
    xarray = _xarray()
    variables: dict[str, Any] = {"status": (record.dims, record.status)}
    if record.classes is not None:
        variables["class"] = (record.dims, record.classes)
    if record.motions is not None:
        variables["motion"] = (record.dims, record.motions)
    for name, values in record.data.items():
        units, long_name = record.labels[name]
        inner = _inner_dims(name, values.ndim - record.status.ndim)
        variables[name] = ((*record.dims, *inner), values, {"units": units, "long_name": long_name})
    return xarray.Dataset(variables, dict(record.coordinates))


def _inner_dims(name: str, count: int) -> tuple[str, ...]:
    """Returns the names of the axes of one case, such as "vesicle" for deformation_final."""
    base = name if name in QUANTITIES else name.rpartition("_")[0]
    dims = QUANTITIES[base].dims[1:] if base in QUANTITIES else ()
    return dims if len(dims) == count else tuple(f"{name}_{i}" for i in range(count))
