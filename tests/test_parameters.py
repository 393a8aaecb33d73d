"""A scene as a function of its numbers: by name, traced, and the same as a file that says so."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.inputs.checking import SceneError
from jaxves.inputs.parameters import numbers, with_numbers
from jaxves.inputs.scene_files import parse, read_scene
from jaxves.runs.build import build, scene_of

PAIR = {
    "t_end": 1.0,
    "vesicle": [{"reduced_area": 0.9, "angle": 90.0}],
    "pair": {"separation": 2.6, "offset_angle": 20.0},
    "field": {"beta": 3.2, "conductivity_ratio": 0.1, "time": {"kind": "table", "times": [0.0, 1.0], "values": [1, 0]}},
    "flow": {"kind": "linear", "gradient": [[0.0, 1.0], [0.0, 0.0]]},
    "numerics": {"nodes": 16},
}


def leaves(scene):
    return jax.tree.leaves(scene)


def test_all_numbers_of_a_scene_have_names():
    found = numbers(read_scene("pop"))
    assert found["vesicle.reduced_area"] == 0.9
    assert found["field.beta"] == 3.2
    assert found["field.direction[1]"] == 1.0
    assert not any(name.startswith(("numerics", "t_end", "pair", "flow")) for name in found)
    found = numbers(parse(PAIR))
    assert found["pair.offset_angle"] == 20.0
    assert found["flow.gradient[0][1]"] == 1.0
    assert found["field.time.values[1]"] == 0.0


TRACE = {"flow.gradient[0][0]": "flow.gradient[1][1]", "flow.gradient[1][1]": "flow.gradient[0][0]"}


@pytest.mark.parametrize("name", sorted(numbers(parse(PAIR))))
def test_a_number_given_is_the_number_written_in_the_file(name):
    """Traced, every number builds the scene that a file with that number describes."""
    scene_file = parse(PAIR)
    values = {name: numbers(scene_file)[name] + 0.05}
    if name in TRACE:  # a flow without sources, on both sides
        values[TRACE[name]] = -values[name]
    traced = jax.jit(lambda values: scene_of(scene_file, values))(values)
    for a, b in zip(leaves(traced), leaves(build(with_numbers(scene_file, values))), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-13, atol=1e-13)
    assert any(not np.array_equal(a, b) for a, b in zip(leaves(traced), leaves(build(scene_file)), strict=True))


def test_one_name_reaches_all_vesicles_and_an_index_one():
    vesicles = [{"reduced_area": 0.9}, {"reduced_area": 0.8, "center": [4.0, 0.0]}]
    scene_file = parse({"t_end": 1.0, "vesicle": vesicles, "numerics": {"nodes": 16}})
    assert "vesicle[1].reduced_area" in numbers(scene_file)
    np.testing.assert_array_equal(scene_of(scene_file, {"vesicle.bending": 2.0}).bending, [2.0, 2.0])
    np.testing.assert_array_equal(scene_of(scene_file, {"vesicle[1].bending": 2.0}).bending, [1.0, 2.0])


def test_a_vesicle_can_be_given_a_number_of_its_own():
    scene = scene_of(parse(PAIR), {"vesicle[0].conductivity_ratio": 5.0})
    np.testing.assert_array_equal(scene.field.conductivity_ratio, [5.0, 5.0])  # two copies of the one


def test_the_derivative_in_a_number_is_that_of_the_built_scene():
    scene_file = parse(PAIR)

    def reach(offset):
        return jnp.max(scene_of(scene_file, {"pair.offset_angle": offset}).x[..., 0])

    slope = jax.jit(jax.grad(reach))(20.0)
    assert abs(slope + 1.3 * np.sin(np.radians(20.0)) * np.pi / 180) < 1e-12


@pytest.mark.parametrize(
    "name",
    ["field.betta", "flow", "vesicle[3].angle", "t_end", "numerics.tolerance", "field.direction", "field.beta[0]",
     "vesicle.shape", "vesicle.relaxed", "pair..separation", ""],
)  # fmt: skip
def test_a_name_the_scene_does_not_have_is_refused_with_those_it_has(name):
    with pytest.raises(SceneError, match=r"expected one of the numbers of the scene: vesicle\.angle, "):
        with_numbers(parse(PAIR), {name: 1.0})


def test_a_table_the_scene_does_not_have_is_refused():
    with pytest.raises(SceneError, match=r"flow\.capillary_number = 1\.0, expected one of the numbers"):
        with_numbers(read_scene("pop"), {"flow.capillary_number": 1.0})
