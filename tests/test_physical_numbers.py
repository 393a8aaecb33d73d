"""Every physical number is declared once; what the other parts of the package say of it follows from that."""

import inspect
import math
import re

import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser

import jaxves
from jaxves.base.physical_numbers import NUMBERS, PER_VESICLE, declared
from jaxves.cli.units_report import tables
from jaxves.geometry import shapes
from jaxves.inputs import scene_tables, vesicle_tables
from jaxves.inputs.checking import SceneError, Table
from jaxves.inputs.parameters import numbers, with_numbers
from jaxves.inputs.scene_files import parse
from jaxves.inputs.template import TEMPLATE
from jaxves.physics.units import Numbers
from jaxves.plots.sweep_plots import axis_label

NAN, INF = float("nan"), float("inf")
E = shapes.ellipse(16, 0.9)
FIELD = {"beta": 1.0, "conductivity_ratio": 0.1}
PULSE = {"kind": "pulse", "start": 0.1, "duration": 0.5, "rise": 0.1}
SINE = {"kind": "sine", "frequency": 1.0, "amplitude": 1.0, "offset": 0.0, "phase": 0.0}
named = pytest.mark.parametrize("number", NUMBERS, ids=lambda number: number.name)

# What Python is given for the numbers of the file. A new number must be added here.
PYTHON = {
    "vesicle.angle": lambda v: shapes.ellipse(16, 0.9, angle=v),
    "vesicle.length": lambda v: shapes.ellipse(16, 0.9, length=v),
    "vesicle.bending": lambda v: jaxves.make_scene(E, bending=v),
    "vesicle.disturbance": lambda v: shapes.disturbed(E, v),
    "vesicle.disturbance.temperature": lambda v: shapes.undulated(E, temperature=v, modes=4),
    "vesicle.disturbance.tension": lambda v: shapes.undulated(E, temperature=0.01, tension=v, modes=4),
    "vesicle.reduced_area": lambda v: shapes.ellipse(16, v),
    "field.beta": lambda v: jaxves.dc_field(v, conductivity_ratio=0.1),
    "field.conductivity_ratio": lambda v: jaxves.dc_field(1.0, conductivity_ratio=v),
    "field.membrane_conductance": lambda v: jaxves.dc_field(1.0, conductivity_ratio=0.1, membrane_conductance=v),
    "field.chi": lambda v: jaxves.dc_field(1.0, conductivity_ratio=0.1, chi=v),
    "field.permittivity_ratio": lambda v: jaxves.dc_field(1.0, conductivity_ratio=0.1, permittivity_ratio=v),
    "field.charge_relaxation": lambda v: jaxves.dc_field(1.0, conductivity_ratio=0.1, charge_relaxation=v),
    "field.time.start": lambda v: jaxves.Pulse(v, 1.0, 0.1),
    "field.time.duration": lambda v: jaxves.Pulse(0.0, v, 0.1),
    "field.time.rise": lambda v: jaxves.Pulse(0.0, 1.0, v),
    "field.time.frequency": lambda v: jaxves.Sine(v),
    "field.time.amplitude": lambda v: jaxves.Sine(1.0, amplitude=v),
    "field.time.offset": lambda v: jaxves.Sine(1.0, offset=v),
    "field.time.phase": lambda v: jaxves.Sine(1.0, phase=v),
    "fluid.viscosity_ratio": lambda v: jaxves.make_scene(E, viscosity_ratio=v),
    "flow.capillary_number": lambda v: jaxves.Shear(v),
    "flow.half_width": lambda v: jaxves.Poiseuille(1.0, v),
}
ONLY_FILES = {"pair.separation", "pair.offset_angle"}  # Python gives the centers of the two vesicles


