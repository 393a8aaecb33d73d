"""Scene files: what is read, what is refused and with which words, and what is built of it."""

import itertools
import math
import subprocess
import sys
import tomllib

import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.geometry.curve import Curve, area, centroid, inclination, length, reduced_area
from jaxves.inputs.scene_files import SceneError, built_in_scenes, parse, read_scene, to_toml
from jaxves.physics import flow, waveform
from jaxves.runs.build import build
from jaxves.runs.case import Case

BASE = """
t_end = 1.0
[[vesicle]]
reduced_area = 0.9
"""
FIELD = "[field]\nbeta = 3.2\nconductivity_ratio = 0.1\n"
VESICLE = "t_end = 1.0\n[[vesicle]]\n"
TWO = "t_end = 1.0\n[[vesicle]]\nshape = 'circle'\n[[vesicle]]\nshape = 'circle'\n"

# (text, key in the complaint, value in the complaint or None, words of what was expected)
BROKEN = [
    ("", "t_end", None, "positive"),
    ("t_end = 1.0", "vesicle", None, "[[vesicle]]"),
    ("t_end = 1.0\nvesicle = []", "vesicle", "[]", "[[vesicle]]"),
    ("t_end = 1.0\n[vesicle]\nreduced_area = 0.9", "vesicle", None, "[[vesicle]]"),
    ("t_end = 1.0\nvesicle = [3]", "vesicle[0]", "3", "table"),
    ("t_end = 0\n" + BASE[13:], "t_end", "0", "positive"),
    ("t_end = '1'\n" + BASE[13:], "t_end", '"1"', "positive"),
    ("t_end = true\n" + BASE[13:], "t_end", "true", "positive"),
    ("t_end = inf\n" + BASE[13:], "t_end", "inf", "positive"),
    ("t_end = nan\n" + BASE[13:], "t_end", "nan", "positive"),
    ("saves = 0\n" + BASE, "saves", "0", "whole number >= 1"),
    ("saves = 2.5\n" + BASE, "saves", "2.5", "whole number"),
    ("saves = true\n" + BASE, "saves", "true", "whole number"),
    ("average = [0.5, 1.5]\n" + BASE, "average", "[0.5, 1.5]", "t_end = 1.0"),
    ("average = [0.5, 0.5]\n" + BASE, "average", "[0.5, 0.5]", "a < b"),
    ("average = [-0.5, 0.5]\n" + BASE, "average", "[-0.5, 0.5]", "0 <= a"),
    ("average = [0.5]\n" + BASE, "average", "[0.5]", "two times"),
    ("t_ende = 1.0\n" + BASE, "t_ende", "1.0", "t_end"),
    (VESICLE, "vesicle[0].reduced_area", None, "(0, 1]"),
    (VESICLE + "reduced_area = 1.2", "vesicle[0].reduced_area", "1.2", "a number in (0, 1]"),
    (VESICLE + "reduced_area = 0", "vesicle[0].reduced_area", "0", "(0, 1]"),
    (VESICLE + "shape = 'circle'\nreduced_area = 0.9", "vesicle[0].reduced_area", "0.9", 'shape = "circle"'),
    (VESICLE + "shape = 'square'", "vesicle[0].shape", '"square"', '"circle"'),
    (VESICLE + "shape = 'points'", "vesicle[0].file", None, ".csv"),
    (BASE + "reduced_aria = 0.9", "vesicle[0].reduced_aria", "0.9", "did you mean reduced_area?"),
    (BASE + "center = [0.0, '1']", "vesicle[0].center", '[0.0, "1"]', "two finite numbers"),
    (BASE + "center = [0.0, true]", "vesicle[0].center", "[0.0, true]", "two finite numbers"),
    (BASE + "center = [0.0, 1.0, 2.0]", "vesicle[0].center", "[0.0, 1.0, 2.0]", "two finite numbers"),
    (BASE + "length = -1.0", "vesicle[0].length", "-1.0", "positive"),
    (BASE + "bending = 0.0", "vesicle[0].bending", "0.0", "positive"),
    (BASE + "relaxed = 1", "vesicle[0].relaxed", "1", "true or false"),
    (BASE + "disturbance = inf", "vesicle[0].disturbance", "inf", "a finite number"),
    (BASE + "relaxed = true\ndisturbance = 1e-6", "vesicle[0].disturbance", "1e-06", "no disturbance where relaxed"),
    (BASE + "angle = nan", "vesicle[0].angle", "nan", "finite"),
    (BASE + "chi = 0.1", "vesicle[0].chi", "0.1", "[field]"),
    (BASE + "conductivity_ratio = 2.0", "vesicle[0].conductivity_ratio", "2.0", "[field]"),
    (BASE + "chi = -1.0\n" + FIELD, "vesicle[0].chi", "-1.0", "positive"),
    (BASE + "[pair]\noffset_angle = 20.0", "pair.separation", None, "positive"),
    (BASE + "[pair]\nseparation = 1.0", "pair.separation", "1.0", "overlap"),
    (TWO + "center = [5.0, 0.0]\n[pair]\nseparation = 3.0", "pair", None, "exactly one"),
    (TWO + "center = [2.0, 0.0]", "vesicle[1].center", "[2.0, 0.0]", "vesicle[0] and vesicle[1]"),
    (TWO + "length = 0.2", "vesicle[1].center", "[0.0, 0.0]", "overlap"),
    (BASE + "[field]\nconductivity_ratio = 0.1", "field.beta", None, ">= 0"),
    (BASE + "[field]\nbeta = 3.2", "field.conductivity_ratio", None, ">= 0"),
    (BASE + FIELD + "chi = 0.0", "field.chi", "0.0", "positive"),
    (BASE + FIELD + "membrane_conductance = inf", "field.membrane_conductance", "inf", ">= 0"),
    (BASE + "[field]\nbeta = 3.2\nconductivity_ratio = nan", "field.conductivity_ratio", "nan", ">= 0"),
    (BASE + FIELD + "direction = [0, 0]", "field.direction", "[0, 0]", "not both zero"),
    (BASE + FIELD + "betta = 3", "field.betta", "3", "did you mean beta?"),
    (BASE + "field = 3", "vesicle[0].field", "3", "one of"),
    ("field = 3\n" + BASE, "field", "3", "a table"),
    ("flow = 3\n" + BASE, "flow", "3", "a table"),
    (BASE + FIELD + "[field.time]\nstart = 0.1", "field.time.kind", None, '"pulse"'),
    (BASE + FIELD + "[field.time]\nkind = 'pulse'\nstart = 0.1", "field.time.duration", None, "positive"),
    (BASE + FIELD + "[field.time]\nkind = 'sine'\nfrequency = 0", "field.time.frequency", "0", "positive"),
    (
        BASE + FIELD + "[field.time]\nkind = 'table'\ntimes = [0, 0]\nvalues = [1, 2]",
        "field.time.times",
        "[0, 0]",
        "increasing",
    ),
    (
        BASE + FIELD + "[field.time]\nkind = 'table'\ntimes = [0, 1]\nvalues = [1, 2, 3]",
        "field.time.values",
        "3.0",
        "2 n",
    ),
    (BASE + "[flow]\ncapillary_number = 1.0", "flow.kind", None, '"shear"'),
    (BASE + "[flow]\nkind = 'sheer'", "flow.kind", '"sheer"', '"shear"'),
    (BASE + "[flow]\nkind = 'shear'", "flow.capillary_number", None, "finite number"),
    (BASE + "[flow]\nkind = 'shear'\ncapillary_number = 0", "flow.capillary_number", "0", "other than zero"),
    (BASE + "[flow]\nkind = 'shear'\ngradient = [[0, 1], [0, 0]]", "flow.gradient", "[[0, 1], [0, 0]]", "capillary"),
    (BASE + "[flow]\nkind = 'linear'\ngradient = [[1, 0], [0, 1]]", "flow.gradient", "[1, 0]", "trace-free"),
    (BASE + "[flow]\nkind = 'linear'\ngradient = [1, 0]", "flow.gradient", "[1, 0]", "trace-free"),
    (BASE + "[stop]", "stop", None, "steady"),
    (BASE + "[stop]\nsteady = 0.0", "stop.steady", "0.0", "positive"),
    (BASE + FIELD + "[stop]\nclass = 'PO'", "stop.class", '"PO"', '"POP"'),
    (BASE + "[stop]\nclass = 'POP'", "stop.class", '"POP"', "[field]"),
    (BASE + "[numerics]\nnodes = 33", "numerics.nodes", "33", "even"),
    (BASE + "[numerics]\nnodes = 8", "numerics.nodes", "8", ">= 16"),
    (BASE + "[numerics]\nnodes = 'many'", "numerics.nodes", '"many"', '"auto"'),
    (BASE + "[numerics]\ntolerance = 1.0", "numerics.tolerance", "1.0", "[1e-12, 0.1]"),
    (BASE + "[numerics]\ntime_step = 0.0", "numerics.time_step", "0.0", "positive"),
    (BASE + "[numerics]\ntime_step = 1e-3\ntolerance = 1e-3", "numerics.time_step", "0.001", "one of the two"),
    (BASE + "[numerics]\nmethod = 'rk4'", "numerics.method", '"rk4"', '"ark4"'),
    (BASE + "[numerics]\nmethod = 'euler'", "numerics.method", '"euler"', "time_step"),
    (BASE + "[numerics]\nsolver = 'gmres'", "numerics.solver", '"gmres"', '"dense"'),
]


