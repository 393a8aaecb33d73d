"""Differentiable simulation of vesicles in two-dimensional Stokes flow under electric fields.

Importing the package switches JAX to double precision, without which the method is useless; set
`JAX_ENABLE_X64=0` beforehand to keep single precision for other work (jaxves then refuses to simulate).

Modules are imported when first asked for, so that the command line answers at once.
"""

import os
import re
import sys
from importlib.metadata import version

import lazy_loader

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

# The names that users need are in `__init__.pyi`, where type checkers and editors find them too.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
