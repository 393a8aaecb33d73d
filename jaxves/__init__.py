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

# What users need, by the module that has it. Nothing else is promised to stay where it is.
_PUBLIC = {
    "base": ("status",),
    "base.compiling": ("fast_start",),
    "geometry.curve": ("Curve",),
    "geometry.domain": ("Cell",),
    "geometry.frames": ("Frames", "read_frames"),
    "geometry.placement": ("random_suspension",),
    "geometry.shapes": ("circle", "disturbed", "ellipse", "ellipse_of_excess", "through_points", "undulated"),
    "physics.electric": ("Field",),
    "physics.flow": ("Extension", "LinearFlow", "Poiseuille", "Shear", "TimeDependent"),
    "physics.scene": ("Scene", "dc_field", "make_scene"),
    "physics.units": ("LabQuantities",),
    "physics.waveform": ("AC", "PiecewiseLinear", "Pulse", "Sine"),
    "operators.pairs": ("Pairwise",),
    "operators.sums": ("MatrixFree",),
    "numerics.linear": ("Dense", "GMRES"),
    "equation.state": ("Unknowns",),
    "equation.equation": ("equation_for",),
    "stepping.schemes": ("ARK4", "ARK5", "SemiImplicitEuler"),
    "stepping.adaptive": ("Adaptive",),
    "stepping.fixed": ("Fixed",),
    "stepping.marching": ("Result", "simulate"),
    "observables.checks": ("Checks",),
    "observables.fields": ("fields_at",),
    "observables.chains": ("chains",),
    "observables.classes": ("class_names",),
    "observables.displacements": ("mean_squared_displacement",),
    "observables.pair_distribution": ("pair_distribution",),
    "observables.structure_factor": ("structure_factor",),
    "inputs.checking": ("SceneError",),
    "inputs.scene_files": ("built_in_scenes", "read_scene"),
    "inputs.parameters": ("numbers",),
    "results.hdf5": ("StoreError",),
    "results.loading": ("load",),
    "results.run_store": ("read_result",),
    "results.sweep_store": ("read_sweep",),
    "runs.build": ("scene_of",),
    "runs.runner": ("run",),
    "sweeps.sweeping": ("sweep",),
    "analysis.critical_field": ("critical_field",),
    "analysis.fit": ("fit", "fit_frames"),
    "analysis.fold": ("critical_value",),
    "analysis.gradcheck": ("check_gradients",),
    "analysis.half_turns": ("OverHalfTurns",),
    "analysis.observations": ("Observations",),
    "analysis.sensitivity": ("AtEnd", "AtRest", "gradient", "hessian_product", "jacobian", "second_order"),
    "analysis.stability": ("stability",),
    "analysis.steady": ("steady_shape",),
    "analysis.steering": ("Steering", "steer"),
}
_HOME = {name: module for module, names in _PUBLIC.items() for name in names}
_FOLDERS = (
    "base",
    "numerics",
    "geometry",
    "inputs",
    "potentials",
    "physics",
    "operators",
    "equation",
    "observables",
    "results",
    "stepping",
    "runs",
    "analysis",
    "sweeps",
    "plots",
    "cli",
)

__all__ = ["plots", *_HOME]


def __getattr__(name: str):
    if name in _HOME:
        module = importlib.import_module(f"{__name__}.{_HOME[name]}")
        value = getattr(module, name) if hasattr(module, name) else importlib.import_module(f"{module.__name__}.{name}")
        globals()[name] = value  # the next time without a detour
        return value
    if name in _FOLDERS:
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return sorted([*globals(), *__all__])