@pytest.mark.parametrize(("text", "key", "value", "expected"), BROKEN)
def test_a_broken_scene_is_refused_in_one_line_with_key_value_and_what_was_expected(
    tmp_path, text, key, value, expected
):
    path = tmp_path / "scene.toml"
    path.write_text(text)
    with pytest.raises(SceneError) as complaint:
        read_scene(path)
    line = str(complaint.value)
    assert "\n" not in line
    found, _, wanted = line.removeprefix(f"{path}: ").partition(", expected ")
    assert found.split(" ")[0] == key
    assert expected in wanted
    if value is None:
        assert found in {key, f"{key} is missing"}
    else:
        assert found.startswith(f"{key} = ") and value in found


def test_the_complaint_reads_as_documented():
    with pytest.raises(
        SceneError, match=r"^scene\.toml: vesicle\[0\]\.reduced_area = 1\.2, expected a number in \(0, 1\]$"
    ):
        parse({"t_end": 1.0, "vesicle": [{"reduced_area": 1.2}]}, origin="scene.toml")


def test_what_is_no_scene_file_at_all_is_refused_in_one_line(tmp_path):
    broken = tmp_path / "broken.toml"
    broken.write_text("t_end = 1.0\nsaves 200\n")
    latin = tmp_path / "latin.toml"
    latin.write_bytes("# Länge\nt_end = 1.0".encode("latin-1"))
    cases = {
        broken: "line 2, column 7",
        latin: "UTF-8",
        tmp_path: "directory",
        tmp_path / "absent.toml": "No such file",
        "buding": "did you mean budding?",
        "nonsense": "pop",
    }
    for source, words in cases.items():
        with pytest.raises(SceneError) as complaint:
            read_scene(source)
        assert words in str(complaint.value) and str(source) in str(complaint.value)
        assert "\n" not in str(complaint.value)


