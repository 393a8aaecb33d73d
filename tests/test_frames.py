"""Outlines at several times, as contour tools write them: their noise, their modes, and unbiased measures."""

import json

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

import jaxves
from jaxves.geometry.frame_measures import basis
from jaxves.geometry.outlines import OutlineNoise

T, P, NOISE = 24, 200, 0.3
HOW = dict(pixel=0.2, interval=0.05)


def clean(K=P, start=0.0, stretch=0.0):
    """Points of an outline in pixels, clockwise where y points upwards, about equispaced in arc length."""
    t = -2 * np.pi * np.arange(4096) / 4096
    fine = np.stack([150 + (40 + stretch) * np.cos(t), 120 + (25 - stretch) * np.sin(t) + 2 * np.cos(3 * t)], axis=-1)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    wanted = (np.arange(K) + start) % K / K * (s[-1] + np.linalg.norm(fine[0] - fine[-1]))
    return np.stack([np.interp(wanted, s, fine[:, i], period=s[-1]) for i in range(2)], axis=-1)


def film(rng, frames=T, noise=NOISE, blur=0.0):
    """Noisy outlines of one shape, each beginning at another place. Blurred errors have the same size."""
    found = []
    for _ in range(frames):
        error = noise * rng.normal(size=(P, 2))
        if blur:
            error = gaussian_filter1d(error, blur, axis=0, mode="wrap") * np.sqrt(2 * blur * np.sqrt(np.pi))
        found.append(clean(start=P * rng.random()) + error)
    return np.array(found)


def exact():
    """Radius in pixels and reduced area of the outline."""
    z = clean(4000) @ [1, 1j]
    length = np.sum(np.abs(np.roll(z, -1) - z))
    return length / 2 / np.pi, 4 * np.pi * abs(np.sum(np.imag(np.conj(z) * np.roll(z, -1))) / 2) / length**2


FILM = film(np.random.default_rng(0))


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "film.npy"
    np.save(path, FILM)
    return jaxves.read_frames(path, **HOW)


# -- files ---------------------------------------------------------------------------------------------------------


def rows(form, films=FILM[:3], between=""):
    count, text = 0, ""
    for i, points in enumerate(films):
        for x, y in np.asarray(points).tolist():
            count += 1
            text += form.format(i=i, x=x, y=y, k=count) + "\n"
        text += between
    return text


WRITTEN = {
    "columns.csv": "Frame,X,Y\n" + rows("{i},{x!r},{y!r}"),
    "imagej.csv": " ,X,Y,Slice\n" + rows("{k},{x!r},{y!r},{i}"),
    "nameless.tsv": rows("{x!r}\t{y!r}\t{i}"),
    "blocks.txt": rows("{x!r} {y!r}", between="\n\n"),
    "closed.txt": "".join(rows("{x!r} {y!r}", [[*points, points[0]]]) + "\n" for points in FILM[:3]),
    "list.json": json.dumps([points.tolist() for points in FILM[:3]]),
    "contours.json": json.dumps([[points.tolist()] for points in FILM[:3]]),
}


@pytest.mark.parametrize("name", [*WRITTEN, "array.npy", "rows.npy", "arrays.npz"])
def test_the_same_frames_are_read_however_they_are_written(name, tmp_path):
    path = tmp_path / name
    if name in WRITTEN:
        path.write_text(WRITTEN[name], encoding="utf-8")
    elif name == "array.npy":
        np.save(path, FILM[:3])
    elif name == "rows.npy":
        np.save(path, np.concatenate([np.column_stack([np.full(P, i), points]) for i, points in enumerate(FILM[:3])]))
    else:  # arr_2 comes before arr_10
        np.savez(path, **{f"arr_{i}": points for i, points in zip((10, 9, 2), FILM[2::-1], strict=True)})
    found = jaxves.read_frames(path, **HOW)
    assert found.numbers.tolist() == [0, 1, 2]
    for points, written in zip(found.points, FILM[:3], strict=True):
        np.testing.assert_array_equal(points, upright(written))


def upright(points):
    """The points with y upwards, counter-clockwise: clockwise ones in the image are so after the flip."""
    points = points * [1.0, -1.0]
    x, y = points.T
    return points if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0 else points[::-1]


