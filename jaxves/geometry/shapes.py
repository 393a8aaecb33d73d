r"""Starting shapes: closed curves with nodes equispaced in arc length.

The perimeter of a shape is 2π·`length`, so length 1 is the paper's unit a = L/2π. An ellipse depends smoothly on its
reduced area Δ for Δ < 1. As Δ → 1, ∂x/∂Δ diverges like 1/√(1-Δ).
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import lax
from jaxtyping import Array, ArrayLike, Float, Int

from ..base.arguments import is_known, refusal, require, require_count, require_nodes
from ..base.bounds import Bounds
from ..base.physical_numbers import ANGLE, DISTURBANCE, LENGTH, REDUCED_AREA, TEMPERATURE, TENSION
from ..base.resolution import kept_modes
from ..numerics import fourier
from ..numerics.arrays import NodePoints, Scalar, ScalarLike, as_float
from . import curve, outlines

Seed = int | Int[Array, ""]
_FINE = 512  # samples of an ellipse from which its nodes are interpolated: 12 digits down to Δ = 0.2


def circle(N: int, *, length: ScalarLike = LENGTH.default) -> NodePoints:
    """Returns N nodes (N, 2) on a circle of radius `length`, counter-clockwise, the first on the x axis.

    Raises:
        ValueError: N is not an even number of at least 4, or a known `length` is not positive.
    """
    require_nodes("N", N)
    require("length", length, LENGTH.bounds)
    alpha = fourier.grid(N)
    return as_float(length) * jnp.stack([jnp.cos(alpha), jnp.sin(alpha)], axis=-1)


_FLATTEST = 1e-3  # b/a
_SAME_ROUNDNESS = 1e-10  # area/perimeter², before and after undulations
_EXCESS = Bounds("a number in [-0.89, 0.89]", ge=-0.89, le=0.89)


def _root(residual: Callable[[Scalar], Scalar], solver: optx.AbstractRootFinder, guess: Scalar, **how) -> Scalar:
    """Returns the root of `residual`, which is differentiated implicitly.

    The derivative rule is that of JAX. The rule of Optimistix checks its linear solve with a callback, and JAX does not
    keep programs with callbacks in its compilation cache.
    """

    def solve(residual, guess):
        return optx.root_find(lambda x, _: residual(x), solver, guess, throw=False, **how).value

    return lax.custom_root(residual, guess, solve, lambda slope, y: y / slope(jnp.ones_like(y)))


def _unit_ellipse(ratio: Scalar, N: int) -> NodePoints:
    alpha = fourier.grid(N)
    return jnp.stack([jnp.cos(alpha), ratio * jnp.sin(alpha)], axis=-1)


def _aspect_ratio(reduced_area: Scalar) -> Scalar:
    """Returns b/a of the ellipse with 4πA/L² = `reduced_area`, or NaN if there is none; differentiated implicitly."""
    alpha = fourier.grid(_FINE)

    def area(ratio):
        length = 2 * jnp.pi * jnp.mean(jnp.sqrt(jnp.sin(alpha) ** 2 + (ratio * jnp.cos(alpha)) ** 2))
        return 4 * jnp.pi**2 * ratio / length**2

    # `flip=False` states that the residual increases. Otherwise Optimistix finds out with a callback (see `_root`).
    solver = optx.Bisection(rtol=1e-15, atol=1e-15, flip=False)
    at_circle = reduced_area >= 1.0
    # A bisection needs a change of sign in its bracket. A circle is an end point of the bracket, so it is not searched.
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
    length: ScalarLike = LENGTH.default,
) -> NodePoints:
    """Returns N nodes (N, 2) on an ellipse with reduced area Δ in (0, 1] and perimeter 2π·`length`.

    The major axis is at `angle` radians from the x axis. The nodes are differentiable in all three numbers, in Δ for
    Δ < 1. Below Δ = 0.0026 the two sides would touch; for a traced Δ below this value the nodes are NaN.

    Raises:
        ValueError: N is not an even number of at least 4, or a known number is out of its bounds.
    """
    require("reduced_area", reduced_area, REDUCED_AREA.bounds)
    _check_ellipse(N, angle, length)
    x = _ellipse(N, reduced_area, angle, length)
    if is_known(x) and not np.all(np.isfinite(np.asarray(x))):
        raise refusal("reduced_area", reduced_area, "a number in [0.0026, 1]: the sides of a flatter ellipse touch")
    return x


def _check_ellipse(N: int, angle: ScalarLike, length: ScalarLike) -> None:
    require_nodes("N", N)
    require("angle", angle, ANGLE.bounds)
    require("length", length, LENGTH.bounds)


@functools.partial(jax.jit, static_argnames="N")
def _ellipse(N: int, reduced_area: ScalarLike, angle: ScalarLike, length: ScalarLike) -> NodePoints:
    ratio = _aspect_ratio(as_float(reduced_area))
    x = equispaced(_unit_ellipse(ratio, _FINE), N)
    return rotated(scaled(x, length), angle)


_PERIMETER = np.cumprod((1.5 - np.arange(1, 80)) / np.arange(1, 80)) ** 2  # binomial(1/2, k)², k = 1, 2, …


def _flattening(excess: Scalar) -> Scalar:
    """Returns n = (a - b)/(a + b) of the ellipse with Δ = 1 - excess², a smooth and odd function of `excess`.

    The perimeter is π(a + b) F(n²) with F(m) = Σ binomial(1/2, k)² m^k. Hence Δ = (1 - m)/F² with m = n². With
    F = 1 + m P this gives excess = n √(1 + P (F + 1)) / F, in which the square root never vanishes.
    """

    def residual(n):
        m = n**2
        P = jnp.polyval(jnp.asarray(_PERIMETER[::-1]), m)
        F = 1 + m * P
        return n * jnp.sqrt(1 + P * (F + 1)) / F - excess

    return _root(residual, optx.Newton(rtol=1e-14, atol=1e-15), excess / jnp.sqrt(1.5), max_steps=24)


def ellipse_of_excess(
    N: int, excess: ScalarLike, *, angle: ScalarLike = 0.0, length: ScalarLike = LENGTH.default
) -> NodePoints:
    """Returns N nodes (N, 2) on an ellipse with reduced area Δ = 1 - excess².

    The nodes are a smooth function of the excess also at the circle, excess = 0, where ∂x/∂Δ is infinite. They agree
    with those of `ellipse`. With a negative excess the major axis is perpendicular to `angle`. |excess| is at most
    0.89, which is Δ > 0.2.

    Raises:
        ValueError: N is not an even number of at least 4, or a known number is out of its bounds.
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
    """Returns the nodes x moved along their normal by amplitude · (sin 2α + cos 3α + sin 3α).

    This breaks every symmetry of an ellipse. A vesicle that starts symmetric stays symmetric (`equation/symmetry.py`);
    an amplitude such as 1e-6 shows whether its motion is unstable. The nodes also move along the curve, so that their
    spacing stays even up to terms of the order of the amplitude squared. Area and perimeter change in the same order.

    Raises:
        ValueError: x does not have the shape (N, 2), or a known `amplitude` is not finite.
    """
    if np.ndim(x) != 2 or np.shape(x)[1] != 2:
        raise ValueError(f"x must have shape (N, 2), but has {np.shape(x)}.")
    require("amplitude", amplitude, DISTURBANCE.bounds)
    alpha = fourier.grid(x.shape[0])
    wave = jnp.sin(2 * alpha) + jnp.cos(3 * alpha) + jnp.sin(3 * alpha)
    outline = curve.Curve.from_nodes(x)
    # The normal motion stretches the curve by κ times the wave. The tangential motion compensates for that.
    stretch = outline.curvature * outline.speed * wave
    along = -fourier.antiderivative(stretch)
    return x + as_float(amplitude) * (wave[:, None] * outline.normal + along[:, None] * outline.tangent)


