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
_TWO_VISCOSITIES = 20  # more of them where viscosities differ: the double layer, and A_ν with its factors
_KEPT = 3  # instants whose pair matrices and sums are there together: that of the step, of a stage, and a copy
_BASE_SYSTEM = 30  # vectors of all unknowns in each of two bases of GMRES


def bytes_of_step(
    M: int,
    N: int,
    coupling: AbstractCoupling | None,
    domain: AbstractDomain,
    *,
    electric: bool,
    contrast: bool = False,
) -> int:
    """Returns about how many bytes a step of M vesicles with N nodes needs, besides the program itself.

    `electric` says that there is a field, and `contrast` that viscosities differ.
    """
    blocks = 5 if electric else 3
    own = (_OWN + _TWO_VISCOSITIES * contrast) * M * N**2
    if coupling is None:
        return _BYTES * own
    if not isinstance(coupling, MatrixFree):
        whole = (M * N) ** 2 * (4 * coupling.direct + 12 * coupling.together)
        return _BYTES * (own + _KEPT * blocks * M * (M - 1) * N**2 + whole)
    # matrices of near pairs: those of D by fast sums have four blocks
    of_dlp = contrast * (3 if coupling.accuracy is None else 5)
    pairs = (blocks + of_dlp) * coupling.room(M) * M * N**2
    sums = 0 if coupling.accuracy is None else _of_sums(M, N, coupling.accuracy, domain, contrast)
    return _BYTES * (own + _KEPT * (pairs + sums) + 2 * _BASE_SYSTEM * M * N)


def _of_sums(M: int, N: int, accuracy: float, domain: AbstractDomain, contrast: bool) -> int:
    if isinstance(domain, Cell):
        plan: Plan = plan_in_cell(M, N, accuracy, domain.aspect, contrast=contrast)
    else:
        plan = plan_for(M, N, accuracy, contrast=contrast)
    points = plan.grid[0] * plan.grid[1] * (1 if isinstance(domain, Cell) else 4)
    local = (2 + 2 * contrast) * plan.pairs(M * N // plan.cluster) * plan.cluster**2
    windows = 2 * M * N * plan.patch
    own = (5 + 4 * contrast) * M * N**2
    return local + windows + own + (8 + 3 * contrast) * points
