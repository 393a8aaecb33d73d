"""Vesicles at equilibrium, without field or flow: what `relaxed = true` asks for, before anything else begins."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..base import status
from ..geometry import curve
from ..numerics.arrays import NodePoints, Status
from ..physics.scene import Scene
from ..stepping import marching
from ..stepping.marching import AbstractMarch, Adaptive

_REST = 1e-5  # how far a vesicle at rest moves in one t_κ, at most, in its own units; tolerance 1e-7 leaves 1e-6
MARCH = Adaptive(1e-7)


@eqx.filter_jit
def at_rest(x: NodePoints, march: AbstractMarch = MARCH) -> tuple[NodePoints, Status]:
    """A vesicle at equilibrium, in its place and direction, and COMPLETE, or the status that kept it from resting.

    Pure: may be traced, and differentiated through its run by `march`.
    """
    # The shape at rest depends on neither size nor κ_B: relax it in its own units, and as fast as any other.
    outline = curve.Curve.from_nodes(x)
    center, size = curve.centroid(outline), curve.length(outline) / (2 * np.pi)
    # Deviations fall by e^-12 in one t_κ when nearly round, by e^-1.3 at Δ = 0.25.
    start = Scene((x[None] - center) / size, jnp.ones(1))
    result = marching.simulate(start, 20.0, saves=20, march=march)
    # Its computed velocity is no measure of rest: few nodes leave one that projecting takes back.
    moving = jnp.max(jnp.abs(result.x[-1] - result.x[-2])) > _REST
    code = jnp.where((result.status == status.COMPLETE) & moving, status.TOO_MANY_STEPS, result.status)
    return center + size * result.state.y.x[0], code


def relaxed(scene: Scene, which: Sequence[bool], march: AbstractMarch = MARCH) -> tuple[Scene, list[Status]]:
    """The scene with the vesicles of `which` at equilibrium, each by itself, and how each of them got there. Pure."""
    x, codes = scene.x, []
    for m in np.flatnonzero(which):
        rest, code = at_rest(x[m], march)
        x = x.at[m].set(rest)
        codes.append(code)
    return eqx.tree_at(lambda s: s.x, scene, x), codes
