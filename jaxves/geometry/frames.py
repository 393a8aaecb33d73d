r"""Outlines from a microscope: a film of smooth curves with their noise, by `read_frames`.

Points are fitted by curves with the same number of Fourier modes in all frames (`outline_fit`). `frame_modes` chooses
it unless the caller states it. What is left between points and curve is noise. It displaces the curve along its normal:

    δ(t) = Σ_{k ≤ modes} (a_k cos kt + b_k sin kt),   covariance of (a_0, a_1, b_1, …) = S (BᵀB)⁻¹

with t proportional to arc length and B the cosines and sines at the feet of the points. S is the noise in these modes
as a variance per point. If the errors of neighbouring points are correlated, as for contours of blurred images, S is
larger than the variance σ² of the points. The standard errors are then still those of the curve.
"""

import dataclasses
import itertools
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

import jaxves

from ..base.arguments import refusal, require, require_count
from ..base.bounds import POSITIVE
from ..numerics.arrays import ScalarLike
from . import outline_fit, outlines
from .frame_files import OutlineInFrame, read_outlines
from .frame_measures import Measure, Measures, basis, measures
from .frame_modes import FEWEST, SPARE, detail
from .outlines import OutlineNoise

_SAMPLES = 128  # of the curve of a frame, at least; more for more than 32 modes
_ODD = 2.0  # a frame whose points scatter more than this times the others is reported


