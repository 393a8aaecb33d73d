"""The choice of a method for the interactions of many membranes, without matrices of all pairs."""

import equinox as eqx
from jax.sharding import Mesh

from ..base.arguments import refusal
from ..ewald.plans import accuracy_for, plan_for, plan_in_cell
from ..geometry.curve import Curve
from ..geometry.domain import AbstractDomain, Cell
from .direct_sums import Summation
from .double_layers import AbstractDoubleLayers, DoubleLayers
from .fast_double_layers import FastDoubleLayers
from .fast_sums import FastSummation
from .interactions import NEAR, SOLVED, AbstractCoupling, AbstractInteractions
from .near_pairs import NearPairs
from .pairs import Pairwise

_TOGETHER = 512  # up to so many nodes in all, one matrix is used for the linear part of all shapes
_FAST = 4096  # from so many nodes on, fast sums are used
ACCURACY = 1e-10  # default of fast sums; the tolerances of time steps are far above it
_SHARE = 1e-2  # accuracy of fast sums over the tolerance of time steps
_LEAST, _GREATEST = 1e-12, 1e-6  # bounds of the accuracy that is chosen from a tolerance


class MatrixFree(AbstractCoupling):
    """Computes sums instead of storing matrices. Coupled systems are solved by GMRES.

    `neighbours` is the room for near pairs, per vesicle on average. `mesh` has devices along one axis that share the
    work of direct sums. `accuracy` is the error of fast sums, relative to their largest value. With None, sums are
    direct. `solved` is the relative residual to which coupled systems are then solved; the default is a tenth of the
    accuracy.

    Raises:
        ValueError: there are both a mesh and an accuracy, as fast sums run on one device; or sums are direct and the
            vesicles are in a periodic cell.
    """

    neighbours: int = eqx.field(static=True, default=8)
    mesh: Mesh | None = eqx.field(static=True, default=None)
    near: float = eqx.field(static=True, default=NEAR)
    accuracy: float | None = eqx.field(static=True, default=None)
    solved: float | None = eqx.field(static=True, default=None)
    direct = False
    together = False

    def __check_init__(self):
        if self.accuracy is None:
            return
        if self.mesh is not None:
            wanted = "no mesh together with an accuracy: fast sums run on one device"
            raise refusal("MatrixFree.mesh", self.mesh, wanted)
        accuracy_for(self.accuracy)

    def tolerance(self) -> float:
        if self.solved is not None:
            return self.solved
        return SOLVED if self.accuracy is None else max(SOLVED, 0.1 * self.accuracy)

    def room(self, M: int) -> int:
        return self.neighbours

    def between(
        self, curves: Curve, domain: AbstractDomain, *, electric: bool, contrast: bool = False
    ) -> AbstractInteractions:
        near = NearPairs.of(curves, self.neighbours, self.near, domain)
        if self.accuracy is None:
            return Summation.of(curves, near, self.mesh, electric=electric)
        M, N, _ = curves.x.shape
        if isinstance(domain, Cell):
            plan = plan_in_cell(M, N, self.accuracy, domain.aspect, contrast=contrast)
        else:
            plan = plan_for(M, N, self.accuracy, contrast=contrast)
        return FastSummation.of(curves, near, plan, domain, electric=electric, solved=self.tolerance())


def double_layers_of(
    curves: Curve, interactions: AbstractInteractions, coupling: AbstractCoupling, domain: AbstractDomain
) -> AbstractDoubleLayers:
    """Returns the Stokes double layers between membranes, by sums with the near pairs of the `interactions`."""
    if isinstance(interactions, FastSummation):
        return FastDoubleLayers.of(curves, interactions, domain)
    if isinstance(interactions, Summation):
        return DoubleLayers.of(curves, interactions.near)
    return DoubleLayers.of(curves, NearPairs.of(curves, coupling.room(curves.x.shape[0]), coupling.near, domain))


def accuracy_of_sums(tolerance: float | None) -> float:
    """Returns the accuracy of fast sums for time steps with this tolerance; None stands for steps of a given size."""
    return ACCURACY if tolerance is None else min(max(_SHARE * tolerance, _LEAST), _GREATEST)


def residual_of_systems(tolerance: float | None) -> float | None:
    """Returns the residual of coupled systems with fast sums, for time steps with this tolerance; None for the default.

    It is ten times the error of the sums. An error of the velocity with this relative size changes a step by far less
    than the tolerance.
    """
    return None if tolerance is None else 10 * accuracy_of_sums(tolerance)


def coupling_for(
    M: int, N: int, neighbours: int = 8, accuracy: float = ACCURACY, solved: float | None = None
) -> AbstractCoupling | None:
    """Returns the fastest method for M membranes of N nodes; None for one membrane.

    By the measurements of `experiments/scale.py`, GMRES is faster than the factorisation from 3 to 4 membranes on. Sums
    are faster than matrices from about 1024 unknowns on, where the matrices take 42 MB. Fast sums are used from 4096
    nodes on (`experiments/fast_sums.py`).
    """
    if M == 1:
        return None
    if M * N >= _FAST:
        return MatrixFree(neighbours, accuracy=accuracy, solved=solved)
    if M * N > 1024:
        return MatrixFree(neighbours)
    return Pairwise(direct=M * N <= 192, together=M * N <= _TOGETHER)


def coupling_in_cell(neighbours: int = 8, accuracy: float = ACCURACY, solved: float | None = None) -> AbstractCoupling:
    """Returns the method for membranes in a periodic cell; also for a single one, which has images."""
    return MatrixFree(neighbours, accuracy=accuracy, solved=solved)