def test_bad_input_is_answered_without_importing_jax():
    code = "import sys; import jaxves; jaxves.read_scene('chain'); sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- points -------------------------------------------------------------------------------------


def star(K=40, amplitude=0.2):
    alpha = np.linspace(0, 2 * np.pi, K, endpoint=False)
    return (1 + amplitude * np.cos(3 * alpha))[:, None] * np.stack([np.cos(alpha), np.sin(alpha)], axis=-1)


def write_points(folder, points, suffix=".csv"):
    if suffix == ".npy":
        np.save(folder / "shape.npy", points)
    else:
        np.savetxt(folder / f"shape{suffix}", points, delimiter="," if suffix == ".csv" else " ", fmt="%s")
    path = folder / "scene.toml"
    path.write_text(f"t_end = 1.0\n[[vesicle]]\nshape = 'points'\nfile = 'shape{suffix}'\n")
    return path


@pytest.mark.parametrize("suffix", [".csv", ".txt", ".npy"])
def test_points_are_read_from_beside_the_scene_file(tmp_path, suffix):
    scene_file = read_scene(write_points(tmp_path, star(), suffix))
    np.testing.assert_allclose(scene_file.vesicle[0].points, star(), atol=1e-15)


def test_clockwise_points_are_turned(tmp_path):
    (vesicle,) = read_scene(write_points(tmp_path, star()[::-1])).vesicle
    np.testing.assert_allclose(vesicle.points, star(), atol=1e-15)