@dataclasses.dataclass(frozen=True, eq=False)
class Frames:
    """Smooth outlines of one vesicle at several times, with their noise. Lengths are in pixels, y points upwards.

    `radius` (L/2π, in the unit of `pixel`) and `reduced_area` are means over the frames with their standard errors.
    Noise lengthens a curve and makes it seem less round; perimeters and reduced areas are corrected for that.
    """

    pixel: float  # size of a pixel, in any unit of length
    interval: float  # time between frames, s
    numbers: Int[np.ndarray, "T"]  # of the frames in the file
    start: int  # number of the frame at t = 0
    modes: int  # number of Fourier modes of the curves
    points: tuple[Float[np.ndarray, "_ 2"], ...]  # of each frame, counter-clockwise
    curves: Float[np.ndarray, "T n 2"]  # equispaced in arc length
    covariance: Float[np.ndarray, "T C C"]  # of the normal displacement of the curves by modes (a_0, a_1, b_1, …)
    offsets: Float[np.ndarray, "T C"]  # mean depths of the points inside the curves by the same modes, almost zero
    noise: float  # standard deviation of the points along the normal
    correlation: float  # S/σ²: 1 if the errors of neighbouring points are independent
    measures: Measures  # of each frame

    @property
    def times(self) -> Float[np.ndarray, "T"]:
        """Times of the frames in s; 0 at the frame `start`."""
        return (self.numbers - self.start) * self.interval

    @property
    def radius(self) -> Measure:
        """The radius a = L/2π in the unit of `pixel`, with its standard error."""
        return self.measures.length.mean(self.pixel / (2 * np.pi))

    @property
    def reduced_area(self) -> Measure:
        """The reduced area Δ = 4πA/L² with its standard error."""
        return self.measures.reduced_area.mean()

    @property
    def noise_in_radii(self) -> float:
        """The noise of the points in units of the radius a."""
        return self.noise * self.pixel / self.radius.value

    @property
    def standard_error(self) -> Float[np.ndarray, "T C"]:
        """The standard errors of the modes (a_0, a_1, b_1, …) of the curves."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def __repr__(self) -> str:
        T, a, area = len(self.numbers), self.radius, self.reduced_area
        return (
            f"<Frames: {T} outline{'s' * (T > 1)} to t = {self.times[-1]:.4g} s, {self.modes} modes, "
            f"noise {self.noise:.2g} px = {self.noise_in_radii:.1%} of a, "
            f"a = {a.value:.5g} ± {a.error:.1g}, reduced area {area.value:.5g} ± {area.error:.1g}>"
        )

    def plot(self, **how: Any) -> Any:
        """Draws points and curves of some frames, and the reduced area over time; returns the figure."""
        return jaxves.plots.outlines(self, **how)


def read_frames(
    path: str | os.PathLike,
    *,
    pixel: ScalarLike,
    interval: ScalarLike,
    flip_y: bool = True,
    modes: int | None = None,
    columns: str = "xy",
    start: int | None = None,
) -> Frames:
    """Reads the outlines of one vesicle at several times and fits smooth curves to their points.

    Args:
        path: a file as `frame_files` describes: text with a frame column or blank lines, .npy, .npz or .json.
        pixel: size of a pixel, in the unit of length that results have, such as µm.
        interval: time between frames, in s. Frames may be missing; then their numbers have gaps.
        flip_y: whether y points downwards in the file, as in images.
        modes: number of Fourier modes of the curves; by default those that exceed the noise (`frame_modes`).
        columns: "xy", or "yx" for rows before columns, as `find_contours` of scikit-image writes them.
        start: number of the frame at t = 0, such as the first one with the field on. Frames before it are left out. By
            default it is the first frame.

    Raises:
        ValueError: an argument is out of its bounds, or the file cannot be used. The message says what to change.
    """
    for name, value in {"pixel": pixel, "interval": interval}.items():
        require(name, value, POSITIVE)
    if modes is not None:
        require_count("modes", modes)
    if columns not in ("xy", "yx"):
        raise refusal("columns", repr(columns), "'xy' or 'yx'")
    try:
        found = read_outlines(Path(path))
        first = found[0].number if start is None else start
        found = [outline for outline in found if outline.number >= first]
        if not found:
            raise ValueError(f"frames from start = {first} on, but there are none")
        turned = [_upright(outline, columns, flip_y) for outline in found]
        return _fitted(turned, float(pixel), float(interval), int(first), modes)
    except ValueError as error:
        raise ValueError(f"{path}: expected {error}.") from None


def _upright(outline: OutlineInFrame, columns: str, flip_y: bool) -> OutlineInFrame:
    points = outline.points[:, ::-1] if columns == "yx" else outline.points
    return outline._replace(points=points * [1.0, -1.0 if flip_y else 1.0])


def _fitted(found: Sequence[OutlineInFrame], pixel, interval, start, modes) -> Frames:
    numbers = [outline.number for outline in found]
    _check_count(found, FEWEST, "take more points")
    if modes is not None:
        _check_count(found, SPARE * (2 * modes + 1), f"state fewer `modes` than {modes}")
    checked = [_prepared(outline, modes or 1) for outline in found]
    modes, density = detail(checked, modes)
    # A mode below the noise of a frame still makes the curve longer, by an amount that many frames together show.
    # Therefore noise and measures are those of curves with twice the modes.
    fits, finer = (
        [_fit(points, min(most, (len(points) // SPARE - 1) // 2)) for points in checked] for most in (modes, 2 * modes)
    )
    for number, fit in zip(numbers, fits, strict=True):
        if (crossed := outlines.crossing(fit.samples)) is not None:
            place = "({:.5g}, {:.5g})".format(*crossed.place)
            raise ValueError(f"outlines that do not cross themselves, as that of frame {number} does near {place}")
    each = np.array([fit.deviation for fit in finer])
    _report_odd(each, numbers)
    noise = float(np.sqrt(np.mean(each**2)))
    return Frames(
        pixel, interval, np.array(numbers), start, modes, tuple(checked), np.array([fit.samples for fit in fits]),
        np.array([density * fit.unit for fit in fits]), np.array([fit.offset for fit in fits]), noise,
        density / noise**2,
        measures([fit.samples for fit in finer], [density * fit.unit for fit in finer]),
    )  # fmt: skip


class _Fit(NamedTuple):
    samples: Float[np.ndarray, "n 2"]
    deviation: float
    offset: Float[np.ndarray, "C"]  # depth of the points inside the curve by modes
    unit: Float[np.ndarray, "C C"]  # covariance of the normal displacement for noise of one pixel


def _fit(points: Float[np.ndarray, "K 2"], modes: int) -> _Fit:
    fit = outline_fit.fitted(points, modes, max(_SAMPLES, 4 * modes))
    B = basis(fit.feet, modes)
    unit = np.linalg.inv(B.T @ B)
    return _Fit(fit.samples, fit.deviation, unit @ (B.T @ fit.inside), unit)


def _check_count(found: Sequence[OutlineInFrame], least: int, advice: str) -> None:
    for number, points, _ in found:
        if len(points) < least:
            raise ValueError(f"at least {least} points in each frame, not {len(points)} in frame {number}: {advice}")


def _prepared(outline: OutlineInFrame, modes: int) -> Float[np.ndarray, "_ 2"]:
    """Returns the points of a frame in counter-clockwise order, without repeated ones."""
    try:
        return outlines.prepared(outline.points, modes, outline.lines).points
    except ValueError as error:
        raise ValueError(f"{error} (frame {outline.number})") from None


def _report_odd(each: Float[np.ndarray, "T"], numbers: list[int]) -> None:
    """Warns about the frames whose points scatter much more than those of the others."""
    usual = float(np.median(each))
    odd = [number for number, deviation in zip(numbers, each, strict=True) if deviation > _ODD * usual]
    if odd:
        named = ", ".join(str(number) for number in itertools.islice(odd, 5)) + (", …" if len(odd) > 5 else "")
        warnings.warn(
            f"points scatter by more than {_ODD:g} times the usual {usual:.2g} px in frame {named}: check these "
            "outlines, or state more `modes`",
            OutlineNoise,
            stacklevel=4,
        )
