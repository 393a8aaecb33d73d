"""Sweep files: which cases they describe, and one line for what is wrong with them."""

import math
import tomllib

import numpy as np
import pytest

from jaxves.inputs.checking import SceneError
from jaxves.inputs.sweep_files import parse, plan, read_sweep_file, to_toml

BETA = "field.beta"
CONDUCTANCE = "field.membrane_conductance"


def test_axes_make_a_grid_with_the_last_axis_fastest():
    found = plan(parse({"scene": "pop", "axes": {BETA: {"start": 1, "stop": 4, "num": 4}, CONDUCTANCE: [0, 0.5]}}))
    assert found.dims == (BETA, CONDUCTANCE) and found.shape == (4, 2)
    np.testing.assert_array_equal(found.values[:3], [[1, 0], [1, 0.5], [2, 0]])
    np.testing.assert_array_equal(found.coordinates[BETA][1], [1, 2, 3, 4])
    np.testing.assert_array_equal(found.coordinates[CONDUCTANCE][1], [0, 0.5])


def test_logarithmic_axes_have_equal_ratios():
    axis = {"start": 0.1, "stop": 10, "num": 5, "spacing": "log"}
    x = plan(parse({"scene": "pop", "axes": {BETA: axis}})).values[:, 0]
    np.testing.assert_allclose(x[1:] / x[:-1], math.sqrt(10), rtol=1e-14)


def test_refinement_halves_every_interval():
    tables = {"scene": "pop", "axes": {BETA: [1, 2, 4], CONDUCTANCE: [0, 1]}, "refine": {"levels": 2, "along": [BETA]}}
    found = plan(parse(tables))
    np.testing.assert_array_equal(found.coordinates[BETA][1], [1, 1.25, 1.5, 1.75, 2, 2.5, 3, 3.5, 4])
    assert found.shape == (9, 2) and found.stride == (4, 1)


@pytest.mark.parametrize(("sequence", "num"), [("halton", 60), ("sobol", 64)])
def test_a_sample_fills_its_box_evenly_and_is_the_same_every_time(sequence, num):
    ranges = {BETA: [1.0, 3.0], CONDUCTANCE: [0.0, 0.5]}
    tables = {"scene": "pop", "sample": {"num": num, "sequence": sequence, "ranges": ranges}}
    found = plan(parse(tables))
    assert found.dims == ("case",) and found.values.shape == (num, 2)
    unit = (found.values - [1.0, 0.0]) / [2.0, 0.5]
    assert np.all((unit >= 0) & (unit <= 1))
    # Every quarter of every axis has its share, up to a few points.
    shares = np.stack([np.histogram(column, 4, (0, 1))[0] for column in unit.T])
    assert np.all(abs(shares - num / 4) <= 2)
    np.testing.assert_array_equal(plan(parse(tables)).values, found.values)


def test_a_sweep_written_out_is_the_same_sweep():
    tables = {"scene": "shear", "axes": {"flow.capillary_number": [1, 2.5]}, "keep": ["shapes"], "max_steps": [10, 20]}
    sweep_file = parse(tables)
    assert parse(tomllib.loads(to_toml(sweep_file))) == sweep_file


def test_a_scene_is_found_beside_the_sweep_file(tmp_path):
    (tmp_path / "mine.toml").write_text("t_end = 0.5\n[[vesicle]]\nreduced_area = 0.8\n")
    (tmp_path / "sweep.toml").write_text('scene = "mine.toml"\n[axes]\n"vesicle.reduced_area" = [0.7, 0.8]\n')
    assert read_sweep_file(tmp_path / "sweep.toml").scene.t_end == 0.5


GRID = {"scene": "pop", "axes": {BETA: [1.0, 2.0]}}

