"""Relaxation to equilibrium without field or flow. `relaxed = true` of a vesicle asks for it before a run."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..base import status
from ..geometry import curve
from ..numerics.arrays import NodePoints, Status
from ..physics.scene import Scene
from ..stepping import marching
from ..stepping.adaptive import Adaptive
from ..stepping.march import AbstractMarch

_REST = 1e-5  # largest motion of a vesicle at rest in one t_κ, in its own units; tolerance 1e-7 leaves 1e-6
MARCH = Adaptive(1e-7)


@eqx.filter_jit
def at_rest(x: NodePoints, march: AbstractMarch = MARCH) -> tuple[NodePoints, Status]:
    """Relaxes one vesicle to equilibrium; returns its nodes (N, 2) and a status.

    Position and direction are kept. The status is COMPLETE, or the status with which the relaxation failed. The
    function is pure: it may be traced and differentiated.
    """
    # The equilibrium shape depends neither on the size nor on κ_B, so the vesicle is relaxed in its own units.
    outline = curve.Curve.from_nodes(x)
    center, size = curve.centroid(outline), curve.length(outline) / (2 * np.pi)
    # Deviations decay by the factor e^-12 in one t_κ for nearly round shapes, and by e^-1.3 at Δ = 0.25.
    start = Scene((x[None] - center) / size, jnp.ones(1))
    result = marching.simulate(start, 20.0, saves=20, march=march)
    # The computed velocity does not measure rest: with few nodes a velocity remains, which the projection undoes.
    moving = jnp.max(jnp.abs(result.x[-1] - result.x[-2])) > _REST
    code = jnp.where((result.status == status.COMPLETE) & moving, status.TOO_MANY_STEPS, result.status)
    return center + size * result.state.y.x[0], code


def relaxed(scene: Scene, which: Sequence[bool], march: AbstractMarch = MARCH) -> tuple[Scene, list[Status]]:
    """Relaxes the vesicles selected by `which`, each without the others; returns the scene and a status for each. Pure.

    The status is COMPLETE, or the status with which the relaxation failed.
    """
    x, codes = scene.x, []
    for m in np.flatnonzero(which):
        rest, code = at_rest(x[m], march)
        x = x.at[m].set(rest)
        codes.append(code)
    return eqx.tree_at(lambda s: s.x, scene, x), codes
