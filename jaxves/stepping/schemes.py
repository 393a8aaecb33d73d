r"""One time step of y' = F(t, y) that is implicit in a linear part A, frozen during the step, and explicit in F - A.

`split_equation` says what the schemes need of an equation.

[KC3] C. A. Kennedy, M. H. Carpenter, Additive Runge-Kutta schemes for convection-diffusion-reaction
      equations, Appl. Numer. Math. 44 (2003) 139-181: ARK4(3)6L[2]SA.
[KC19] -, Higher-order additive Runge-Kutta schemes for ordinary differential equations, Appl. Numer.
      Math. 136 (2019) 183-205: ARK5(4)8L[2]SA_b.
"""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..base.arguments import refusal
from ..numerics.arrays import Scalar
from .split_equation import LinearPart, SplitEquation


class Step(eqx.Module):
    """The new y (not yet projected), and the difference to the embedded scheme, None if there is none."""

    y: PyTree[Array]
    error: PyTree[Array] | None


class AbstractStepper(eqx.Module):
    """A one-step method of order `order`. `has_error` says whether it has an embedded scheme."""

    order: eqx.AbstractClassVar[int]
    has_error: eqx.AbstractClassVar[bool]

    @abc.abstractmethod
    def step(self, equation: SplitEquation, frozen: LinearPart, t: Scalar, y: PyTree[Array], h: Scalar) -> Step:
        """Makes a step from (t, y) to t + h; `frozen` is `equation.freeze(t, y)`."""


def _add(y, scale, dy):
    return jax.tree.map(lambda a, b: a + scale * b, y, dy)


class SemiImplicitEuler(AbstractStepper):
    """(1 - hA)(y₊ - y) = h F(y): the first-order scheme of the paper, with everything else at the start of the step."""

    order = 1
    has_error = False

    def step(self, equation, frozen, t, y, h):
        if equation.is_staged:
            wanted = "ARK4() or ARK5() for charge that relaxes or a field averaged over its period"
            raise refusal("stepper", self, wanted)
        increment = frozen.implicit(h).solve(jax.tree.map(lambda f: h * f, equation.rate_of(frozen, t)))
        return Step(_add(y, 1.0, increment), None)


class Tableau:
    """The coefficients of an additive Runge-Kutta pair with the same weights for both parts."""

    def __init__(self, gamma: float, explicit, implicit, weights, embedded, order: int):
        stages = len(weights)
        self.gamma = gamma
        self.order = order
        self.explicit = np.zeros((stages, stages))
        self.implicit = np.zeros((stages, stages))
        for i, (row_e, row_i) in enumerate(zip(explicit, implicit, strict=True), start=1):
            self.explicit[i, :i] = row_e
            self.implicit[i, :i] = row_i
            self.implicit[i, i] = gamma
        self.times = self.explicit.sum(axis=1)
        self.weights = np.array(weights)
        self.error_weights = self.weights - np.array(embedded)


class AdditiveRungeKutta(AbstractStepper):
    """Stage i solves (1 - γhA) d = h Σ_{j<i} (aᴱ N_j + aᴵ L_j), then L = A d = (d - r)/γh, N = F(y + d) - L.

    A scheme is a subclass with its `order` and `tableau`.
    """

    tableau: eqx.AbstractClassVar[Tableau]
    has_error = True

    def step(self, equation, frozen, t, y, h):
        table = self.tableau
        solver = frozen.implicit(table.gamma * h)
        first = equation.rate_of(frozen, t)
        equation = equation.near(frozen)

        def history(f):
            return jnp.zeros((len(table.weights), *f.shape)).at[0].set(f)

        # N and L of all stages are zero until they are known. Every row of the tableau is then a complete sum, and all
        # stages use the same compiled code.
        if equation.is_staged:  # the scalars are wholly implicit
            explicit, implicit = (jax.tree.map(history, part) for part in first.shapes_and_scalars())
        else:
            explicit = jax.tree.map(history, first)
            implicit = jax.tree.map(jnp.zeros_like, explicit)

        # Recomputing a stage is cheaper than storing what its derivative needs.
        @jax.checkpoint
        def stage(carry, row):
            explicit, implicit = carry
            i, a_explicit, a_implicit, c = row
            r = jax.tree.map(
                lambda N, L: h * (jnp.tensordot(a_explicit, N, 1) + jnp.tensordot(a_implicit, L, 1)), explicit, implicit
            )
            if equation.is_staged:
                d, f = equation.stage(solver, t + c * h, y, r, table.gamma * h)
            else:
                d, f = solver.solve(r), None
            L = jax.tree.map(lambda d, r: (d - r) / (table.gamma * h), d, r)
            f = equation.rate(t + c * h, _add(y, 1.0, d)) if f is None else f
            explicit = jax.tree.map(lambda all_, f, L: all_.at[i].set(f - L), explicit, f, L)
            implicit = jax.tree.map(lambda all_, L: all_.at[i].set(L), implicit, L)
            return (explicit, implicit), None

        below = table.implicit - table.gamma * np.eye(len(table.weights))
        rows = (np.arange(1, len(table.weights)), table.explicit[1:], below[1:], table.times[1:])
        (explicit, implicit), _ = jax.lax.scan(stage, (explicit, implicit), jax.tree.map(jnp.asarray, rows))

        def combined(weights):
            return jax.tree.map(lambda N, L: h * jnp.tensordot(weights, N + L, 1), explicit, implicit)

        return Step(_add(y, 1.0, combined(table.weights)), combined(table.error_weights))


