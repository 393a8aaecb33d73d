"""Outlines as programs write them, and the smooth curve behind noisy points."""

import warnings

import numpy as np
import pytest

import jaxves
from jaxves.cli.commands import answer
from jaxves.geometry import outline_fit, outlines
from jaxves.geometry.curve import Curve, reduced_area
from jaxves.inputs import scene_files
from jaxves.inputs.scene_files import SceneError, parse, to_toml
from jaxves.runs.build import build

SCENE = 't_end = 0.001\nsaves = 1\n[[vesicle]]\nshape = "points"\nfile = "{}"\n{}\n'


def ellipse(K=400, a=120.0, b=70.0, turn=0.5):
    """Points of an ellipse about (256, 241), as in an image."""
    t = 2 * np.pi * np.arange(K) / K
    x, y = a * np.cos(t), b * np.sin(t)
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([256 + c * x - s * y, 241 + s * x + c * y], axis=-1)


def area_of(points):
    """The reduced area of the polygon of many points, or of the curve that they are samples of."""
    z = points[:, 0] + 1j * points[:, 1]
    d = np.fft.ifft(np.fft.fft(z) * 1j * np.fft.fftfreq(len(z), 1 / len(z)))
    return 4 * np.pi * np.pi * np.mean(np.imag(np.conj(z) * d)) / (2 * np.pi * np.mean(np.abs(d))) ** 2


def written(points, form="{:.3f},{:.3f}", end="\n"):
    return "".join(form.format(*point) + end for point in points)


def numbered(points, form):
    return "".join(form.format(k, *point) for k, point in enumerate(points, start=1))


P = np.round(ellipse(), 3)
COMMA = written(P).replace(".", ";").replace(",", "|").replace(";", ",").replace("|", ";")
FORMATS = {
    "plain.csv": written(P).encode(),
    "closed.csv": written([*P, P[0]]).encode(),
    "header.csv": ("X,Y\n" + written(P)).encode(),
    "quoted_header.csv": ('"X","Y"\n' + written(P)).encode(),
    "imagej_index.csv": (" ,X,Y\n" + numbered(P, "{},{:.3f},{:.3f}\n")).encode(),
    "imagej_area.csv": (" ,Area,X,Y\n" + numbered(P, "{},7.5,{:.3f},{:.3f}\n")).encode(),
    "index_alone.txt": numbered(P, "{} {:.3f} {:.3f}\n").encode(),
    "semicolon.csv": written(P, "{:.3f};{:.3f}").encode(),
    "decimal_comma.csv": COMMA.encode(),
    "decimal_comma_spaces.txt": COMMA.replace(";", " ").encode(),
    "decimal_comma_tabs.tsv": COMMA.replace(";", "\t").encode(),
    "bom.csv": b"\xef\xbb\xbf" + written(P).encode(),
    "utf16.csv": written(P).encode("utf-16"),
    "latin1.csv": "# Vergrößerung 60×, 0.108 µm/px\n".encode("latin-1") + written(P).encode(),
    "upper.CSV": written(P).encode(),
    "percent.txt": ("% x y (px)\n" + written(P, "{:.3f} {:.3f}")).encode(),
    "slashes.dat": ("// x y\n" + written(P, "{:.3f} {:.3f}")).encode(),
    "tabs.tsv": written(P, "{:.3f}\t{:.3f}").encode(),
    "spaces.txt": written(P, "  {:.3f}   {:.3f}  ").encode(),
    "trailing.csv": written(P, "{:.3f},{:.3f},").encode(),
    "crlf.csv": written(P, end="\r\n").encode(),
    "old_mac.csv": written(P, end="\r").encode(),
    "blank_lines.csv": written(P, end="\n\n").encode(),
    "lingering.csv": written(np.repeat(P, 2, axis=0)).encode(),
    "exponents.csv": written(P, "{:.8e},{:.8e}").encode(),
}


@pytest.mark.parametrize("name", FORMATS)
def test_the_same_outline_is_read_however_it_is_written(name, tmp_path):
    (tmp_path / name).write_bytes(FORMATS[name])
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(name, ""), encoding="utf-8")
    x = build(scene_files.read_scene(path)).x[0]
    right = build(parse({"t_end": 1.0, "vesicle": [{"shape": "points", "points": P.tolist()}]})).x[0]
    np.testing.assert_allclose(x, right, atol=1e-9)
    assert abs(float(reduced_area(Curve.from_nodes(x))) - 0.8992) < 2e-5