def figure_of_eight():
    alpha = np.linspace(0, 2 * np.pi, 20, endpoint=False) + 0.1
    return np.stack([np.sin(alpha), np.sin(2 * alpha)], axis=-1)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (star(7), "at least 8 points"),
        (np.insert(star(), 20, star()[3], axis=0), "line 4 and line 21 coincide"),
        (np.where(np.arange(40)[:, None] == 3, np.nan, star()), "line 4"),
        (figure_of_eight(), "cross itself"),
        (np.hstack([star(), star()]), "the two columns x and y, not 4"),
        (np.full((9, 2), "x"), "two numbers on line 2"),
        (np.zeros((0, 2)), "found none"),
    ],
)
def test_points_that_are_no_closed_curve_are_refused(tmp_path, points, words):
    path = write_points(tmp_path, points)
    with pytest.raises(SceneError) as complaint:
        read_scene(path)
    line = str(complaint.value)
    assert 'vesicle[0].file = "shape.csv", expected ' in line and words in line and "\n" not in line


def test_a_file_of_points_that_is_not_there_is_named(tmp_path):
    path = write_points(tmp_path, star())
    (tmp_path / "shape.csv").unlink()
    with pytest.raises(SceneError, match=r'vesicle\[0\]\.file = "shape\.csv", expected .*No such file'):
        read_scene(path)


def test_points_become_a_curve_of_the_given_length_angle_and_center(tmp_path):
    path = write_points(tmp_path, 3.0 * star() * [1.0, 0.6] + [5.0, 7.0])
    path.write_text(path.read_text() + "length = 2.0\nangle = 30.0\ncenter = [-1.0, 0.5]\n")
    (x,) = build(read_scene(path)).x
    curve = Curve.from_nodes(x)
    np.testing.assert_allclose(length(curve), 4 * np.pi, rtol=1e-12)
    np.testing.assert_allclose(centroid(curve), [-1.0, 0.5], atol=1e-12)
    path.write_text(path.read_text().replace("30.0", "0.0"))
    straight = Curve.from_nodes(build(read_scene(path)).x[0])
    np.testing.assert_allclose(inclination(curve) - inclination(straight), np.pi / 6, atol=1e-10)


# --- there and back -----------------------------------------------------------------------------

FULL = """
t_end = 2
saves = 10
average = [0.5, 1.0]

[[vesicle]]
reduced_area = 0.7
angle = 30
center = [3.0, 0.0]
length = 1.5
bending = 2.0
relaxed = true
conductivity_ratio = inf
membrane_conductance = 1.0
chi = 0.1
permittivity_ratio = 2.0

[[vesicle]]
shape = "circle"
center = [-3.0, 0.0]

[[vesicle]]
shape = "points"
points = [[1, 0], [0.7, 0.7], [0, 1], [-0.7, 0.7], [-1, 0], [-0.7, -0.7], [0, -1], [0.7, -0.7]]
center = [0.0, 5.0]

[field]
beta = 3.2
conductivity_ratio = 0.1
direction = [1.0, 3.0]

[field.time]
kind = "sine"
frequency = 2.0
phase = 90.0

[flow]
kind = "linear"
gradient = [[1.0, 2.0], [0.0, -1.0]]

[stop]
steady = 1e-6
class = "POP"

[numerics]
nodes = 64
time_step = 1e-3
method = "euler"
"""

