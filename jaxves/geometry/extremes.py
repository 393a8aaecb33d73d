r"""Maxima and minima over a membrane, and least distances, of the trigonometric interpolant of the nodes.

The largest value at N nodes can be 1 % below the maximum between them for N = 32 to 96. Extremes are therefore computed
between the samples of a finer grid. The search starts at the largest sample of each of several parts of the membrane,
because the largest sample of all need not be next to the largest maximum.

The result is the value of the interpolant at the place that Newton's method finds. Derivatives ignore how this place
depends on the function, except in one last Newton step. At a stationary place this does not change the first
derivative, and the last step makes the second derivative correct. If two extremes are equal, the derivative is that of
one of them.

Every run compiles this at least twice, so the code uses few operations on small arrays.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..numerics import fourier
from ..numerics.arrays import Nodes, Scalar, staged
from . import curve as geometry
from .curve import Curve

_FINER = 4  # samples per node for functions on one membrane
_PARTS = 8  # parts of a membrane, each with its own search
_ZOOM = np.linspace(-0.5, 0.5, 9)  # places near a sample, in units of the sample spacing
_DEGREE = 5  # degree of the Taylor polynomial at each such place; mode N/2 has a relative error of 2e-11
_REACH = 0.1  # largest distance from such a place, in units of the sample spacing
_FLAT = 1e-10  # relative height over one spacing below which a maximum is round-off

_FINER_PAIRS = 2  # samples per node for distances, whose number grows with the square of the samples,
_MOST_SAMPLES = 2048  # up to this number; more nodes are samples themselves
_PARTS_PAIRS = 4
_ROUNDS = 5  # Newton steps; the error starts below one sample spacing, and each step squares it
_CONVERGED = 1e-3  # the last step to a stationary place is much shorter than this many spacings


def _tops(f: Float[Array, "*rest K"]) -> tuple[Float[Array, "*rest K"], Float[Array, "*rest K"]]:
    """Returns the vertices of parabolas through three neighbouring samples, at local maxima along the last axis.

    The first result is the place, relative to each sample, in units of the sample spacing. The second is the height. It
    is -inf where a sample is not a local maximum. Next to an infinite sample it is the height of the sample itself.
    """
    left, right = jnp.roll(f, 1, axis=-1), jnp.roll(f, -1, axis=-1)
    slope, bend = 0.5 * (right - left), 2 * f - left - right
    curved = (bend > 0) & (bend < jnp.inf)
    shift = jnp.where(curved, slope, 0.0) / jnp.where(curved, bend, 1.0)
    rise = 0.5 * jnp.where(curved, bend, 0.0) * shift**2
    return shift, jnp.where((f >= left) & (f >= right), f + rise, -jnp.inf)


@functools.cache
def _about(K: int) -> np.ndarray:
    """Returns the matrix from K periodic samples to Taylor coefficients at the places `_ZOOM` near the first sample.

    Its shape is (K, places · (degree + 1)). Coefficients refer to places in units of the sample spacing.
    """
    k = 2 * np.pi / K * fourier.wavenumbers(K)
    symbols = [
        (1j * k) ** m * np.exp(1j * k * place) / math.factorial(m) for place in _ZOOM for m in range(_DEGREE + 1)
    ]
    rows = np.fft.irfft(np.array(symbols), K)
    return rows[:, -np.arange(K) % K].T


def _derivative(polynomial: Float[Array, "n"]) -> Float[Array, "m"]:
    """Returns the coefficients of the derivative of a polynomial, the highest power first."""
    return polynomial[:-1] * np.arange(len(polynomial) - 1.0, 0.0, -1.0)


def greatest(f: Float[Array, "K"]) -> Scalar:
    """Returns the maximum of the trigonometric interpolant of the samples f.

    K must be four times the number of nodes that resolve f.
    """
    K = f.shape[0]
    _, top = _tops(jax.lax.stop_gradient(f))
    part = K // _PARTS
    node = jnp.argmax(top.reshape(_PARTS, part), axis=1) + part * np.arange(_PARTS)
    window = f[(node[:, None] + np.arange(K)) % K]
    about = (window @ staged(_about(K))).reshape(-1, _DEGREE + 1)
    polynomial = about[jnp.argmax(jax.lax.stop_gradient(about[:, 0]))][::-1]
    fixed = jax.lax.stop_gradient(polynomial)
    flat = _FLAT * jnp.max(jnp.abs(jax.lax.stop_gradient(f)))

    def step(s, polynomial):
        bend = -jnp.polyval(_derivative(_derivative(fixed)), s)
        slope = jnp.polyval(_derivative(polynomial), s)
        return jnp.where(bend > flat, slope, 0.0) / jnp.where(bend > flat, bend, 1.0)

    s = jnp.zeros(())
    for _ in range(3):
        s = jnp.clip(s + step(s, fixed), -_REACH, _REACH)
    last = step(s, polynomial)
    return jnp.polyval(polynomial, s + jnp.where(jnp.abs(last) < _CONVERGED, last, 0.0))


def over_membrane(curve: Curve, sigma: Nodes, bending: Scalar, V_m: Nodes | None) -> dict[str, Scalar]:
    """Extremes of the physical tension and the curvature and, given V_m, of |V_m|, by the names of the diagnostics.

    Tension and curvature are formed on the finer grid from x, its derivatives and σ: at the nodes they would alias.
    """
    d1 = fourier.derivative(curve.x, axis=0)
    columns = [d1, fourier.derivative(d1, axis=0), sigma[:, None], *([] if V_m is None else [V_m[:, None]])]
    x, y, xx, yy, sigma, *rest = fourier.resample(jnp.concatenate(columns, axis=1), _FINER * len(sigma), axis=0).T
    curvature = (x * yy - y * xx) / jnp.sqrt(x**2 + y**2) ** 3
    samples = jnp.stack([sigma + 1.5 * bending * curvature**2, curvature, *rest])
    high, low = jax.vmap(jax.vmap(greatest))(jnp.stack([samples, -samples]))
    size = jnp.maximum(high, low)
    found = {"tension_min": -low[0], "tension_max": high[0], "max_curvature": size[1]}
    return found if V_m is None else found | {"max_V_m": size[2]}


def _nearest(r2: Float[Array, "K K"]) -> Float[Array, "P 2"]:
    """Places (i, j), in spacings, near the least local minima of r2[i, j]; excluded pairs are infinite."""
    K, n = r2.shape[0], _PARTS_PAIRS
    # The nearest point of the other curve can lie between two of its samples.
    shift, top = _tops(-r2)
    parts = jnp.swapaxes(top.reshape(n, K // n, n, K // n), 1, 2).reshape(n * n, -1)
    part, within = np.divmod(np.arange(n * n), n), jnp.divmod(jnp.argmax(parts, axis=1), K // n)
    i, j = (part[m] * (K // n) + within[m] for m in (0, 1))
    return jnp.stack([i, j + shift[i, j]], axis=1)


def _jets(x: Float[Array, "N 2"]) -> tuple[Float[Array, "k 6"], Float[Array, "k 6"]]:
    """Returns the Fourier coefficients of x and of its first two derivatives."""
    cosine, sine = fourier.coefficients(x)
    k = fourier.wavenumbers(x.shape[0])[:, None]
    return tuple(jnp.concatenate([f, k * df, -(k**2) * f], axis=1) for f, df in ((cosine, sine), (sine, -cosine)))


def _newton(z: Float[Array, "2"], on_edge, jets, perimeter):
    """Makes one Newton step towards a chord of stationary length between the places z.

    With `on_edge`, the chord is stationary among the chords that are half as long as the membrane between their ends.
    The step is differentiable in its equations, and zero where they are singular.

    Returns the squared length of the chord before the step, the step, and the change of the squared length.
    """
    ends = jax.vmap(fourier.series)(jets, z[:, None]).reshape(2, 3, 2) * np.array([1.0, -1.0])[:, None, None]
    chord, d1 = ends[0, 0] + ends[1, 0], ends[:, 1]
    square, slope = chord @ chord, d1 @ chord  # the slope of half the square
    bend = d1 @ d1.T + jnp.diag(ends[:, 2] @ chord)
    residual, derivatives = slope, bend
    if perimeter is not None:
        speed = perimeter / (2 * np.pi)
        length = speed * (z[1] - z[0])
        at_edge = jnp.stack([2 * square - 0.5 * length**2, slope[0] + slope[1]])
        longer = length * speed * np.array([-1.0, 1.0])
        residual = jnp.where(on_edge, at_edge, slope)
        derivatives = jnp.where(on_edge, jnp.stack([4 * slope - longer, bend[0] + bend[1]]), bend)
    (p, q), ((a, b), (c, d)) = residual, jax.lax.stop_gradient(derivatives)
    det = a * d - b * c
    regular = jnp.abs(det) > _FLAT * (jnp.abs(a * d) + jnp.abs(b * c))
    step = jnp.where(regular, jnp.stack([b * q - d * p, c * p - a * q]), 0.0) / jnp.where(regular, det, 1.0)
    return square, step, 2 * slope @ step + step @ bend @ step


def _least(start: Float[Array, "P 2"], on_edge, jets, spacing: float, counts, perimeter=None) -> Scalar:
    """Returns the length of the shortest chord among the starts and the stationary chords near them.

    `counts(z, on_edge, square)` returns whether a chord is allowed. The result is infinite if no chord is.
    """
    fixed = jax.lax.stop_gradient((jets, perimeter))
    newton = jax.vmap(_newton, in_axes=(0, 0, None, None))

    def approach(_, z):
        return z + jnp.clip(newton(z, on_edge, *fixed)[1], -spacing, spacing)

    z = jnp.concatenate([start, jax.lax.fori_loop(0, _ROUNDS, approach, start)])
    on_edge = jnp.concatenate([on_edge, on_edge])
    square, step, change = newton(z, on_edge, jets, perimeter)
    square = square + jnp.where(jnp.max(jnp.abs(step), axis=1) < _CONVERGED * spacing, change, 0.0)
    found = jax.lax.stop_gradient(jnp.where(counts(z, on_edge, square), square, jnp.inf))
    best = jnp.argmin(found)
    positive = (found[best] > 0) & (found[best] < jnp.inf)
    # At zero length the derivative is set to zero; it would be NaN.
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, square[best], 1.0)), found[best])


def _samples(curve: Curve) -> Float[Array, "K 2"]:
    N = curve.x.shape[0]
    return fourier.resample(jax.lax.stop_gradient(curve.x), max(N, min(_FINER_PAIRS * N, _MOST_SAMPLES)), axis=0)


def _distances2(x: Float[Array, "K 2"], y: Float[Array, "L 2"]) -> Float[Array, "K L"]:
    return (x[:, None, 0] - y[:, 0]) ** 2 + (x[:, None, 1] - y[:, 1]) ** 2


def gap(first: Curve, second: Curve) -> Scalar:
    """Returns the least distance between two curves with the same number of nodes; twice differentiable."""
    r2 = _distances2(_samples(first), _samples(second))
    spacing = 2 * np.pi / len(r2)
    start = _nearest(r2) * spacing
    jets = jax.vmap(_jets)(jnp.stack([first.x, second.x]))
    return _least(start, np.zeros(len(start), bool), jets, spacing, lambda z, on_edge, square: square >= 0)


def self_gap(curve: Curve) -> Scalar:
    """Returns the length of the shortest chord across a neck, a fold or the body; infinite for a nearly round curve.

    A chord is considered if the membrane between its ends is at least twice as long, assuming evenly spaced nodes. The
    shortest chord is either a local minimum, as in a neck, or one for which this ratio is exactly two, as near the tips
    of an ellipse. In the second case only its first derivative is correct.
    """
    x, perimeter = _samples(curve), geometry.length(curve)
    K, whole = len(x), jax.lax.stop_gradient(perimeter)
    spacing = 2 * np.pi / K
    steps = np.arange(K)
    apart = fourier.spread(np.minimum(steps, K - steps).astype(float))
    r2 = _distances2(x, x)
    same = 2 * whole**2 * fourier.spread((steps == 0).astype(float))
    r2 = jnp.where((apart * (whole / K)) ** 2 >= 4 * r2 + same, r2, jnp.inf)

    def counts(z, on_edge, square):
        length = jnp.abs(z[:, 1] - z[:, 0]) * (whole / (2 * np.pi))
        length = jnp.minimum(length, whole - length)
        # Chords much shorter than the shortest one between samples connect a place with itself.
        return (square > 0.25 * jnp.min(r2)) & (length**2 >= (4 - _FLAT * on_edge) * square)

    i, j = _nearest(r2).T
    ahead = (j - i) % K
    back = ahead > K / 2  # then the shorter way leads from the second end to the first
    start = jnp.where(back, jnp.stack([j, j + (K - ahead)]), jnp.stack([i, i + ahead])).T * spacing
    start, on_edge = jnp.tile(start, (2, 1)), np.arange(2 * len(start)) < len(start)
    jets = jax.tree.map(lambda modes: jnp.stack([modes, modes]), _jets(curve.x))
    return _least(start, on_edge, jets, spacing, counts, perimeter)