_ARK436 = Tableau(
    gamma=1 / 4,
    explicit=[
        [1 / 2],
        [13861 / 62500, 6889 / 62500],
        [-116923316275 / 2393684061468, -2731218467317 / 15368042101831, 9408046702089 / 11113171139209],
        [
            -451086348788 / 2902428689909,
            -2682348792572 / 7519795681897,
            12662868775082 / 11960479115383,
            3355817975965 / 11060851509271,
        ],
        [
            647845179188 / 3216320057751,
            73281519250 / 8382639484533,
            552539513391 / 3454668386233,
            3354512671639 / 8306763924573,
            4040 / 17871,
        ],
    ],
    implicit=[
        [1 / 4],
        [8611 / 62500, -1743 / 31250],
        [5012029 / 34652500, -654441 / 2922500, 174375 / 388108],
        [15267082809 / 155376265600, -71443401 / 120774400, 730878875 / 902184768, 2285395 / 8070912],
        [82889 / 524892, 0, 15625 / 83664, 69875 / 102672, -2260 / 8211],
    ],
    weights=[82889 / 524892, 0, 15625 / 83664, 69875 / 102672, -2260 / 8211, 1 / 4],
    embedded=[
        4586570599 / 29645900160,
        0,
        178811875 / 945068544,
        814220225 / 1159782912,
        -3700637 / 11593932,
        61727 / 225920,
    ],
    order=4,
)


class ARK4(AdditiveRungeKutta):
    """ARK4(3)6L[2]SA [KC3]: six stages, order 4, embedded order 3."""

    order = 4
    tableau = _ARK436


_ARK548 = Tableau(
    gamma=2 / 9,
    explicit=[
        [0.4444444444444444],
        [0.1111111111111111, 0.6476030138606877],
        [0.09182986664774791, 0.03544856751779924, -0.012008999601505184],
        [-0.34252354516023137, -0.2676778594305018, 0.11056894178117282, 0.8563895912138788],
        [-0.009772282879004396, 0.2107086539866175, 0.07592412091217536, 0.20765518596381696, 0.23548432201639455],
        [
            0.46686370681500694,
            1.2903598800650855,
            0.37840596884419414,
            -0.5634558403282616,
            -0.2883238346202236,
            -0.3288498807758014,
        ],
        [
            0.6143967162516691,
            0.6143967162516691,
            0.3174778010668616,
            -0.7121520623952936,
            0.1149870801531021,
            0.09139031575415682,
            -0.040496567082165244,
        ],
    ],
    implicit=[
        [0.2222222222222222],
        [0.26824595137478835, 0.26824595137478835],
        [-0.057945592237231995, -0.057945592237231995, 0.008938396816283733],
        [-0.043305287723547685, -0.043305287723547685, -0.034013891077568637, 0.25515937270676026],
        [0.13179599023759678, 0.13179599023759678, -0.03237672627786233, 0.12385474427672251, 0.14270777930372408],
        [
            0.3093228210043426,
            0.3093228210043426,
            -0.6829199272336792,
            -0.05882275614969546,
            -0.04130861383349944,
            0.8971834329859666,
        ],
        [
            0.0,
            0.0,
            0.1736625357358126,
            0.2547916626081235,
            0.2419017684509479,
            0.30740485830222825,
            -0.19998304731933453,
        ],
    ],
    weights=[
        0.0,
        0.0,
        0.1736625357358126,
        0.2547916626081235,
        0.2419017684509479,
        0.30740485830222825,
        -0.19998304731933453,
        0.2222222222222222,
    ],
    embedded=[
        0.0,
        0.0,
        0.06272421695270713,
        0.25523315714677963,
        0.23902754916001318,
        0.399079522075358,
        -0.14315725125850667,
        0.18709280592364871,
    ],
    order=5,
)


class ARK5(AdditiveRungeKutta):
    """ARK5(4)8L[2]SA_b [KC19]: eight stages, order 5, embedded order 4; for tight tolerances."""

    order = 5
    tableau = _ARK548


def for_tolerance(tolerance: float | None, vesicles: int) -> AbstractStepper:
    """Returns the better scheme for a tolerance: ARK5 for tight ones, ARK4 for others and for fixed steps (None).

    The choice follows the measurements of `experiments.convergence`. For one vesicle, ARK5 takes the same time as ARK4
    for the same error at tolerances of 1e-6 and below. At larger ones stability limits the steps of many scenes, and
    ARK4 has longer and cheaper steps. For several vesicles the errors of all steps add up in their positions. At 1e-5
    and below only ARK5 keeps them within ten tolerances.
    """
    tight = 3e-6 if vesicles == 1 else 3e-5
    return ARK5() if tolerance is not None and tolerance < tight else ARK4()
