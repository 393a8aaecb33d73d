r"""Computes the diagnostics of a state. `quantities` has their names, units and axes.

Particle stress, with the force f_hd that membranes exert on the fluid:

    Σ_ab = (1/A) Σ [-∮ (f_hd)_a x_b ds + (ν - 1) ∮ (v_a n_b + n_a v_b) ds],   A the total area,   [μ] = Σ_12/Ca in shear

In a field Σ is not symmetric, because the field exerts a torque. Energy balance at every instant:

    dE_b/dt = power of the flow + power of the field - dissipation,     E_b = ½ ∮ κ_B κ² ds
    dissipation = ∮ f_hd · v' ds - R,  flow = -∮ f_hd · v_∞ ds - R,  field = -∮ f_el · dx/dt ds
    v' = dx/dt - v_∞,   R = Σ (ν - 1) ∮ n·(∇v_∞ + ∇v_∞ᵀ)·v' ds

The dissipation is that of the flow v' in both fluids. R is zero for equal viscosities.

The tension drives the drainage of the film between two membranes. Errors of the tension matter more for thinner films.
If the gap d is smaller than the node spacing, the relative error of the drainage rate is about τ/(2d)². Here τ is the
top of the spectrum of the tension, divided by its largest mode (measured in `experiments/film.py`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array

from ..equation.equation import Equation
from ..equation.state import Motion, Unknowns
from ..geometry import curve as geometry
from ..physics.scene import Scene
from . import of_averaging, of_cell_stress, of_charge, of_field, of_membranes, of_suspension
from .classes import DEFORMATION
from .of_membranes import tank_treading_speed
from .of_suspension import has_stress, stress
from .registry import GROUPS, Group, Instant

# Their functions are called in this order, and those of one file in its order. Functions of other files come last.
FILES = (of_membranes, of_field, of_charge, of_averaging, of_suspension, of_cell_stress)
_PLACES = {file.__name__: place for place, file in enumerate(FILES)}


def groups() -> list[Group]:
    """Returns all registered functions in the order in which they are called."""
    return sorted(GROUPS, key=lambda group: _PLACES.get(group.formula.__module__, len(FILES)))


def diagnose(equation: Equation, t: Array, y: Unknowns, motion: Motion) -> dict[str, Array]:
    """Returns all diagnostics of this scene by name, except those that need earlier times."""
    instant = Instant(equation, t, y, motion)
    out: dict[str, Array] = {}
    for group in groups():
        if group.needed(equation.scene):
            out |= group.formula(instant, out)
    return out


def has_period(scene: Scene) -> bool:
    """Returns whether the scene has a uniform field with a period that the steps resolve."""
    return scene.field is not None and scene.field.is_uniform() and scene.field.period() is not None


def integrands_of(scene: Scene, *, window: bool) -> Callable[[Motion, Scene, Array], dict[str, Array]] | None:
    """Returns the function that gives the integrands of running integrals; None if the scene needs none.

    `window` is whether time averages over a window are asked for.
    """
    if window:
        return averaged
    return over_period if has_period(scene) else None


def over_period(motion: Motion, scene: Scene, t: Array) -> dict[str, Array]:
    """Returns what is averaged over every period of the field, by name."""
    return {DEFORMATION: of_field.deformation_along(scene.field, motion.surfaces.curves)}


def averaged(motion: Motion, scene: Scene, t: Array) -> dict[str, Array]:
    """Returns the integrands of the time averages by name.

    Inclinations θ are averaged by way of `director`, which has cos 2θ and sin 2θ.
    """
    curves = motion.surfaces.curves
    theta = jax.vmap(geometry.inclination)(curves)
    return {
        **({"stress": stress(motion, scene)} if has_stress(scene) else {}),
        "tank_treading_speed": jax.vmap(tank_treading_speed)(curves, motion.velocity),
        "deformation": jax.vmap(geometry.deformation, in_axes=(0, None))(curves, jnp.array([0.0, 1.0])),
        "director": jnp.stack([jnp.cos(2 * theta), jnp.sin(2 * theta)], axis=-1),
        **(over_period(motion, scene, t) if has_period(scene) else {}),
    }


def averages(means: dict[str, Array], scene: Scene) -> dict[str, Array]:
    """Returns the time averages by the names of the diagnostics, from the means of the integrands `averaged`."""
    out = {name: means[name] for name in ("stress", "tank_treading_speed", "deformation", DEFORMATION) if name in means}
    director = means["director"]
    out["inclination"] = 0.5 * jnp.arctan2(director[..., 1], director[..., 0])
    known = scene.flow is not None and has_stress(scene)
    viscosity = scene.flow.effective_viscosity(means["stress"]) if known else None
    return out if viscosity is None else out | {"effective_viscosity": viscosity}