def undulation(k, temperature: ScalarLike, tension: ScalarLike):
    """Returns ⟨|u_k|²⟩ of the undulations r = 1 + Σ u_k e^{ikφ} in a section of a membrane of radius 1.

    It is θ/(4πλ) (1/k - 1/√(k² + λ)) with the `temperature` θ = k_B T/κ_B and the `tension` λ in κ_B/a², which becomes
    θ/(8πk³) without tension. This is the spectrum of a plane membrane in three dimensions, integrated over the waves
    across the section.
    """
    root = jnp.sqrt(k**2 + as_float(tension))
    return as_float(temperature) / (4 * np.pi) / (k * root * (k + root))


def undulated(
    x: NodePoints, *, temperature: ScalarLike, modes: int, tension: ScalarLike = TENSION.default, seed: Seed = 1
) -> NodePoints:
    """Returns the nodes x moved along their normal by random thermal undulations, with area and perimeter unchanged.

    The modes k = 2 … `modes` of the arc length have independent normal amplitudes with the variance of `undulation`.
    Each mode has its own random numbers, so that the shape does not depend on the number of nodes. The length that the
    undulations take makes the rest of the shape rounder: the outline is moved outwards and scaled.

    Raises:
        ValueError: x has no even number of nodes, a known number is out of its bounds, or there are more modes than the
            nodes resolve, or the undulations need more length than the shape has. For traced numbers the nodes are then
            NaN.
    """
    require_nodes("len(x)", x.shape[0])
    require("temperature", temperature, TEMPERATURE.bounds)
    require("tension", tension, TENSION.bounds)
    require_count("modes", modes)
    N = x.shape[0]
    if modes > kept_modes(N):
        raise refusal("modes", modes, f"at most {kept_modes(N)} modes for {N} nodes")
    base, k = curve.Curve.from_nodes(x), np.arange(2, modes + 1)
    random = jax.vmap(lambda k: jax.random.normal(jax.random.fold_in(jax.random.key(seed), k), (2,)))(k)
    size = jnp.sqrt(2 * undulation(k, temperature, tension))[:, None] * random
    phase = fourier.grid(N)[:, None] * k
    wave = jnp.cos(phase) @ size[:, 0] + jnp.sin(phase) @ size[:, 1]
    outline = x + (jnp.mean(base.speed) * wave)[:, None] * base.normal
    roundness = curve.area(base) / curve.length(base) ** 2

    def residual(shift):
        moved = curve.Curve.from_nodes(outline + shift * base.normal)
        return curve.area(moved) / curve.length(moved) ** 2 - roundness

    shift = _root(residual, optx.Newton(rtol=1e-13, atol=1e-14), jnp.zeros(()), max_steps=16)
    x = scaled(equispaced(outline + shift * base.normal, N), jnp.mean(base.speed))
    x = jnp.where(jnp.abs(residual(shift)) < _SAME_ROUNDNESS, x, jnp.nan)
    if is_known(x) and not np.all(np.isfinite(np.asarray(x))):
        raise refusal("temperature", temperature, "less: the undulations need more length than the shape has")
    return x