def test_rows_before_columns_are_exchanged_and_images_turned_upright(tmp_path):
    path = tmp_path / "contours.json"
    path.write_text(json.dumps([points[:, ::-1].tolist() for points in FILM[:1]]), encoding="utf-8")
    found = jaxves.read_frames(path, columns="yx", modes=6, **HOW)
    np.testing.assert_array_equal(found.points[0], upright(FILM[0]))
    kept = jaxves.read_frames(path, columns="yx", flip_y=False, modes=6, **HOW)
    np.testing.assert_allclose(np.mean(kept.curves[0], axis=0), np.mean(found.curves[0], axis=0) * [1, -1], rtol=1e-9)


def test_missing_frames_leave_gaps_in_time_and_frames_before_the_start_are_left_out(tmp_path):
    path = tmp_path / "film.csv"
    numbers = [3, 4, 7, 8]
    text = "".join(rows(f"{n},{{x}},{{y}}", [points]) for n, points in zip(numbers, FILM, strict=False))
    path.write_text("frame,x,y\n" + text, encoding="utf-8")
    found = jaxves.read_frames(path, start=4, modes=6, **HOW)
    assert found.numbers.tolist() == [4, 7, 8]
    np.testing.assert_allclose(found.times, [0.0, 0.15, 0.2])


