r"""Charging in an AC field that is averaged over its period: complex envelopes on the moving membranes.

The field is E_0 + Re[Ê e^{iωt}]. Each scalar is s = s_0 + Re[ŝ e^{iωt}] with slowly varying mean s_0 and envelope ŝ.
The laws of charging are linear, so both obey them, ŝ with the further term -iω ŝ. The force is the mean over a period,

    f_el[E_0] + ½ Re f_el[Ê, Ê*] = f_el[E_0] + ½ f_el[Re Ê] + ½ f_el[Im Ê]

What is neglected is the part of the force that oscillates, with 2ω and, beside E_0 or s_0, with ω. It moves the shape
by O(1/ω), which `observables/of_averaging.py` tells.

A run starts with the periodic envelope, in which a field does not begin. The mean s_0 starts so that the sum of both is
the state before, and carries the transient after the field is switched on.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Complex

from ..numerics import linear
from ..numerics.arrays import VesicleNodes
from ..operators.surfaces import Surfaces
from ..physics.charging import Densities, Relaxed, Relaxing
from ..physics.electric import Field
from ..physics.scene import Scene
from ..physics.waveform import AC
from .electrics import AbstractElectrics, MembraneCharging
from .normal_field import solve_normal_field
from .staged_charging import (
    AbstractStagedCharging,
    ChargeRelaxation,
    StagedElectric,
    mean_traction,
    real_normal_field,
    surface_fields,
    with_potential,
)

_PARTS = ("_real", "_imag")
_LONG = 1e12  # a step in t_κ that leads to the periodic envelope from any start


class AveragedCharging(AbstractStagedCharging):
    """The scalars of a law of charging as mean, under their own names, and envelope, with `_real` and `_imag`."""

    field: Field
    law: Relaxed | Relaxing
    cut: int = eqx.field(static=True)

    def start(self, scene, surfaces):
        found = surfaces()
        zero = {name: jnp.zeros(scene.x.shape[:2], complex) for name in self.law.names}
        _, envelope, _, _ = self._envelope(found, zero, jnp.asarray(_LONG), direct=False)
        mean = {name: jnp.zeros(scene.x.shape[:2]) for name in self.law.names}
        if scene.V_m is not None:
            real, _ = self.field.history.envelope()
            E_inf = self.field.E_inf(jnp.zeros(())) + real * self.field.unit_direction()
            mean = with_potential(self.law, scene.V_m, found, E_inf)
        return {name: mean[name] - envelope[name].real for name in mean} | _split(envelope)

    def solve_stage(self, t, surfaces, start, c, *, direct):
        law, names, scale = self.law, self.law.names, self.field.stress_scale()
        E_inf = self.field.E_inf(t)
        densities = law.densities({name: start[name] for name in names}, c)
        g, solution = real_normal_field(surfaces, E_inf, densities, direct=direct)
        q, V = densities.q.at(g), densities.V.at(g)
        scalars = {name: scalar.at(g) for name, scalar in densities.scalars.items()}
        fields = surface_fields(surfaces, E_inf, g, q, V)
        traction = mean_traction(surfaces, fields, self.field)
        rates = law.rates(scalars, V, g)

        joined = {name: start[name + _PARTS[0]] + 1j * start[name + _PARTS[1]] for name in names}
        parts, envelope, turning, other = self._envelope(surfaces, joined, c, direct=direct)
        direction = self.field.unit_direction()
        real, imag = (
            surface_fields(surfaces, amplitude * direction, *(part(value) for value in parts))
            for amplitude, part in zip(self.field.history.envelope(), (jnp.real, jnp.imag), strict=True)
        )
        for own in (real, imag):
            traction = traction + 0.5 * mean_traction(surfaces, own, self.field)
        size = jnp.sqrt(_square(parts[2]))
        found = StagedElectric(
            q, scale * traction, fields, V, V**2 + 0.5 * size**2, jnp.abs(V) + size,
            scalars | _split(envelope), rates | _split(turning), (real, imag),
        )  # fmt: skip
        residual = jnp.maximum(jnp.max(solution.residual), jnp.max(other.residual))
        return found, linear.Solution(g, residual, jnp.max(solution.iterations) + jnp.max(other.iterations))

    def _envelope(self, surfaces: Surfaces, start: dict, c, *, direct: bool):
        """Returns g, q and V, the scalars, their rates, all complex (M, N), and the linear solution."""
        history = self.field.history
        shift = 1j * history.angular_frequency()
        densities = self.law.densities(start, c, shift)
        direction = self.field.unit_direction()
        E_inf = jnp.stack([amplitude * direction for amplitude in history.envelope()])
        g, solution = solve_normal_field(
            surfaces, E_inf, *_components(densities, g_like=start), neutral=densities.neutral, direct=direct
        )
        g = g[:, 0] + 1j * g[:, 1]
        V = densities.V.at(g)
        scalars = {name: scalar.at(g) for name, scalar in densities.scalars.items()}
        return (g, densities.q.at(g), V), scalars, self.law.rates(scalars, V, g, shift), solution


def _square(V: Complex[Array, "M N"]) -> VesicleNodes:
    """Returns |V|², with a square root whose derivative is finite where V vanishes."""
    square = V.real**2 + V.imag**2
    return jnp.where(square > 0, square, jnp.finfo(square.dtype).tiny)


def _split(values: dict[str, Complex[Array, "M N"]]) -> dict[str, VesicleNodes]:
    """Returns real and imaginary parts by name."""
    real = {name + _PARTS[0]: value.real for name, value in values.items()}
    return real | {name + _PARTS[1]: value.imag for name, value in values.items()}


def _components(densities: Densities, g_like: dict):
    """Returns q and V as values (M, 2, N) and matrices (M, 2, 2) for the real and the imaginary part of g."""
    (like, *_) = g_like.values()
    for value, slope in (densities.q, densities.V):
        value = jnp.broadcast_to(value, like.shape)
        slope = jnp.broadcast_to(slope[:, 0], like.shape[:1]) + 0j
        matrix = jnp.stack([jnp.stack([slope.real, -slope.imag], -1), jnp.stack([slope.imag, slope.real], -1)], -2)
        yield jnp.stack([value.real, value.imag], axis=1), matrix


def electrics_for(scene: Scene, solver: linear.AbstractSolver, cut: int) -> AbstractElectrics | None:
    """Returns the electric model of a scene, None without a field. `cut` modes are removed from rates."""
    field = scene.field
    if field is None:
        return None
    law = Relaxed(field) if field.charge_relaxation is None else Relaxing(field)
    if isinstance(field.history, AC) and field.history.averaged:
        return AveragedCharging(field, law, cut)
    if field.charge_relaxation is not None:
        return ChargeRelaxation(field, cut)
    return MembraneCharging(field, solver, cut)