REFUSED = {
    "ambiguous": (written(np.round(P).astype(int), "{},5,{},5"), "line 1.*decimal points"),
    "words in between": (written(P[:20]) + "end of frame\n" + written(P[20:]), "line 21"),
    "two contours": (" ,X,Y\n" + numbered(P[:50], "{},{:.3f},{:.3f}\n") * 2, "second begins on line 52"),
    "one column": (written(P, "{:.3f}"), "two columns.*1 on line 1"),
    "three columns": (written(P, "{:.3f},{:.3f},1.5"), "two columns.*3 on line 1"),
    "four columns": (written(P, "{:.3f},{:.3f},1.5,2.5"), "two columns.*4 on line 1"),
    "a line that is short": (written(P[:9]) + "3.0\n" + written(P[9:]), "2 numbers on line 10"),
    "a gap": (written(P[:9]) + "nan,1.0\n" + written(P[9:]), "finite numbers .line 10"),
    "a point twice": (written([*P[:50], P[20], *P[50:]]), "line 21 and line 51 coincide"),
    "a crossing": (written([*P[:50], P[55], *P[51:55], P[50], *P[56:]]), r"at \(\d+.*between line 5\d and line 5\d"),
    "nothing": ("# nothing\n", "found none"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_read_is_refused_with_its_line(name, tmp_path):
    text, said = REFUSED[name]
    (tmp_path / "outline.csv").write_text(text, encoding="utf-8")
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format("outline.csv", ""), encoding="utf-8")
    with pytest.raises(SceneError, match=said) as refused:
        scene_files.read_scene(path)
    assert "\n" not in str(refused.value) and "vesicle[0].file" in str(refused.value)


def noisy(rng, area, radius, sigma, K):
    """Points of an ellipse of this reduced area and about this radius, moved along their normals."""
    points = np.array(outlines.ellipse_polygon(area).exterior.coords)[:-1]
    points = points[np.arange(K) * len(points) // K]
    points = points * radius / np.mean(np.linalg.norm(points, axis=1))
    tangent = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1) / np.linalg.norm(tangent, axis=1)[:, None]
    return points + sigma * rng.normal(size=(K, 1)) * normal


def allowed(modes, sigma, radius, K):
    """Three times what noise of a curve with these modes does to Δ = 4πA/L².

    Each mode k carries noise 2σ²/K, which lengthens the perimeter by k²/2 of it over R²; area and perimeter also vary
    by σ √(2/K)/R in the mean. A mode left out is one that is below the noise: as much again.
    """
    share = sigma / radius
    return 3 * (2 * share**2 / K * np.sum(np.arange(1, modes + 1) ** 2) + 2 * share * np.sqrt(2 / K))


NOISY = [
    (0.9, 95.0, 0.3, 360), (0.5, 100.0, 0.1, 400), (0.6, 60.0, 0.3, 200), (0.7, 200.0, 1.0, 1000),
    (0.8, 20.0, 0.1, 120), (0.95, 40.0, 0.5, 300), (0.99, 100.0, 0.5, 100), (0.9, 150.0, 0.3, 60),
    (0.75, 80.0, 0.8, 500), (0.85, 30.0, 0.2, 90),
]  # fmt: skip


@pytest.mark.parametrize(("area", "radius", "sigma", "K"), NOISY)
def test_noise_is_found_and_does_not_change_the_reduced_area(area, radius, sigma, K):
    points = noisy(np.random.default_rng(K), area, radius, sigma, K)
    noise = outline_fit.noise_of(points)
    assert abs(noise.deviation / sigma - 1) < 0.25  # of 60 to 1000 draws, σ is known to a tenth or better
    with pytest.warns(outlines.OutlineNoise, match=f"{noise.modes} Fourier modes"):
        outline = outlines.prepared(points)
    assert abs(area_of(outlines.smooth(*outline)) - area) < allowed(noise.modes, sigma, radius, K)


def test_whole_pixels_are_noise():
    """A chain of pixels along the ellipse: corners are no detail of a vesicle."""
    fine = np.round(ellipse(20000)).astype(int)
    chain = fine[np.any(fine != np.roll(fine, 1, axis=0), axis=1)].astype(float)
    with pytest.warns(outlines.OutlineNoise, match="scatter by 0.3"):
        outline = outlines.prepared(chain)
    assert abs(area_of(outlines.smooth(*outline)) - 0.8992) < 3e-3


def star(K, depth=0.2, lobes=3):
    t = 2 * np.pi * np.arange(K) / K
    return (1 + depth * np.cos(lobes * t))[:, None] * np.stack([np.cos(t), np.sin(t)], axis=-1)


EXACT = [star(12), star(40), star(200), star(400, 0.5), star(300, 0.1, 7), ellipse(8), ellipse(60), ellipse(400),
         ellipse(400, 120.0, 20.0), np.round(ellipse(), 3)]  # fmt: skip


@pytest.mark.parametrize("points", EXACT, ids=range(len(EXACT)))
def test_exact_points_are_not_taken_for_noisy(points):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        outline = outlines.prepared(points)
    assert outline.modes is None and len(outline.points) == len(points)


def test_rough_points_are_refused():
    points = noisy(np.random.default_rng(1), 0.9, 20.0, 1.0, 200)
    with pytest.raises(ValueError, match=r"less noise.*modes"):
        outlines.prepared(points)
    assert outlines.prepared(points, modes=4).modes == 4


@pytest.mark.parametrize("nodes", [64, "auto"])
def test_a_scene_of_a_noisy_outline_warns_once_and_is_stored_with_its_modes(nodes, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(outlines, "_TOLD", set())  # each outline is reported once in a process
    points = noisy(np.random.default_rng(7), 0.9, 95.0, 0.3, 360)
    (tmp_path / "noisy.csv").write_text(written(points), encoding="utf-8")
    path = tmp_path / "scene.toml"
    quoted = f'"{nodes}"' if nodes == "auto" else nodes
    path.write_text(SCENE.format("noisy.csv", f"[numerics]\nnodes = {quoted}\ncertify = false"), encoding="utf-8")
    assert answer(["run", str(path), "--out", str(tmp_path / "run.h5")]) == 0
    said = capsys.readouterr().err
    assert said.count("warning") == 1 and "scatter by 0.2" in said.replace("0.3", "0.2") and "`modes`" in said
    record = jaxves.read_result(tmp_path / "run.h5")
    found = 4 * np.pi * record.diagnostics["area"][0, 0] / record.diagnostics["length"][0, 0] ** 2
    assert abs(found - 0.9) < 3e-3 and np.all(record.nodes <= 96)
    again = scene_files.parse(scene_files.tomllib.loads(record.scene))  # warnings are errors here
    assert again.vesicle[0].modes and to_toml(again) == record.scene


def test_more_modes_than_points_support_are_refused():
    tables = {"t_end": 1.0, "vesicle": [{"shape": "points", "points": ellipse(20).tolist(), "modes": 10}]}
    with pytest.raises(SceneError, match="at least 21 points for modes = 10"):
        parse(tables)


def test_an_image_is_turned_upright():
    """y downwards: the mirror image, still counter-clockwise, and only once however often the scene is written."""
    vesicle = {"shape": "points", "points": ellipse(100).tolist(), "flip_y": True}
    file = parse({"t_end": 1.0, "vesicle": [vesicle]})
    upright = parse({"t_end": 1.0, "vesicle": [{"shape": "points", "points": (ellipse(100) * [1, -1]).tolist()}]})
    np.testing.assert_allclose(file.vesicle[0].points, upright.vesicle[0].points)
    assert parse(scene_files.tomllib.loads(to_toml(file))) == file and file.vesicle[0].flip_y is False


def test_points_from_python_are_checked_like_those_of_a_file():
    for points, said in {
        "shape": (np.zeros((5, 3)), r"points must have shape \(K, 2\), but have \(5, 3\)"),
        "few": (ellipse(7), "at least 8 points, not 7"),
        "finite": (np.where(np.arange(40)[:, None] == 3, np.nan, star(40)), "finite numbers .point 3"),
        "crossing": (star(40)[[*range(10), 15, *range(11, 15), 10, *range(16, 40)]], "cross itself"),
    }.values():
        with pytest.raises(ValueError, match=said):
            jaxves.through_points(points, 64)
    x = jaxves.through_points(noisy(np.random.default_rng(3), 0.9, 95.0, 0.3, 360), 64, modes=6)
    assert abs(float(reduced_area(Curve.from_nodes(x))) - 0.9) < 3e-3