BROKEN = [
    ({"axes": {BETA: [1.0]}}, "scene is missing", "a scene file"),
    ({"scene": "popp", "axes": {BETA: [1.0]}}, "popp", "did you mean pop?"),
    ({"scene": {"t_end": 1.0}, "axes": {BETA: [1.0]}}, "scene.vesicle is missing", "[[vesicle]]"),
    ({"scene": "pop"}, "axes", "one of [axes], [[cases]] and [sample], not none"),
    (GRID | {"cases": [{BETA: 1.0}]}, "axes", "not axes and cases"),
    (GRID | {"axes": {}}, "axes", "one or more names"),
    (GRID | {"axes": {"field.bta": [1.0]}}, "field.bta", "field.beta"),
    (GRID | {"axes": {"t_end": [1.0]}}, "t_end", "field.beta"),
    (GRID | {"axes": {BETA: []}}, "axes.field.beta = []", "a list of numbers"),
    (GRID | {"axes": {BETA: 1.0}}, "axes.field.beta = 1.0", "a list of numbers"),
    (GRID | {"axes": {BETA: [1.0, "2"]}}, 'axes.field.beta[1] = "2"', "a number"),
    (GRID | {"axes": {BETA: {"start": 1, "stop": 2}}}, "axes.field.beta.num is missing", ">= 2"),
    (GRID | {"axes": {BETA: {"start": 1, "stop": 1, "num": 2}}}, "axes.field.beta.stop = 1", "start"),
    (GRID | {"axes": {BETA: {"start": 0, "stop": 1, "num": 2, "spacing": "log"}}}, "spacing", "positive"),
    (GRID | {"axes": {BETA: {"start": 0, "stop": 1, "number": 2}}}, "axes.field.beta.number", "num"),
    (GRID | {"axes": {BETA: [1.0, -2.0]}}, "field.beta = -2.0", ">= 0"),
    (GRID | {"axes": {"vesicle.reduced_area": [0.9, 1.2]}}, "vesicle[0].reduced_area = 1.2", "(0, 1]"),
    (GRID | {"axes": {BETA: [math.nan, 1.0]}}, "field.beta = nan", ">= 0"),
    ({"scene": "pop", "cases": []}, "cases", "one or more"),
    ({"scene": "pop", "cases": [{BETA: 1.0}, {CONDUCTANCE: 1.0}]}, "cases[1]", BETA),
    ({"scene": "pop", "sample": {"num": 9, "sequence": "sobol", "ranges": {BETA: [1, 2]}}}, "num = 9", "power of two"),
    ({"scene": "pop", "sample": {"num": 9, "ranges": {BETA: [1]}}}, "sample.ranges.field.beta", "two finite numbers"),
    ({"scene": "pop", "sample": {"num": 4, "ranges": {BETA: [-9, -8]}}}, "field.beta = -8", ">= 0"),
    (GRID | {"keep": ["film"]}, 'keep[0] = "film"', '"history"'),
    (GRID | {"refine": {"levels": 0}}, "refine.levels = 0", "from 1 to 8"),
    (GRID | {"refine": {"levels": 1, "along": [CONDUCTANCE]}}, "refine.along", BETA),
    ({"scene": "shear", "axes": {"flow.capillary_number": [1, 2]}, "refine": {"levels": 1}}, "refine", "[field]"),
    (GRID | {"max_steps": [0, 1]}, "max_steps", "two numbers of steps"),
    (GRID | {"max_step": [1, 1]}, "max_step", "did you mean max_steps?"),
]  # fmt: skip


@pytest.mark.parametrize(("tables", "found", "expected"), BROKEN)
def test_a_broken_sweep_is_refused_in_one_line(tables, found, expected):
    with pytest.raises(SceneError) as refusal:
        plan(parse(tables))
    said = str(refusal.value)
    assert "\n" not in said and found in said and "expected" in said and expected in said.partition("expected")[2]


def test_what_is_wrong_with_a_case_marks_that_case():
    listed = {"scene": "pop", "cases": [{BETA: 1.0}, {BETA: math.nan}, {BETA: -1.0}]}
    assert set(plan(parse(listed)).refused) == {1, 2}
    assert "field.beta = nan" in plan(parse(listed)).refused[1]
    from_python = {"scene": "pop", "axes": {"vesicle.reduced_area": [0.9, 1.2, math.nan]}}
    assert set(plan(parse(from_python), strict=False).refused) == {1, 2}


def test_an_impossible_combination_of_possible_numbers_marks_its_case():
    tables = {"scene": "chain", "axes": {"pair.separation": [1.5, 2.6], "vesicle.length": [0.5, 1.0]}}
    found = plan(parse(tables))
    assert set(found.refused) == {1}
    assert "overlap" in found.refused[1]


def test_when_no_case_can_run_the_sweep_is_refused():
    with pytest.raises(SceneError, match=r"no case can run: .*nan"):
        plan(parse({"scene": "pop", "cases": [{BETA: math.nan}]}))