SHORT = rows("{x} {y}", [clean(20)])
CROSSED = np.stack([10 * np.sin(np.linspace(0, 6.28, 100)), 10 * np.sin(2 * np.linspace(0, 6.28, 100))], axis=-1)
REFUSED = {
    "film.png": ("", "the name of a .csv"),
    "none.csv": (None, "a readable file"),
    "word.csv": ("1,2\nx,y\n", "two numbers on line 2"),
    "part.csv": ("frame,x,y\n0.5,1,2\n", "whole numbers in the frame column, not 0.5 on line 2"),
    "four.csv": ("0,1,2,3.5\n", "the columns frame, x and y, but found 4 columns on line 1: name them"),
    "few.txt": (SHORT, "at least 48 points in each frame, not 20 in frame 0: take more points"),
    "nan.txt": (rows("{x} {y}") + "nan 3\n", r"finite numbers \(line 601 has others\) \(frame 0\)"),
    "crossed.txt": (rows("{x} {y}", [CROSSED]), "do not cross themselves, as that of frame 0 does"),
    "object.json": ('{"a": 1}', "a list of outlines, each a list of points .*but found dict"),
    "several.json": (json.dumps([[FILM[0].tolist(), FILM[1].tolist()]]), "outline 0 is 2 contours: keep the longest"),
    "broken.json": ("[[1, 2", "a JSON file"),
    "broken.npy": ("no array", "a .npy file of numbers"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(name, tmp_path):
    text, said = REFUSED[name]
    if text is not None:
        (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=said) as refused:
        jaxves.read_frames(tmp_path / name, **HOW)
    assert "\n" not in str(refused.value) and name in str(refused.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (dict(pixel=0.0), "pixel = 0.0"), (dict(interval=-1), "interval = -1"), (dict(modes=0), "modes = 0"),
        (dict(columns="ij"), "columns = 'ij'"), (dict(start=40), "frames from start = 40 on"),
        (dict(modes=40), "at least 243 points in each frame, not 200 in frame 0: state fewer `modes` than 40"),
    ],
)  # fmt: skip
def test_arguments_that_cannot_be_used_are_refused(change, said, tmp_path):
    np.save(tmp_path / "film.npy", FILM[:2])
    with pytest.raises(ValueError, match=said):
        jaxves.read_frames(tmp_path / "film.npy", **(HOW | change))


# -- noise, modes, measures ----------------------------------------------------------------------------------------


def test_noise_radius_and_reduced_area_are_found(frames):
    """Within three standard errors. The noise is known to 1/√(2·24·200); the smooth curves alone are longer."""
    radius, area = exact()
    assert abs(frames.noise / NOISE - 1) < 3 / np.sqrt(2 * T * P) + 0.02  # modes below the noise are left in it
    assert abs(frames.correlation - 1) < 0.35
    assert abs(frames.radius.value - 0.2 * radius) < 3 * frames.radius.error < 0.2 * radius * 1e-3
    assert abs(frames.reduced_area.value - area) < 3 * frames.reduced_area.error < 2e-3
    assert frames.noise_in_radii == pytest.approx(frames.noise / radius, rel=1e-3)
    assert 4 <= frames.modes <= 10


def test_without_the_correction_noise_would_lower_the_reduced_area():
    """Twenty modes follow the noise: their perimeters are too long by many standard errors of the mean."""
    from jaxves.geometry import outline_fit
    from jaxves.geometry.frame_measures import measures

    curves, inverses = [], []
    for points in film(np.random.default_rng(1), noise=0.5):
        fit = outline_fit.fitted(upright(points), 20, 128)
        B = basis(fit.feet, 20)
        curves.append(fit.samples)
        inverses.append(0.25 * np.linalg.inv(B.T @ B))
    area = exact()[1]
    raw = measures(curves, [1e-12 * inverse for inverse in inverses]).reduced_area.mean()
    corrected = measures(curves, inverses).reduced_area.mean()
    assert area - raw.value > 15 * raw.error
    assert abs(corrected.value - area) < 3 * corrected.error


@pytest.mark.parametrize("blur", [0.0, 1.5])
def test_standard_errors_are_those_of_the_curves_also_for_correlated_errors(blur, tmp_path):
    """Squared deviations of areas and of reduced areas from the exact ones, over the variances that are given."""
    path = tmp_path / "film.npy"
    np.save(path, film(np.random.default_rng(2), blur=blur))
    found = jaxves.read_frames(path, **HOW)
    assert found.modes <= 10
    area = found.measures.reduced_area
    ratio = np.mean((area.value - exact()[1]) ** 2) / np.mean(area.error**2)
    assert abs(ratio - 1) < 3 * np.sqrt(2 / T)
    assert (found.correlation > 2.5) == (blur > 0)


def test_the_covariance_is_that_of_the_displacement_of_the_curves(frames):
    """The distances of the fitted curves from the exact outline, by modes, over their standard errors."""
    from jaxves.geometry import outline_fit

    z = upright(clean(4000)) @ [1, 1j]
    normal = -1j * (np.roll(z, -1) - np.roll(z, 1))
    normal /= np.abs(normal)
    squares = []
    for curve, error in zip(frames.curves, frames.standard_error, strict=True):
        x = curve @ [1, 1j]
        nearest = np.argmin(np.abs(x[:, None] - z), axis=1)
        apart = np.real((x - z[nearest]) * np.conj(normal[nearest]))
        B = basis(2 * np.pi * np.arange(len(x)) / len(x), frames.modes)
        squares.append((np.linalg.lstsq(B, apart, rcond=None)[0] / error)[1:9] ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=4 * np.sqrt(2 / (8 * T)))
    assert outline_fit.EXACT < 1e-3


def test_noise_does_not_add_modes(tmp_path):
    """More frames of the same noise do not; less noise shows more of the shape."""
    counts = []
    for frames, noise in ((1, 0.3), (24, 0.3), (24, 0.05)):
        np.save(tmp_path / "film.npy", film(np.random.default_rng(3), frames, noise))
        counts.append(jaxves.read_frames(tmp_path / "film.npy", **HOW).modes)
    assert abs(counts[1] - counts[0]) <= 3 and counts[2] > counts[1]


def test_a_frame_with_other_noise_is_reported(tmp_path):
    other = FILM[:6].copy()
    other[4] += np.random.default_rng(4).normal(size=(P, 2))
    np.save(tmp_path / "film.npy", other)
    with pytest.warns(OutlineNoise, match=r"the usual 0.3\d? px in frame 4"):
        jaxves.read_frames(tmp_path / "film.npy", modes=6, **HOW)


def test_frames_say_what_they_are_and_can_be_drawn(frames):
    text = repr(frames)
    assert "24 outlines to t = 1.15 s" in text and "reduced area 0.9" in text and "\n" not in text and len(text) < 200
    figure = frames.plot()
    assert len(figure.axes) == 5 and figure.axes[-1].get_ylabel().startswith("reduced area")
    with pytest.raises(ValueError, match="ax must have 2 to 25 axes, but has 1"):
        frames.plot(ax=figure.axes[0])
