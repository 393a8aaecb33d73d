"""Differentiable simulation of vesicles in two-dimensional Stokes flow under electric fields.

Importing the package switches JAX to double precision, without which the method is useless; set
`JAX_ENABLE_X64=0` beforehand to keep single precision for other work (jaxves then refuses to simulate).

Modules are imported when first asked for, so that the command line answers at once.
"""

import importlib
import os
import re
import sys
from importlib.metadata import version

__version__ = version("jaxves")

_OLDEST_JAX = "0.10.0"


def _refuse_old_jax() -> None:
    """Raises ImportError if the installed JAX is older than `_OLDEST_JAX`, as it can be where pip was bypassed.

    With an older JAX, reverse mode fails with errors from inside JAX that do not name the cause.
    """
    found = version("jax")
    if [int(part) for part in re.findall(r"\d+", found)] < [int(part) for part in _OLDEST_JAX.split(".")]:
        raise ImportError(
            f"jaxves needs jax >= {_OLDEST_JAX}, found {found}: python -m pip install --upgrade jax jaxlib"
        )


_refuse_old_jax()

if os.environ.setdefault("JAX_ENABLE_X64", "1").lower() not in {"0", "false"} and "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)

_LAYERS = {
    # vocabulary
    "bounds": (),
    "arrays": (),
    "arguments": (),
    "fourier": (),
    "status": (),
    "certificate": (),
    "lanes": (),
    # geometry
    "outline_files": (),
    "outline_fit": (),
    "outlines": (),
    "curve": ("Curve",),
    "shapes": ("circle", "disturbed", "ellipse", "ellipse_of_excess", "through_points"),
    # potentials: of one curve, at points away from it, and between curves
    "potentials": (),
    "starts": (),
    "interactions": ("Pairwise",),
    "neighbours": (),
    "summation": ("MatrixFree",),
    "surface": ("Surfaces",),
    # physics
    "membrane": (),
    "rigid": (),
    "history": ("Pulse", "Sine", "Table"),
    "electric": ("Field",),
    "flow": ("Extension", "Linear", "Shear"),
    # the equation
    "scene": ("Scene", "dc_field", "make_scene"),
    "krylov": (),
    "linear": ("GMRES", "Dense"),
    "motion": ("Unknowns",),
    "inextensible": (),
    "frozen": (),
    "implicit": (),
    "equation": ("equation_for",),
    # many steps, and what they say
    "steppers": ("ARK4", "ARK5", "SemiImplicitEuler"),
    "extremes": (),
    "diagnostics": (),
    "stepping": ("Adaptive", "Fixed"),
    "replay": (),
    "marching": ("Checks", "simulate"),
    "phases": (),
    "pairphases": (),
    "around": (),
    # scene files: checked tables, and what they describe
    "units": ("Physical",),
    "tables": (),
    "values": (),
    "vesicletables": (),
    "scenetables": (),
    "uses": (),
    "scenefile": (),
    "build": (),
    "parameters": (),
    "rest": (),
    "case": (),
    # runs, result files, pictures
    "hdf5": (),
    "ownership": (),
    "restart": (),
    "store": (),
    "continuation": (),
    "problem": (),
    # derivatives and inverse problems
    "steady": (),
    "sensitivity": (),
    "differences": (),
    "gradcheck": (),
    "critical_field": (),
    "transforms": (),
    "fit": (),
    "resolution": (),
    "wholerun": (),
    "earlier": (),
    "runner": ("run",),
    # sweeps: many cases of one scene
    "sweeptables": (),
    "sweepfile": (),
    "outcome": (),
    "batches": (),
    "sweepstore": (),
    "refinement": (),
    "team": (),
    "sweeping": ("sweep",),
    "plotstyle": (),
    "moments": (),
    "plot": (),
    "sweepplot": (),
    # the command line
    "console": (),
    "template": (),
    "regime": (),
    "conversion": (),
    "summary": (),
    "sweepsummary": (),
    "interrupts": (),
    "longwork": (),
    "pictures": (),
    "cli": (),
}
# A function with the name of its module cannot be `jaxves.NAME`, which is the module: it has a second name here.
_ALIASES = {"find_critical_field": "critical_field", "find_steady_shape": "steady", "fit_scene": "fit"}
_HOME = {name: (module, name) for module, names in _LAYERS.items() for name in names}
_HOME |= {alias: (module, module) for alias, module in _ALIASES.items()}

__all__ = [*_LAYERS, *_HOME]


def __getattr__(name: str):
    if name in _HOME:
        module, attribute = _HOME[name]
        value = getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
        globals()[name] = value  # the next time without a detour
        return value
    if name in _LAYERS:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted([*globals(), *__all__])
