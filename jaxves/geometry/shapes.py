r"""Starting shapes: closed curves with nodes equispaced in arc length.

Shapes have perimeter 2π·`length`, so length 1 is the paper's unit a = L/2π. The dependence of an
ellipse on its reduced area Δ is smooth for Δ < 1; at Δ = 1, ∂x/∂Δ is infinite like 1/√(1-Δ).
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import lax
from jaxtyping import Array, ArrayLike, Float

from ..base.arguments import is_known, refusal, require, require_count, require_nodes
from ..base.bounds import FINITE, POSITIVE, REDUCED_AREA, Bounds
from ..numerics import fourier
from ..numerics.arrays import NodePoints, Scalar, ScalarLike, as_float
from . import curve, outlines

_FINE = 512  # samples of an ellipse before its nodes are chosen: 12 digits down to Δ = 0.2


def circle(N: int, *, length: ScalarLike = 1.0) -> NodePoints:
    """Radius `length`, first node on the x axis, counter-clockwise.

    Raises:
        ValueError: N is no even number of nodes, or `length` is known not to be positive.
    """
    require_nodes("N", N)
    require("length", length, POSITIVE)
    alpha = fourier.grid(N)
    return as_float(length) * jnp.stack([jnp.cos(alpha), jnp.sin(alpha)], axis=-1)


_FLATTEST = 1e-3  # b/a
_EXCESS = Bounds("a number in [-0.89, 0.89]", ge=-0.89, le=0.89)


def _root(residual: Callable[[Scalar], Scalar], solver: optx.AbstractRootFinder, guess: Scalar, **how) -> Scalar:
    """Where the residual vanishes; differentiates implicitly in what it closes over.

    The derivative is JAX's: Optimistix's own checks its linear solve by a callback, and programs with callbacks are
    never kept in the cache of compiled ones.
    """

    def solve(residual, guess):
        return optx.root_find(lambda x, _: residual(x), solver, guess, throw=False, **how).value

    return lax.custom_root(residual, guess, solve, lambda slope, y: y / slope(jnp.ones_like(y)))


def _unit_ellipse(ratio: Scalar, N: int) -> NodePoints:
    alpha = fourier.grid(N)
    return jnp.stack([jnp.cos(alpha), ratio * jnp.sin(alpha)], axis=-1)


def _aspect_ratio(reduced_area: Scalar) -> Scalar:
    """b/a of the ellipse with 4πA/L² = `reduced_area`, NaN where there is none; differentiates implicitly."""
    alpha = fourier.grid(_FINE)

    def area(ratio):
        length = 2 * jnp.pi * jnp.mean(jnp.sqrt(jnp.sin(alpha) ** 2 + (ratio * jnp.cos(alpha)) ** 2))
        return 4 * jnp.pi**2 * ratio / length**2

    # Told that the residual rises: to find out takes a callback (see `_root`).
    solver = optx.Bisection(rtol=1e-15, atol=1e-15, flip=False)
    at_circle = reduced_area >= 1.0
    # The bracket of a bisection must change sign; a circle is its end point and needs no search.
    target = jnp.where(at_circle, 0.5, reduced_area)
    bracket = dict(lower=_FLATTEST, upper=1.0)
    ratio = _root(lambda ratio: area(ratio) - target, solver, as_float(0.5), max_steps=64, options=bracket)
    exists = reduced_area > area(_FLATTEST)
    return jnp.where(at_circle, 1.0, jnp.where(exists, ratio, jnp.nan))


def ellipse(
    N: int,
    reduced_area: ScalarLike,
    *,
    angle: ScalarLike = 0.0,
    length: ScalarLike = 1.0,
) -> NodePoints:
    """Ellipse of given reduced area Δ in (0, 1] and perimeter, major axis at `angle` radians from x.

    Differentiable in all three numbers (in Δ for Δ < 1). Where Δ is traced and below 0.0026, whose sides would touch,
    nodes are NaN.

    Raises:
        ValueError: N is no even number of nodes, or a known number is out of its bounds.
    """
    require("reduced_area", reduced_area, REDUCED_AREA)
    _check_ellipse(N, angle, length)
    x = _ellipse(N, reduced_area, angle, length)
    if is_known(x) and not np.all(np.isfinite(np.asarray(x))):
        raise refusal("reduced_area", reduced_area, "a number in [0.0026, 1]: the sides of a flatter ellipse touch")
    return x


def _check_ellipse(N: int, angle: ScalarLike, length: ScalarLike) -> None:
    require_nodes("N", N)
    require("angle", angle, FINITE)
    require("length", length, POSITIVE)


@functools.partial(jax.jit, static_argnames="N")
def _ellipse(N: int, reduced_area: ScalarLike, angle: ScalarLike, length: ScalarLike) -> NodePoints:
    ratio = _aspect_ratio(as_float(reduced_area))
    x = equispaced(_unit_ellipse(ratio, _FINE), N)
    return rotated(scaled(x, length), angle)


_PERIMETER = np.cumprod((1.5 - np.arange(1, 80)) / np.arange(1, 80)) ** 2  # binomial(1/2, k)², k = 1, 2, …


def _flattening(excess: Scalar) -> Scalar:
    """n = (a - b)/(a + b) of the ellipse with Δ = 1 - excess²; smooth and odd.

    Its perimeter is π(a + b) F(n²) with F(m) = Σ binomial(1/2, k)² m^k, so that Δ = (1 - m)/F² and, with
    F = 1 + m P, excess = n √(1 + P (F + 1)) / F: the square root of nothing that vanishes.
    """

    def residual(n):
        m = n**2
        P = jnp.polyval(jnp.asarray(_PERIMETER[::-1]), m)
        F = 1 + m * P
        return n * jnp.sqrt(1 + P * (F + 1)) / F - excess

    return _root(residual, optx.Newton(rtol=1e-14, atol=1e-15), excess / jnp.sqrt(1.5), max_steps=24)


def ellipse_of_excess(N: int, excess: ScalarLike, *, angle: ScalarLike = 0.0, length: ScalarLike = 1.0) -> NodePoints:
    """The ellipse of reduced area Δ = 1 - excess²: smooth through the circle, at excess 0, where ∂x/∂Δ is infinite.

    |excess| < 0.89 (Δ > 0.2). Nodes agree with those of `ellipse`; a negative excess is long across `angle`.

    Raises:
        ValueError: N is no even number of nodes, or a known number is out of its bounds.
    """
    require("excess", excess, _EXCESS)
    _check_ellipse(N, angle, length)
    return _ellipse_of_excess(N, excess, angle, length)


@functools.partial(jax.jit, static_argnames="N")
def _ellipse_of_excess(N: int, excess: ScalarLike, angle: ScalarLike, length: ScalarLike) -> NodePoints:
    n = _flattening(as_float(excess))
    x = equispaced(_unit_ellipse((1 - n) / (1 + n), _FINE), N)
    return rotated(scaled(x, length), angle)


def disturbed(x: NodePoints, amplitude: ScalarLike) -> NodePoints:
    """x moved along its normal by amplitude · (sin 2α + cos 3α + sin 3α): enough to end any symmetry of an ellipse.

    Nodes also move along the curve, so that their spacing stays even to the square of the amplitude.

    A vesicle that starts symmetric is kept so (`symmetry`): take 1e-6, say, to see what else is unstable. Area and
    perimeter change by the square of the amplitude.

    Raises:
        ValueError: x does not have the shape (N, 2), or `amplitude` is known not to be finite.
    """
    if np.ndim(x) != 2 or np.shape(x)[1] != 2:
        raise ValueError(f"x must have shape (N, 2), but has {np.shape(x)}.")
    require("amplitude", amplitude, FINITE)
    alpha = fourier.grid(x.shape[0])
    wave = jnp.sin(2 * alpha) + jnp.cos(3 * alpha) + jnp.sin(3 * alpha)
    outline = curve.Curve.from_nodes(x)
    # Along the normal the curve is stretched by κ times the wave: the nodes make up for it along the tangent.
    stretch = outline.curvature * outline.speed * wave
    along = -fourier.antiderivative(stretch)
    return x + as_float(amplitude) * (wave[:, None] * outline.normal + along[:, None] * outline.tangent)


def through_points(points: ArrayLike, N: int, *, length: float = 1.0, modes: int | None = None) -> NodePoints:
    """A smooth closed curve through points in order, as nodes; clockwise points are turned round.

    A periodic quintic spline over chord length, resampled; or, near noisy points, the curve with `modes` Fourier modes.
    Without `modes` their number is chosen from the noise of the points, with a warning (`outlines.OutlineNoise`).
    Not differentiable in the points: take derivatives with respect to the nodes it returns.

    Raises:
        ValueError: points of another shape than (K, 2), too few, not finite, coinciding, or of a curve that crosses
            itself; a known number out of its bounds.
    """
    require_nodes("N", N)
    require("length", length, POSITIVE)
    if modes is not None:
        require_count("modes", modes)
    try:
        array = np.asarray(points, dtype=float)
    except (TypeError, ValueError):
        raise refusal("points", points, "an array (K, 2) of numbers") from None
    if array.ndim != 2 or array.shape[1] != 2:
        raise ValueError(f"points must have shape (K, 2), but have {array.shape}.")
    try:
        outline = outlines.prepared(array, modes)
    except ValueError as error:
        raise ValueError(f"points of shape {array.shape}, expected {error}.") from None
    return scaled(equispaced(as_float(outlines.smooth(*outline)), N), length)


def equispaced(x: Float[Array, "K 2"], N: int) -> NodePoints:
    """N nodes equispaced in arc length on the trigonometric interpolant of `x`, from its first node on."""
    return fourier.evaluate(x, equispaced_parameters(x, N))


def equispaced_parameters(x: Float[Array, "K 2"], N: int) -> Float[Array, "N"]:
    """The parameters of the nodes that `equispaced` returns."""
    K = x.shape[0]
    speed = curve.Curve.from_nodes(x).speed
    total = jnp.mean(speed)
    # s(α) = mean(speed) α + a periodic part, integrated mode by mode
    periodic = fourier.antiderivative(speed)
    periodic = periodic - periodic[0]
    wanted = total * fourier.grid(N)
    start = jnp.interp(wanted, total * fourier.grid(K) + periodic, fourier.grid(K))

    modes = fourier.coefficients(periodic)

    def parameter(wanted, guess):
        def residual(alpha):
            return total * alpha + fourier.series(modes, alpha[None])[0] - wanted

        return _root(residual, optx.Newton(rtol=1e-14, atol=1e-14), guess, max_steps=16)

    return jax.vmap(parameter)(wanted, start)


def scaled(x: NodePoints, length: ScalarLike) -> NodePoints:
    """About the origin, to perimeter 2π·`length`."""
    return x * (2 * jnp.pi * as_float(length) / curve.length(curve.Curve.from_nodes(x)))


def rotated(x: NodePoints, angle: ScalarLike) -> NodePoints:
    """About the origin, counter-clockwise, radians."""
    c, s = jnp.cos(as_float(angle)), jnp.sin(as_float(angle))
    return x @ jnp.stack([jnp.stack([c, s]), jnp.stack([-s, c])])
