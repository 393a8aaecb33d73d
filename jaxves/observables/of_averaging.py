r"""How far a shape swings within a period of an AC field, which a run that is averaged over the period leaves out.

The traction is a quadratic form f[E] of the fields. With f[A, B] = ½ (f[A + B] - f[A] - f[B]), the fields
E_0 + Re[Ê e^{iφ}], φ = ωt, Ê = R + iI, give the mean f[E_0] + ½ f[R] + ½ f[I], and besides

    2 f[E_0, R] cos φ - 2 f[E_0, I] sin φ + ½ (f[R] - f[I]) cos 2φ - f[R, I] sin 2φ

Each part moves the nodes with the velocity that its force causes at the present shape. Integrated over time, amplitudes
of the velocity become those of the displacement, divided by ω or 2ω. Their sum is the swing, to leading order in 1/ω. A
run that resolves the field starts without it, and is therefore displaced by about as much. What the flow makes of such
a displacement later is not part of the estimate.
"""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array

from ..equation.staged_charging import mean_traction
from ..numerics import fourier
from ..physics.waveform import AC
from .registry import Instant, gives


def is_averaged(scene) -> bool:
    """Returns whether the scene has a field that is averaged over its period."""
    return scene.field is not None and isinstance(scene.field.history, AC) and scene.field.history.averaged


@gives("averaged_swing", needed=is_averaged)
def of_averaging(instant: Instant, found) -> dict[str, Array]:
    """The largest displacement of a node of each vesicle, (M,)."""
    equation, surfaces, field = instant.equation, instant.motion.surfaces, instant.scene.field
    mean, (real, imag) = instant.motion.electric.fields, instant.motion.electric.envelope

    def traction(fields):
        return field.stress_scale() * mean_traction(surfaces, fields, field)

    def product(one, other):
        return 0.5 * (traction(jax.tree.map(jnp.add, one, other)) - traction(one) - traction(other))

    forces = jnp.stack([
        2 * product(mean, real), 2 * product(mean, imag), 0.5 * (traction(real) - traction(imag)), product(real, imag)
    ])  # fmt: skip
    response = equation.mobility.at(surfaces)
    direct = equation.coupling is not None and equation.coupling.direct

    def velocity(force):
        moved = response.moved(force, None, equation.is_circle(), cut=equation.filter.surface, direct=direct)
        return fourier.low_pass(moved.velocity, equation.filter.x, axis=1)

    square = jnp.sum(lax.map(velocity, forces) ** 2, axis=-1).reshape(2, 2, *forces.shape[1:3]).sum(axis=1)
    size = jnp.sqrt(jnp.where(square > 0, square, jnp.finfo(square.dtype).tiny))
    omega = field.history.angular_frequency()
    return {"averaged_swing": jnp.max(size[0] / omega + size[1] / (2 * omega), axis=-1)}