TIMES = {
    "kind = 'constant'": type(None),
    "kind = 'pulse'\nstart = 0.1\nduration = 0.5": waveform.Pulse,
    "kind = 'sine'\nfrequency = 1": waveform.Sine,
    "kind = 'table'\ntimes = [0, 1, 3]\nvalues = [0.0, 2.0, -1.0]": waveform.PiecewiseLinear,
}


@pytest.mark.parametrize("text", [FULL, BASE, *(BASE + FIELD + "[field.time]\n" + time for time in TIMES)])
def test_a_scene_written_and_read_is_the_same(text):
    scene_file = parse(tomllib.loads(text))
    written = to_toml(scene_file)
    assert parse(tomllib.loads(written)) == scene_file
    assert to_toml(parse(tomllib.loads(written))) == written


@pytest.mark.parametrize("angle", range(0, 360, 7))
def test_a_direction_is_normalised_once_and_then_stays_to_the_last_bit(angle):
    direction = [3.7 * math.cos(math.radians(angle)), 3.7 * math.sin(math.radians(angle))]
    tables = tomllib.loads(BASE) | {"field": {"beta": 1.0, "conductivity_ratio": 1.0, "direction": direction}}
    scene_file = parse(tables)
    np.testing.assert_allclose(scene_file.field.direction, np.array(direction) / 3.7, rtol=1e-14)
    assert parse(tomllib.loads(to_toml(scene_file))) == scene_file


def test_a_written_scene_is_complete_with_defaults_and_without_what_is_absent():
    tables = tomllib.loads(to_toml(parse(tomllib.loads(BASE))))
    assert tables == {
        "t_end": 1.0,
        "saves": 200,
        "vesicle": [
            {
                "shape": "ellipse",
                "reduced_area": 0.9,
                "angle": 0.0,
                "center": [0.0, 0.0],
                "length": 1.0,
                "bending": 1.0,
                "relaxed": False,
            }
        ],
        "numerics": {
            "tolerance": 1e-4,
            "method": "auto",
            "solver": "auto",
            "neighbours": 8,
        },
    }


def test_points_are_written_out_so_that_their_file_is_no_longer_needed(tmp_path):
    path = write_points(tmp_path, star())
    scene_file = read_scene(path)
    (tmp_path / "shape.csv").unlink()
    assert parse(tomllib.loads(to_toml(scene_file))) == scene_file


# --- building -----------------------------------------------------------------------------------


