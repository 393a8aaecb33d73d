"""Checks of starting curves: orientation, node spacing, and contact of a curve with itself or with others.

The nodes of a starting curve must be counter-clockwise and equispaced in arc length ("even"). Few nodes do not resolve
a curve exactly, so the computed spacing varies even then, in its high modes. The test therefore compares the modes up
to N/4 of the spacing with the higher ones. Uneven nodes are refused because the equation keeps the spacing even: it
would deform the curve to reach that.
"""

import numpy as np
from jaxtyping import Array, Bool, Float
from shapely import Polygon

from ..base.arguments import refusal
from ..numerics import fourier
from . import outlines

_EVEN = 1e-5  # relative deviation of the spacing that is allowed
_GROSS = 1e-2  # the same for traced curves, whose nodes cannot be moved before the run
_SLOW = 0.5  # largest ratio of low to high modes of the spacing; ellipses with 16 to 256 nodes reach 0.40
_FINE = 8  # points per node in checks of contact


def _derivative(x: Float[Array | np.ndarray, "M N 2"]) -> Float[Array | np.ndarray, "M N 2"]:
    N = x.shape[1]
    return fourier.circulant(fourier.derivative_symbol(N), N) @ x


def is_clockwise(x: Float[Array | np.ndarray, "M N 2"]) -> Bool[Array | np.ndarray, "M"]:
    """Returns which curves enclose an area that is negative or zero. NumPy and traced arrays are allowed."""
    d = _derivative(x)
    return ~((x[..., 0] * d[..., 1] - x[..., 1] * d[..., 0]).sum(axis=1) > 0)


def is_uneven(x: Float[Array | np.ndarray, "M N 2"], most: float = _EVEN) -> Bool[Array | np.ndarray, "M"]:
    """Returns which curves have a spacing that deviates by more than `most`. NumPy and traced arrays are allowed."""
    N = x.shape[1]
    speed = (_derivative(x) ** 2).sum(axis=-1) ** 0.5
    deviation = speed / speed.mean(axis=1)[:, None] - 1
    slow = deviation @ fourier.low_pass_matrix(N, N // 4)
    fast = abs(deviation - slow).max(axis=1)
    return (abs(slow).max(axis=1) > most) & (abs(slow).max(axis=1) > _SLOW * fast)


def are_startable(x: Float[Array, "M N 2"]) -> Bool[Array, ""]:
    """Returns whether all curves are counter-clockwise and even enough to start from; may be traced."""
    return ~(is_clockwise(x).any() | is_uneven(x, _GROSS).any())


def check_curves(argument: str, x: Float[np.ndarray, "M N 2"]) -> None:
    """Checks known curves; `argument` is the name used in messages.

    Raises:
        ValueError: a node is not finite, two neighbouring nodes coincide, a curve crosses itself, or two curves overlap
            or touch.
    """
    finer = []
    for m, nodes in enumerate(x):
        name = f"{argument}[{m}]" if len(x) > 1 else argument
        if not np.all(np.isfinite(nodes)):
            bad = int(np.argmin(np.isfinite(nodes).all(axis=1)))
            raise refusal(f"{name}[{bad}]", nodes[bad], "two finite numbers")
        if np.min(np.linalg.norm(nodes - np.roll(nodes, 1, axis=0), axis=1)) == 0:
            raise refusal(name, "nodes of which two neighbours coincide", "distinct nodes")
        finer.append(fourier.resampled(nodes, _FINE * len(nodes), 0))
        if (found := outlines.crossing(finer[m])) is not None:
            at = "({:.5g}, {:.5g})".format(*found.place)
            raise refusal(name, f"a curve that crosses itself near {at}", "a simple closed curve")
    touching = outlines.first_touching([Polygon(curve) for curve in finer]) if len(x) > 1 else None
    if touching is not None:
        i, j = touching
        raise refusal(argument, f"curves of which {i} and {j} overlap or touch", "vesicles clear of each other")
