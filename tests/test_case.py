"""Every key of a scene file means the same in every use, or is refused: a test for each pair of key and use."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.analysis import critical_field, fold, gradcheck, sensitivity
from jaxves.analysis.observations import Model, Observations
from jaxves.analysis.steering import steer
from jaxves.equation import equation
from jaxves.inputs import uses
from jaxves.inputs.scene_files import SceneError, parse, to_toml
from jaxves.inputs.scene_tables import NumericsTable
from jaxves.inputs.sweep_files import parse as parse_sweep
from jaxves.inputs.vesicle_tables import CircleVesicle, EllipseVesicle, PointsVesicle
from jaxves.runs import case as case_module
from jaxves.runs.build import scene_of
from jaxves.runs.case import Case
from jaxves.stepping import marching
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.fixed import Fixed
from jaxves.sweeps.case_summary import outcome

POINTS = [[float(2 * np.cos(a)), float(np.sin(a))] for a in np.linspace(0, 2 * np.pi, 40, endpoint=False)]
VESICLE = {"reduced_area": 0.9, "angle": 30.0}
FIELD = {"beta": 3.2, "conductivity_ratio": 0.1}
PAIR = {"separation": 3.0}

# A value for each key that is not its default, and which uses refuse it.
NUMERICS = {
    "nodes": ("auto", {use for use in uses.USES if use is not uses.RUN}),
    "tolerance": (1e-5, set()),
    "time_step": (1e-3, set()),
    "method": ("ark5", set()),
    "solver": ("matrix-free", set()),
    "neighbours": (1, set()),
    "certify": (True, {use for use in uses.USES if use is not uses.RUN}),
}
KEYS = {
    "angle": 40.0,
    "center": [0.3, 0.2],
    "length": 1.3,
    "bending": 2.0,
    "relaxed": True,
    "conductivity_ratio": 0.3,
    "membrane_conductance": 0.5,
    "chi": 0.2,
    "permittivity_ratio": 2.0,
    "viscosity_ratio": 3.0,
    "disturbance": 1e-4,
    "reduced_area": 0.8,
}


def scene_file(numerics=None, vesicle=None, **tables):
    found = {"t_end": 0.02, "saves": 4, "vesicle": [VESICLE | (vesicle or {})], "field": FIELD}
    return parse(found | tables | {"numerics": {"nodes": 32} | (numerics or {})})


def begin(use, file):
    """What a user calls first in this use; returns the case that it computes, where it has one."""
    observations = Observations(0.01, {"deformation": np.zeros((1, 1))}, {"deformation": 1.0})
    match use:
        case uses.RUN:
            return Case.of(file, use)
        case uses.SWEEP:
            return parse_sweep({"scene": file, "axes": {"field.beta": [1.0]}})
        case uses.SENSITIVITY:
            return sensitivity.AtEnd(file, ("deformation",))
        case uses.FIT:
            return Model.of(file, observations)
        case uses.CRITICAL_FIELD:
            return critical_field.critical_field(file, (1.0, 1.0))
        case uses.FOLD:
            return fold.critical_value(file, "field.beta")
        case uses.GRADIENT_CHECK:
            return next(gradcheck.check_gradients(file, -1.0, 1), None)
        case uses.CONTROL:
            return steer(file, "deformation", 0.1)


@pytest.mark.parametrize("use", uses.USES, ids=lambda use: use.name)
@pytest.mark.parametrize("key", NUMERICS)
def test_a_use_that_cannot_honour_a_key_refuses_it(key, use):
    value, refused = NUMERICS[key]
    if use in refused:
        with pytest.raises(SceneError, match=rf"numerics\.{key} = .*expected.*{use.name}"):
            begin(use, scene_file({key: value}))
    else:
        Case.of(scene_file({key: value}), use)


@pytest.mark.parametrize("use", uses.USES, ids=lambda use: use.name)
def test_a_run_adapts_its_nodes_and_every_other_use_has_64_if_the_file_does_not_say(use):
    nodes = Case.of({"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}]}, use).scene_file.numerics.nodes
    assert nodes == ("auto" if use is uses.RUN else 64)
    assert Case.of(scene_file({"nodes": 20}), use).scene_file.numerics.nodes == 20


def test_functions_of_the_numbers_of_a_scene_know_their_nodes():
    file = {"t_end": 1.0, "vesicle": [{"reduced_area": 0.9}]}
    outcomes = [sensitivity.AtEnd(file, ("deformation",))]
    outcomes.append(Model.of(parse(file), Observations(0.01, {"deformation": np.zeros((1, 1))}, {"deformation": 1.0})))
    assert [outcome.scene_file.numerics.nodes for outcome in outcomes] == [64, 64]


@pytest.mark.parametrize("use", uses.USES, ids=lambda use: use.name)
def test_an_early_end_is_honoured_or_refused(use):
    file = scene_file(stop={"steady": 1e-3})
    if use.stop:
        assert float(Case.of(file, use).checks().steady) == 1e-3
    else:
        with pytest.raises(SceneError, match=f"stop, .*{use.name}"):
            begin(use, file)


def test_the_tables_here_have_every_key():
    """A new key of [numerics] or [[vesicle]] must be added above, and thought of in every use."""
    assert set(NUMERICS) == set(NumericsTable.model_fields)
    known = {name for kind in (EllipseVesicle, CircleVesicle, PointsVesicle) for name in kind.model_fields}
    assert known - set(KEYS) <= {"shape", "file", "points", "modes", "flip_y"}


def test_what_numerics_asks_for_is_what_every_use_computes_with(monkeypatch):
    """Solver and coupling of the equation behind a run, a sweep, a sensitivity, a fit and a critical field."""
    seen = []
    equation_for = equation.equation_for

    def watched(scene, **how):
        seen.append((type(how["solver"]).__name__, type(how["coupling"]).__name__, how["coupling"]))
        return equation_for(scene, **how)

    for module in (case_module, marching):
        monkeypatch.setattr(module, "equation_for", watched)
    numerics = {"solver": "matrix-free", "neighbours": 3, "time_step": 0.02}
    file = scene_file(numerics, pair=PAIR)
    case = Case.of(file, uses.SWEEP)
    outcome(case, (), case.march(), case.scene({}))
    outcomes = [sensitivity.AtEnd(file, ("deformation",), 0.01)]
    observations = Observations(0.01, {"deformation": np.zeros((1, 2))}, {"deformation": 1.0})
    outcomes.append(Model.of(file, observations))
    for found in outcomes:
        eqx.filter_eval_shape(found, {"field.beta": jnp.asarray(1.0)})
    assert len(seen) >= 2  # sensitivities and fits march in the same way, and may share a program
    for _, coupling, how in seen:
        assert coupling == "MatrixFree" and how.neighbours == 3


def test_a_time_step_is_the_same_however_many_instants_are_saved():
    """A sensitivity saves its end alone: the step must not grow with that."""
    case = Case.of(scene_file({"time_step": 1e-3}), uses.SENSITIVITY)
    assert case.march() == Fixed(5)  # 0.02/4 per save
    assert case.march(0.02, 1) == Fixed(20)
    assert case.march(0.01, 1) == Fixed(10)
    assert sensitivity.AtEnd(case.scene_file, ("area",))._march() == Fixed(20)
    assert isinstance(Case.of(scene_file(), uses.FIT).march(), Adaptive)


@pytest.mark.parametrize("key", sorted(set(KEYS) - {"relaxed", "center"}))
def test_every_number_of_a_vesicle_reaches_the_scene_of_every_use(key):
    """As a value of the file and as a free number the scene is the same, which all uses take from `Case`."""
    file = scene_file(vesicle={key: KEYS[key]})
    usual = scene_file(vesicle={"disturbance": 1e-6} if key == "disturbance" else None)
    freed = scene_of(usual, {f"vesicle.{key}": KEYS[key]})
    assert bool(eqx.tree_equal(freed, Case(file).scene({}), rtol=1e-12, atol=1e-12))
    assert not bool(eqx.tree_equal(freed, Case(scene_file()).scene({}), rtol=1e-12, atol=1e-12))


def test_a_relaxed_start_is_relaxed_in_sensitivities_and_fits():
    """At rest D differs from that of the ellipse, and both uses start there; the derivative is that of differences."""
    file = scene_file(vesicle={"relaxed": True}, t_end=1e-4)
    case, march = Case.of(file, uses.FIT), Fixed(1)

    @eqx.filter_jit
    def start(area):
        result = case.simulate({"vesicle.reduced_area": area}, saves=1, march=march)
        return result.diagnostics["deformation"][0, 0]

    area = jnp.asarray(0.9)
    ellipse = Case(scene_file(t_end=1e-4)).simulate({}, saves=1, march=march).diagnostics["deformation"][0, 0]
    assert abs(start(area) - ellipse) > 1e-3
    _, slope = eqx.filter_jvp(start, (area,), (jnp.asarray(1.0),))
    h = 1e-3
    assert abs(slope - (start(area + h) - start(area - h)) / (2 * h)) < 1e-3 * abs(slope)


def test_a_scene_is_read_from_a_name_a_file_tables_or_what_was_read(tmp_path):
    tables = {"t_end": 0.02, "saves": 4, "vesicle": [VESICLE], "field": FIELD, "numerics": {"nodes": 32}}
    file = parse(tables)
    (tmp_path / "scene.toml").write_text(to_toml(file))
    for source in (file, tables, tmp_path / "scene.toml", str(tmp_path / "scene.toml")):
        assert Case.of(source, uses.RUN).scene_file == file
        assert sensitivity.AtEnd(source, ("deformation",)).scene_file == file
    assert Case.of("pop", uses.RUN).scene_file.field.beta == 3.2
