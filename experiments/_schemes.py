"""Time-stepping schemes for comparison: schemes of order 2 and 3, and evenly spaced steps.

[GKC] F. X. Giraldo, J. F. Kelly, E. M. Constantinescu, Implicit-explicit formulations of a three-dimensional
      nonhydrostatic unified model of the atmosphere, SIAM J. Sci. Comput. 35 (2013) B1162-B1194: ARK2(1)3L.
[KC3] C. A. Kennedy, M. H. Carpenter, Appl. Numer. Math. 44 (2003) 139-181: ARK3(2)4L[2]SA.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Int

from jaxves.equation.norms import ROUGH
from jaxves.stepping.fixed import AbstractEven, Fixed
from jaxves.stepping.schemes import AbstractStepper, AdditiveRungeKutta, Tableau

_ROOT = np.sqrt(2)


class ARK2(AdditiveRungeKutta):
    """ARK2(1)3L [GKC]: three stages, order 2, embedded order 1."""

    order = 2
    tableau = Tableau(
        gamma=1 - 1 / _ROOT,
        explicit=[[2 - _ROOT], [1 - (3 + 2 * _ROOT) / 6, (3 + 2 * _ROOT) / 6]],
        implicit=[[1 - 1 / _ROOT], [1 / (2 * _ROOT), 1 / (2 * _ROOT)]],
        weights=[1 / (2 * _ROOT), 1 / (2 * _ROOT), 1 - 1 / _ROOT],
        embedded=[(4 - _ROOT) / 8, (4 - _ROOT) / 8, 1 / (2 * _ROOT)],
        order=2,
    )


class ARK3(AdditiveRungeKutta):
    """ARK3(2)4L[2]SA [KC3]: four stages, order 3, embedded order 2."""

    order = 3
    tableau = Tableau(
        gamma=1767732205903 / 4055673282236,
        explicit=[
            [1767732205903 / 2027836641118],
            [5535828885825 / 10492691773637, 788022342437 / 10882634858940],
            [
                6485989280629 / 16251701735622,
                -4246266847089 / 9704473918619,
                10755448449292 / 10357097424841,
            ],
        ],
        implicit=[
            [1767732205903 / 4055673282236],
            [2746238789719 / 10658868560708, -640167445237 / 6845629431997],
            [1471266399579 / 7840856788654, -4482444167858 / 7529755066697, 11266239266428 / 11593286722821],
        ],
        weights=[
            1471266399579 / 7840856788654,
            -4482444167858 / 7529755066697,
            11266239266428 / 11593286722821,
            1767732205903 / 4055673282236,
        ],
        embedded=[
            2756255671327 / 12835298489170,
            -10771552573575 / 22201958757719,
            9247589265047 / 10645013368117,
            2193209047091 / 5459859503100,
        ],
        order=3,
    )


class Even(AbstractEven):
    """Equal steps between saved times; their number `steps` is traced, so that one program is used for all numbers."""

    steps: Int[Array, ""] = eqx.field(converter=jnp.asarray)
    stepper: AbstractStepper
    projection: bool = eqx.field(static=True, default=True)
    rough: float = eqx.field(static=True, default=ROUGH)
    nodes_per_wave: float | None = eqx.field(static=True, default=None)

    def with_tolerance(self, factor):
        steps = jnp.ceil(self.steps * factor ** (-1 / (self.stepper.order + 1))).astype(int)
        return eqx.tree_at(lambda march: march.steps, self, steps)

    def to(self, t_save, journey, equation, stops):
        one = Fixed(1, self.stepper, self.projection)
        start, h = journey.state.t, (t_save - journey.state.t) / self.steps

        def step(i, journey):
            end = jnp.where(i + 1 == self.steps, t_save, start + (i + 1) * h)
            return one.to(end, journey, equation, stops)

        return lax.fori_loop(0, self.steps, step, journey)
