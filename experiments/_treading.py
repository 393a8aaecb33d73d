"""Steady tank-treading: the steady shape of one vesicle in shear and a field, and its linear stability.

For nodes that do not move along the outline, with the treading speed c, a steady state y satisfies

    G(y) = F(y) - mean velocity - c ∂_α y = 0

Disturbances grow with the eigenvalues of ∂G/∂y. Motion along the outline, translations and stretching of the nodes
have eigenvalues on the imaginary axis. The largest real part of a stable state is therefore zero.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxves.analysis.steady import steady_shape
from jaxves.equation.equation import Equation, equation_for
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
    odd: float  # share of what grows fastest that breaks the symmetry under a half turn
    last_step: float
    y: Unknowns


def _disturbances(equation: Equation, y: Unknowns):
    """Returns ∂G/∂y for the ravelled y."""
    motion = equation.motion(jnp.zeros(()), y)
    tangent = motion.surfaces.curves.tangent
    flat, unflatten = ravel_pytree(y)

    def drift_free(velocity):
        return velocity - jnp.mean(velocity, axis=1, keepdims=True)

    treading = jnp.mean(jnp.sum(drift_free(motion.velocity) * tangent, axis=-1)) / equation.speed[0]

    def G(u):
        y = equation.filtered(unflatten(u))
        motion = equation.motion(jnp.zeros(()), y)
        velocity = drift_free(motion.velocity) - treading * fourier.derivative(y.x, axis=1)
        V_rate = motion.rates["V_m"] - treading * fourier.derivative(y.V_m, axis=1)
        return ravel_pytree(equation.filtered(Unknowns.of(velocity, V_rate)))[0]

    return jax.jacfwd(G)(flat)


@eqx.filter_jit
def _found(setting: Setting, y: Unknowns):
    scene = setting.scene(y.x.shape[1])
    found = steady_shape(scene, y)
    return found, _disturbances(equation_for(scene), found.y)


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
    found, matrix = _found(_traced(setting), y)
    values, vectors = np.linalg.eig(np.asarray(matrix))
    first = np.argmax(values.real)
    x = vectors[: y.x.size, first].reshape(-1, 2)
    x = x - x.mean(axis=0)
    # A half turn takes x(α) to -x(α + π).
    odd = np.linalg.norm(x + np.roll(x, len(x) // 2, axis=0)) / (2 * np.linalg.norm(x))
    told = {name: float(np.ravel(value)[0]) for name, value in found.diagnostics.items()}
    return Treading(
        told["effective_viscosity"],
        told["inclination"],
        told["tank_treading_speed"],
        float(values.real[first]),
        float(odd),
        float(found.last_step),
        found.y,
    )


def _traced(setting: Setting) -> Setting:
    return Setting(*map(jnp.asarray, map(float, setting)))
