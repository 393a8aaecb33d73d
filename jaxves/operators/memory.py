"""An estimate of the memory of a time step, before anything is computed.

It counts the arrays that grow fastest with the number of vesicles M and of nodes N: matrices of pairs, matrices of each
membrane for itself and for the implicit part, and what the fast sums keep.
"""

from ..ewald.plans import Plan, plan_for, plan_in_cell
from ..geometry.domain import AbstractDomain, Cell
from .interactions import AbstractCoupling
from .sums import MatrixFree

_BYTES = 8
_OWN = 36  # matrices (N, N) of one membrane: its kernels, and the linear parts with their factors
_KEPT = 3  # instants whose pair matrices and sums are there together: that of the step, of a stage, and a copy
_BASE_SYSTEM = 30  # vectors of all unknowns in each of two bases of GMRES


def bytes_of_step(M: int, N: int, coupling: AbstractCoupling | None, domain: AbstractDomain, *, electric: bool) -> int:
    """Returns about how many bytes a step of M vesicles with N nodes needs, besides the program itself."""
    blocks = 5 if electric else 3
    own = _OWN * M * N**2
    if coupling is None:
        return _BYTES * own
    if not isinstance(coupling, MatrixFree):
        whole = (M * N) ** 2 * (4 * coupling.direct + 12 * coupling.together)
        return _BYTES * (own + _KEPT * blocks * M * (M - 1) * N**2 + whole)
    pairs = blocks * coupling.room(M) * M * N**2
    sums = 0 if coupling.accuracy is None else _of_sums(M, N, coupling.accuracy, domain)
    return _BYTES * (own + _KEPT * (pairs + sums) + 2 * _BASE_SYSTEM * M * N)


def _of_sums(M: int, N: int, accuracy: float, domain: AbstractDomain) -> int:
    in_cell = isinstance(domain, Cell)
    plan: Plan = plan_in_cell(M, N, accuracy, domain.aspect) if in_cell else plan_for(M, N, accuracy)
    points = plan.grid[0] * plan.grid[1] * (1 if in_cell else 4)
    local = 2 * plan.pairs(M * N // plan.cluster) * plan.cluster**2
    windows = 2 * M * N * plan.patch
    own = 5 * M * N**2
    return local + windows + own + 8 * points
