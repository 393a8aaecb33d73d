r"""What a film shows of a vesicle: its normal distances from the observed outlines, by Fourier modes over their noise.

For each frame, points X_j on the observed curve are compared with the computed one, after both were moved to the same
centroid. The residuals are

    r = W d - seen,   d_j = depth of X_j inside the computed curve (`geometry/distance.py`),   W = Q L⁻¹ B⁺

with the modes B of `geometry/frames.py` up to the number of modes of the film, their covariance L Lᵀ, and Q orthogonal
to both translations. So the residuals are independent with variance 1, and neither the parametrisation of the curve,
such as tank-treading, nor its position counts. Modes beyond those of the film are not compared, on either side.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..base.arguments import require
from ..base.bounds import POSITIVE
from ..geometry import curve as geometry
from ..geometry.curve import Curve
from ..geometry.distance import depths
from ..geometry.frame_measures import basis
from ..geometry.frames import Frames
from ..numerics.arrays import ScalarLike, as_float


class Gauge(eqx.Module):
    """Compares computed shapes with the outlines of a film; lengths are in units of a."""

    rows: Int[Array, "F"]  # of the saved times, 0 for t = 0
    points: Float[Array, "F n 2"]  # about the centroid
    weights: Float[Array, "F q n"]
    saves: int = eqx.field(static=True)  # number of saved times after t = 0

    def __call__(self, x: Float[Array, "T 1 N 2"]) -> Float[Array, "F q"]:
        """Returns the weighted modes of the depths of the observed outlines inside the computed ones."""

        def one(x, points, weights):
            return weights @ depths(x - geometry.centroid(Curve.from_nodes(x)), points)

        return jax.vmap(one)(x[self.rows, 0], self.points, self.weights)


def gauge(frames: Frames, time_unit: ScalarLike) -> tuple[Gauge, Float[np.ndarray, "F q"], float]:
    """Returns the gauge of a film, what it shows (F, q), and the time of the last frame in `time_unit`.

    Raises:
        ValueError: `time_unit` is not positive, or there is no frame after t = 0.
    """
    require("time_unit", time_unit, POSITIVE)
    rows = frames.numbers - frames.start
    if rows[-1] < 1:
        raise ValueError("frames: only one, expected some after t = 0.")
    unit = frames.radius.value / frames.pixel
    found = [_weights(*frame, unit) for frame in zip(frames.curves, frames.covariance, frames.offsets, strict=True)]
    points, weights, seen = (np.array(part) for part in zip(*found, strict=True))
    made = Gauge(jnp.asarray(rows), as_float(points), as_float(weights), int(rows[-1]))
    return made, seen, float(frames.times[-1] / float(time_unit))


def _weights(curve, covariance, offset, unit: float):
    """Returns points about the centroid, weights of their depths, and what is seen of one frame; lengths in `unit`."""
    outline = Curve.from_nodes(jnp.asarray(curve / unit))
    centered = np.asarray(outline.x - geometry.centroid(outline))
    n = len(centered)
    B = basis(2 * np.pi * np.arange(n) / n, len(offset) // 2)
    whitening = np.linalg.inv(np.linalg.cholesky(covariance / unit**2))
    weights = whitening @ np.linalg.pinv(B)
    both = weights @ np.asarray(outline.normal)  # the residuals of a translation along x and along y
    others = np.linalg.svd(both, full_matrices=True)[0][:, 2:].T
    # Where the points are inside the observed curve, that curve is outside the one that they show.
    return centered, others @ weights, -others @ whitening @ (offset / unit)