def test_every_number_of_a_full_scene_arrives():
    scene = build(parse(tomllib.loads(FULL)))
    assert scene.x.shape == (3, 64, 2)
    curves = [Curve.from_nodes(x) for x in scene.x]
    np.testing.assert_allclose([length(c) / (2 * np.pi) for c in curves], [1.5, 1.0, 1.0], rtol=1e-10)
    np.testing.assert_allclose([centroid(c) for c in curves], [[3, 0], [-3, 0], [0, 5]], atol=1e-10)
    # Δ and the angle hold to what 64 nodes resolve of the ellipse.
    np.testing.assert_allclose(reduced_area(curves[0]), 0.7, atol=1e-6)
    np.testing.assert_allclose(inclination(curves[0]), np.pi / 6, atol=1e-6)
    np.testing.assert_allclose(area(curves[1]), np.pi, rtol=1e-12)
    np.testing.assert_array_equal(scene.bending, [2.0, 1.0, 1.0])
    field = scene.field
    assert (field.beta, field.chi) == (3.2, 0.08)
    np.testing.assert_array_equal(field.conductivity_ratio, [np.inf, 0.1, 0.1])
    np.testing.assert_array_equal(field.membrane_conductance, [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(field.membrane_chi, [0.1, 0.08, 0.08])
    np.testing.assert_array_equal(field.permittivity_ratio, [2.0, 1.0, 1.0])
    np.testing.assert_allclose(field.direction, np.array([1, 3]) / np.sqrt(10), rtol=1e-15)
    np.testing.assert_allclose(field.history(jnp.asarray(0.0)), 1.0, rtol=1e-15)
    np.testing.assert_array_equal(scene.flow.velocity_gradient, [[1.0, 2.0], [0.0, -1.0]])


def test_a_pair_is_two_copies_about_the_center():
    text = BASE + "center = [1.0, 2.0]\n[pair]\nseparation = 3.0\noffset_angle = 30.0"
    first, second = build(parse(tomllib.loads(text))).x
    np.testing.assert_allclose(second - first, np.tile([3 * np.sqrt(3) / 2, 1.5], (64, 1)), atol=1e-14)
    np.testing.assert_allclose((first + second).mean(axis=0) / 2, [1.0, 2.0], atol=1e-12)


@pytest.mark.parametrize(("text", "kind"), TIMES.items())
def test_the_history_of_the_field_is_of_its_kind(text, kind):
    circle = "t_end = 1.0\n[[vesicle]]\nshape = 'circle'\n"
    scene = build(parse(tomllib.loads(circle + FIELD + "[field.time]\n" + text)))
    assert isinstance(scene.field.history, kind)


@pytest.mark.parametrize(("name", "kind"), [("shear", flow.Shear), ("extension", flow.Extension)])
def test_the_flow_is_of_its_kind(name, kind):
    circle = "t_end = 1.0\n[[vesicle]]\nshape = 'circle'\n"
    scene = build(parse(tomllib.loads(circle + f"[flow]\nkind = '{name}'\ncapillary_number = -3")))
    assert isinstance(scene.flow, kind) and scene.flow.capillary_number == -3
    assert scene.field is None


BUILTIN = {
    "budding": (1, 128),
    "chain": (2, 64),
    "circulation": (2, 64),
    "oscillation": (2, 64),
    "pop": (1, 64),
    "prolate": (1, 64),
    "pulse": (1, 256),
    "relax": (1, 64),
    "reversal": (1, 128),
    "shear": (1, 64),
    "sheared_field": (1, 64),
}


def test_the_built_in_scenes_are_known_with_a_line_each():
    names = built_in_scenes()
    assert set(names) == set(BUILTIN)
    assert all(len(line) > 20 for line in names.values())


@pytest.mark.parametrize("name", BUILTIN)
def test_a_built_in_scene_loads_and_builds(name):
    scene_file = read_scene(name)
    assert parse(tomllib.loads(to_toml(scene_file))) == scene_file
    scene = build(scene_file)
    assert scene.x.shape == (*BUILTIN[name], 2)
    assert bool(jnp.all(jnp.isfinite(scene.x)))
    for i, j in itertools.combinations(range(scene.x.shape[0]), 2):
        gap = jnp.min(jnp.linalg.norm(scene.x[i][:, None] - scene.x[j][None], axis=-1))
        assert gap > 0.5


def test_outlines_judge_ellipses_as_they_are_built():
    """Two ellipses tip to tip are refused when the built nodes touch, and accepted just beyond."""
    (x,) = build(parse(tomllib.loads(BASE))).x
    tip_to_tip = 2 * float(x[:, 0].max())
    apart = "t_end = 1.0\n" + "[[vesicle]]\nreduced_area = 0.9\n" * 2 + "center = [{}, 0.0]\n"
    parse(tomllib.loads(apart.format(tip_to_tip + 1e-3)))
    with pytest.raises(SceneError, match="touch"):
        parse(tomllib.loads(apart.format(tip_to_tip - 1e-6)))


PAIR = "[pair]\nseparation = 3.0\n"


@pytest.mark.parametrize(
    ("tables", "numerics", "scheme"),
    [
        ("", "", "ARK4"),
        ("", "tolerance = 1e-5", "ARK4"),
        ("", "tolerance = 1e-6", "ARK5"),
        (PAIR, "tolerance = 1e-4", "ARK4"),
        (PAIR, "tolerance = 1e-5", "ARK5"),
        ("", "time_step = 1e-7", "ARK4"),
        ("", "tolerance = 1e-7\nmethod = 'ark4'", "ARK4"),
        ("", "tolerance = 1e-3\nmethod = 'ark5'", "ARK5"),
    ],
)
def test_a_tight_tolerance_takes_the_fifth_order_scheme_unless_one_is_named(tables, numerics, scheme):
    march = Case(parse(tomllib.loads(BASE + tables + "[numerics]\n" + numerics))).march()
    assert type(march.stepper).__name__ == scheme