def scene_file(number, value, of_vesicle=False):
    """The smallest scene file that has this number."""
    tables = {"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}]}
    if number.table == "vesicle" or of_vesicle:
        tables["vesicle"][0][number.key] = value
    if number.table == "vesicle.disturbance":
        tables["vesicle"][0]["disturbance"] = {"temperature": 0.01, "modes": 4} | {number.key: value}
    if number.table.startswith("field"):
        tables["field"] = FIELD | ({number.key: value} if number.table == "field" and not of_vesicle else {})
    if number.table == "field.time":
        time = PULSE if number.key in PULSE else SINE
        tables["field"]["time"] = time | {number.key: value}
    if number.table == "pair":
        tables["pair"] = {"separation": 3.0} | {number.key: value}
    if number.table == "fluid" and not of_vesicle:
        tables["fluid"] = {number.key: value}
    if number.table == "flow":
        tables["flow"] = {"kind": "shear", number.key: value}
        if number.key == "half_width":
            tables["flow"] |= {"kind": "poiseuille", "capillary_number": 1.0}
    return parse(tables)


def outside(bounds):
    """Numbers just out of bounds."""
    found = [NAN, -INF]
    found += [bounds.gt] if bounds.gt is not None else []
    found += [math.nextafter(bounds.ge, -INF)] if bounds.ge is not None else []
    found += [math.nextafter(bounds.le, INF)] if bounds.le is not None else []
    found += [INF] if bounds.finite else []
    return found + ([0.0] if bounds.nonzero else [])


def inside(number):
    """A number within bounds that is not the default."""
    return 0.7 if number.key != "separation" else 3.1


@named
def test_the_scene_file_has_the_number_with_its_default_and_its_bounds(number):
    """Values within the bounds are taken, all others are refused in the words of the bounds."""
    value = inside(number)
    assert numbers(scene_file(number, value))[number.name] == value
    for value in outside(number.bounds):
        with pytest.raises(SceneError, match=re.escape(number.key)) as refused:
            scene_file(number, value)
        assert number.bounds.expected in str(refused.value) and "\n" not in str(refused.value)
        if number.per_vesicle is not None:
            with pytest.raises(SceneError, match=re.escape(number.bounds.expected)):
                scene_file(number, value, of_vesicle=True)


@named
def test_python_refuses_what_the_scene_file_refuses(number):
    if number.name in ONLY_FILES:
        return
    PYTHON[number.name](inside(number))
    for value in outside(number.bounds):
        with pytest.raises(ValueError, match=re.escape(f"= {np.asarray(value)}")):
            PYTHON[number.name](value)


def test_every_number_is_given_to_python_or_is_known_to_be_of_files_alone():
    assert {number.name for number in NUMBERS} == {*PYTHON, *ONLY_FILES}


def all_tables(module):
    return [t for _, t in inspect.getmembers(module, inspect.isclass) if issubclass(t, Table) and t is not Table]


PLACE = {
    "VesicleTable": "vesicle", "DeformableVesicle": "vesicle", "EllipseVesicle": "vesicle", "CircleVesicle": "vesicle",
    "PointsVesicle": "vesicle", "UndulationTable": "vesicle.disturbance",
    "PairTable": "pair", "FieldTable": "field", "TimeTable": "field.time",
    "ConstantTime": "field.time", "PulseTime": "field.time", "SineTime": "field.time",
    "AcTime": "field.time", "TabulatedTime": "field.time",
    "FluidTable": "fluid", "FlowTable": "flow", "ShearFlow": "flow", "ExtensionFlow": "flow", "LinearFlow": "flow",
    "PoiseuilleFlow": "flow",
}  # fmt: skip
NOT_PHYSICAL = {"SceneFile", "NumericsTable", "StopTable", "CellTable", "SuspensionTable"}
# Vectors, lists, words and tables.
OTHER_KEYS = {
    "shape", "kind", "center", "relaxed", "file", "points", "modes", "seed", "flip_y", "direction", "time", "gradient",
    "times", "values", "averaged",
}  # fmt: skip


@pytest.mark.parametrize("table", all_tables(scene_tables) + all_tables(vesicle_tables))
def test_every_number_of_a_table_is_declared(table):
    if table.__name__ in NOT_PHYSICAL:
        return
    place = PLACE[table.__name__]
    for key in set(table.model_fields) - OTHER_KEYS:
        number = declared(f"{place}.{key}")
        assert number is not None, key
        is_own = number.table in ("field", "fluid") and place == "vesicle"
        assert table.model_fields[key].default == (None if is_own else number.default)


@pytest.mark.parametrize("function", [jaxves.dc_field, jaxves.make_scene, jaxves.ellipse, jaxves.circle, jaxves.Sine])
def test_defaults_in_python_are_those_of_the_file(function):
    found = 0
    for key, parameter in inspect.signature(function).parameters.items():
        for number in NUMBERS:
            # Angles are in radians in Python, and 0 in both.
            if number.key == key and number.default is not None and parameter.default is not inspect.Parameter.empty:
                assert parameter.default == number.default
                found += 1
    assert found > 0


@pytest.mark.parametrize("number", PER_VESICLE, ids=lambda number: number.name)
def test_a_vesicle_may_have_an_electrical_number_of_its_own(number):
    scene = jaxves.scene_of(scene_file(number, 0.6), {})
    np.testing.assert_array_equal(getattr(scene.field, number.per_vesicle), [0.6])
    own = jaxves.scene_of(with_numbers(scene_file(number, 0.6), {f"vesicle.{number.key}": 0.5}), {})
    np.testing.assert_array_equal(getattr(own.field, number.per_vesicle), [0.5])
    assert declared(f"vesicle.{number.key}") is declared(f"vesicle[1].{number.key}") is number


def test_a_vesicle_may_have_a_viscosity_of_its_own():
    file = scene_file(declared("fluid.viscosity_ratio"), 0.6)
    np.testing.assert_array_equal(jaxves.scene_of(file, {}).viscosity_ratio, [0.6])
    own = jaxves.scene_of(with_numbers(file, {"vesicle.viscosity_ratio": 0.5}), {})
    np.testing.assert_array_equal(own.viscosity_ratio, [0.5])
    without = parse({"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}]})
    assert jaxves.scene_of(without, {}).viscosity_ratio is None


@named
def test_the_commented_scene_file_shows_the_number_and_what_it_means(number):
    lines = re.findall(rf"^(?:# |## )?{number.key} = (\S+) +# (.*)$", TEMPLATE, re.MULTILINE)
    ((example, comment),) = [found for found in lines if number.description() in found[1]]
    assert bool(number.bounds.hold(float(example))) and comment.startswith(number.description())
    assert number.default is None or number.example is not None or float(example) == number.default


@named
def test_plots_have_a_label_for_the_number(number):
    label = axis_label(number.name)
    assert label == number.label() and number.symbol
    MathTextParser("path").parse(label)


def test_the_name_of_one_vesicle_or_of_an_entry_is_its_label():
    assert axis_label("vesicle[1].reduced_area") == "vesicle[1].reduced_area"
    assert axis_label("field.direction[0]") == "field.direction[0]" and declared("field.direction[0]") is None


def test_the_numbers_from_the_laboratory_are_declared_under_their_keys():
    found = {name: 0.5 for name in vars(Numbers(1.0, 1.0, 1.0))}
    file = parse({"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}]} | tables(found))
    for name in found:
        assert numbers(file)[f"{'flow' if name == 'capillary_number' else 'field'}.{name}"] == 0.5


def test_differences_are_one_sided_only_where_the_bounds_end():
    assert {number.key for number in NUMBERS if number.lowest == 0.0} == {
        "beta", "conductivity_ratio", "membrane_conductance", "tension",
    }  # fmt: skip
    assert {number.key for number in NUMBERS if number.size == 10.0} == {
        number.key for number in NUMBERS if number.unit == "degrees"
    }