def through_points(points: ArrayLike, N: int, *, length: float = 1.0, modes: int | None = None) -> NodePoints:
    """Returns N nodes (N, 2) on a smooth closed curve through `points` (K, 2), which are given in order.

    Clockwise points are reversed. Exact points are joined by a periodic quintic spline over chord length. Noisy points
    are replaced by the best curve with `modes` Fourier modes. Without `modes` their number is chosen from the noise of
    the points, with a warning (`outlines.OutlineNoise`). The curve is not differentiable in the points; take
    derivatives with respect to the returned nodes.

    Raises:
        ValueError: the points do not have the shape (K, 2), are too few, are not finite or coincide, or their curve
            crosses itself; or a known number is out of its bounds.
    """
    require_nodes("N", N)
    require("length", length, LENGTH.bounds)
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
    """Returns N nodes equispaced in arc length on the trigonometric interpolant of `x`, starting at its first node."""
    return fourier.evaluate(x, equispaced_parameters(x, N))


def equispaced_parameters(x: Float[Array, "K 2"], N: int) -> Float[Array, "N"]:
    """Returns the parameters α of the nodes that `equispaced` returns."""
    K = x.shape[0]
    speed = curve.Curve.from_nodes(x).speed
    total = jnp.mean(speed)
    # s(α) = mean(speed) α + a periodic part, which is integrated mode by mode
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
    """Returns x scaled about the origin to the perimeter 2π·`length`."""
    return x * (2 * jnp.pi * as_float(length) / curve.length(curve.Curve.from_nodes(x)))


def rotated(x: NodePoints, angle: ScalarLike) -> NodePoints:
    """Returns x rotated about the origin by `angle` radians, counter-clockwise."""
    c, s = jnp.cos(as_float(angle)), jnp.sin(as_float(angle))
    return x @ jnp.stack([jnp.stack([c, s]), jnp.stack([-s, c])])
