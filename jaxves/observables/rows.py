"""Everything that is saved at one time, or at several. Nothing here imports JAX."""

from typing import Any, NamedTuple


class Row(NamedTuple):
    """Everything that is saved at one time. Rows of several times have the times (T,) as the first axis of all arrays.

    A row is a pytree of NumPy arrays or traced arrays: `t` (), `x` (M, N, 2), `tension` (M, N), `V_m` (M, N) or None
    without a field, and `diagnostics` by name. `scalars` has the scalars of the state other than V_m by name, (M, N)
    each; most models have none. Rows of a result file also have the number of `nodes` (M,) and of accepted `steps` ().
    """

    t: Any
    x: Any
    tension: Any
    diagnostics: dict[str, Any]
    V_m: Any = None
    nodes: Any = None
    steps: Any = None
    scalars: Any = None
