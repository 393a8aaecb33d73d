"""Can a simulation start from these curves? Each counter-clockwise, with even nodes, and clear of itself and others.

Nodes are even when they are equispaced in arc length as far as they resolve their curve: the slow part of the node
spacing, modes up to N/4, must then be small beside the fast part, which is what few nodes miss of a smooth curve.
Uneven nodes would do harm: the equation keeps the spacing even, and would move the curve itself to make it so.
"""

import numpy as np
from jaxtyping import Array, Bool, Float
from shapely import Polygon

from ..base.arguments import refusal
from ..numerics import fourier
from . import outlines

_EVEN = 1e-5  # relative deviation of the spacing that counts as none
_GROSS = 1e-2  # and that ends a run whose start is traced, where nobody can put it right
_SLOW = 0.5  # its slow part over its fast part, at most; 0.40 is the largest of ellipses with 16 to 256 nodes
_FINE = 8  # points for each node, in checks of contact


def _derivative(x: Float[Array | np.ndarray, "M N 2"]) -> Float[Array | np.ndarray, "M N 2"]:
    N = x.shape[1]
    return fourier.circulant(fourier.derivative_symbol(N), N) @ x


def is_clockwise(x: Float[Array | np.ndarray, "M N 2"]) -> Bool[Array | np.ndarray, "M"]:
    """Which curves enclose a negative area, or none; for NumPy and traced arrays."""
    d = _derivative(x)
    return ~((x[..., 0] * d[..., 1] - x[..., 1] * d[..., 0]).sum(axis=1) > 0)


def is_uneven(x: Float[Array | np.ndarray, "M N 2"], most: float = _EVEN) -> Bool[Array | np.ndarray, "M"]:
    """Which curves have nodes whose spacing deviates by more than `most`; for NumPy and traced arrays."""
    N = x.shape[1]
    speed = (_derivative(x) ** 2).sum(axis=-1) ** 0.5
    deviation = speed / speed.mean(axis=1)[:, None] - 1
    slow = deviation @ fourier.low_pass_matrix(N, N // 4)
    fast = abs(deviation - slow).max(axis=1)
    return (abs(slow).max(axis=1) > most) & (abs(slow).max(axis=1) > _SLOW * fast)


def are_startable(x: Float[Array, "M N 2"]) -> Bool[Array, ""]:
    """Whether all curves are counter-clockwise and even, but for less than what would do harm; may be traced."""
    return ~(is_clockwise(x).any() | is_uneven(x, _GROSS).any())


def check_curves(argument: str, x: Float[np.ndarray, "M N 2"]) -> None:
    """Raises ValueError when a curve has nodes that are not finite, coincide, or crosses itself, or two curves meet."""
    finer = []
    for m, nodes in enumerate(x):
        name = f"{argument}[{m}]" if len(x) > 1 else argument
        if not np.all(np.isfinite(nodes)):
            bad = int(np.argmin(np.isfinite(nodes).all(axis=1)))
            raise refusal(f"{name}[{bad}]", nodes[bad], "two finite numbers")
        if np.min(np.linalg.norm(nodes - np.roll(nodes, 1, axis=0), axis=1)) == 0:
            raise refusal(name, "nodes of which two neighbours coincide", "distinct nodes")
        finer.append(fourier.resampling_matrix(len(nodes), _FINE * len(nodes)) @ nodes)
        if (found := outlines.crossing(finer[m])) is not None:
            at = "({:.5g}, {:.5g})".format(*found.place)
            raise refusal(name, f"a curve that crosses itself near {at}", "a simple closed curve")
    touching = outlines.first_touching([Polygon(curve) for curve in finer]) if len(x) > 1 else None
    if touching is not None:
        i, j = touching
        raise refusal(argument, f"curves of which {i} and {j} overlap or touch", "vesicles clear of each other")
