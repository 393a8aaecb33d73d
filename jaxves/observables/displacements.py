r"""Mean squared displacements of centres, and diffusion, in NumPy.

In a flow with the velocity gradient Γ, what the flow itself carries along is subtracted:

    X(t) = x(t) - ∫ Γ x dt,      MSD_a(s) = ⟨(X_a(t + s) - X_a(t))²⟩,      D_a = ½ dMSD_a/ds at large s

⟨⟩ is the mean over all vesicles and all t. Their common motion is subtracted too. Centres must not be wrapped into a
cell; those of a result are not.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..base.arguments import refusal


class Displacements(NamedTuple):
    """The mean squared displacements `squared` (L, 2) of both components after the times `lag` (L,), 0 first."""

    lag: Float[np.ndarray, "L"]
    squared: Float[np.ndarray, "L 2"]

    def diffusivity(self, start: float = 0.5) -> Float[np.ndarray, "2"]:
        """Returns D of both components, from a line through the part after `start` times the longest lag."""
        late = self.lag >= start * self.lag[-1]
        if np.sum(late) < 2:
            raise refusal("start", start, "a fraction that leaves two or more lags")
        return 0.5 * np.polyfit(self.lag[late], self.squared[late], 1)[0]


def mean_squared_displacement(t, centers, *, gradient=None, longest: float = 0.5) -> Displacements:
    """Returns the mean squared displacements of centres.

    Args:
        t: equally spaced times, (T,).
        centers: centres (T, M, 2) of two or more vesicles.
        gradient: Γ (2, 2), the derivative of component i by coordinate j at [i, j]; by default nothing is subtracted.
        longest: the longest lag over the time from first to last row. Longer lags have few independent samples.

    Raises:
        ValueError: an argument does not have the right form.
    """
    t, x = np.asarray(t, dtype=float), np.asarray(centers, dtype=float)
    if t.ndim != 1 or len(t) < 3 or not np.allclose(np.diff(t), t[1] - t[0], rtol=1e-6) or t[1] <= t[0]:
        raise refusal("t", t, "three or more equally spaced times")
    if x.ndim != 3 or x.shape[0] != len(t) or x.shape[1] < 2 or x.shape[2] != 2:
        raise refusal("centers", x.shape, "centres (T, M, 2) of two or more vesicles")
    if not 0 < longest <= 1:
        raise refusal("longest", longest, "a fraction > 0 and <= 1")
    if gradient is not None:
        carried = x @ np.asarray(gradient, dtype=float).T
        steps = 0.5 * (carried[1:] + carried[:-1]) * np.diff(t)[:, None, None]
        x = x - np.concatenate([np.zeros((1, *x.shape[1:])), np.cumsum(steps, axis=0)])
    x = x - np.mean(x, axis=1, keepdims=True)
    lags = np.arange(int(longest * (len(t) - 1)) + 1)
    squared = [np.mean((x[lag:] - x[: len(t) - lag]) ** 2, axis=(0, 1)) for lag in lags]
    return Displacements(lags * (t[1] - t[0]), np.array(squared))
