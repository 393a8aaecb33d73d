"""Steady tank-treading: the steady shape of one vesicle in shear and a field, and its linear stability."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxves.analysis.disturbances import CENTER
from jaxves.analysis.stability import stability
from jaxves.equation.state import Unknowns
from jaxves.geometry import shapes
from jaxves.numerics import fourier
from jaxves.physics.flow import Shear
from jaxves.physics.scene import Scene, dc_field, make_scene
from jaxves.stepping import marching
from jaxves.stepping.adaptive import Adaptive


class Setting(NamedTuple):
    """The numbers of one vesicle in shear and a field."""

    reduced_area: float
    conductivity_ratio: float
    beta: float
    capillary_number: float
    conductance: float = 4.0

    def scene(self, N: int, angle=0.6) -> Scene:
        """From this angle, in radians."""
        field = dc_field(self.beta, conductivity_ratio=self.conductivity_ratio, membrane_conductance=self.conductance)
        x = shapes.ellipse(N, self.reduced_area, angle=angle)
        return make_scene(x, field=field, flow=Shear(self.capillary_number))


class Treading(NamedTuple):
    """A steady state, and the largest rate at which a disturbance of it grows."""

    viscosity: float
    inclination: float
    speed: float
    growth: float
    odd: float  # share of what grows fastest that breaks the symmetry about the centre
    last_step: float
    y: Unknowns


@eqx.filter_jit
def _found(setting: Setting, y: Unknowns):
    return stability(setting.scene(y.x.shape[1]), y, count=1)


@eqx.filter_jit
def _run(setting: Setting, N: int, t_end):
    result = marching.simulate(setting.scene(N), t_end, saves=1, march=Adaptive(1e-4, recorded=None))
    return Unknowns.of(result.x[-1], result.V_m[-1])


def start(setting: Setting, N: int, t_end=1.0) -> Unknowns:
    """Returns the end of a run from an ellipse, without noise in the highest modes.

    If stability limits the steps, this noise remains, and Newton's method only halves it.
    """
    y = _run(_traced(setting), N, jnp.asarray(t_end))
    return jax.tree.map(lambda leaf: fourier.low_pass(leaf, N // 4, axis=1), y)


def at(setting: Setting, y: Unknowns) -> Treading:
    """Returns the steady state near y."""
    found = _found(_traced(setting), y)
    steady = found.steady
    told = {name: float(np.ravel(value)[0]) for name, value in steady.diagnostics.items()}
    return Treading(
        told["effective_viscosity"],
        told["inclination"],
        told["tank_treading_speed"],
        float(found.rates[0].real),
        float(found.breaks[CENTER][0]),
        float(steady.last_step),
        steady.y,
    )


def _traced(setting: Setting) -> Setting:
    return Setting(*map(jnp.asarray, map(float, setting)))
