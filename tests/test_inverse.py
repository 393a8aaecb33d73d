"""Derivatives checked against each other, implicit against unrolled; least squares that know what they do not know."""

import json
import math

import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxves.analysis import boxes, critical_field, descent, differences, fit, gradcheck, intervals, search, sensitivity
from jaxves.analysis.critical import NoCriticalValue
from jaxves.analysis.observations import Model, Observations, radii, shown
from jaxves.analysis.steady import steady_shape
from jaxves.cli.commands import answer
from jaxves.cli.run_summary import derivatives
from jaxves.equation.state import Unknowns
from jaxves.inputs.scene_files import parse
from jaxves.runs.build import scene_of
from jaxves.stepping.fixed import Fixed

RELAXING = {"t_end": 0.1, "vesicle": [{"reduced_area": 0.9, "angle": 70.0}], "numerics": {"nodes": 24}}


# -- differences ---------------------------------------------------------------------------------------------------


def test_central_differences_know_their_error():
    """exp and sin at 1, and a third power, which two rows give exactly."""
    found = differences.central(lambda x: np.array([np.exp(x), np.sin(x), x**3]), 1.0, 0.1)
    exact = np.array([np.e, np.cos(1.0), 3.0])
    error = np.abs(found.value - exact)
    assert np.all(error < 1e-9)
    assert np.all(error <= found.error + 1e-13)


@pytest.mark.parametrize("step", [0.05, -0.05])
def test_one_sided_differences_stay_on_their_side(step):
    """|x| at 0 has two derivatives; e^x has its own from both sides."""

    def function(x):
        assert x * step >= 0
        return np.array([abs(x), np.exp(x)])

    found = differences.one_sided(function, 0.0, step)
    np.testing.assert_allclose(found.value, [np.sign(step), 1.0], atol=1e-8)


def test_a_kink_shows_in_the_error_of_central_differences():
    found = differences.central(lambda x: np.array([max(x, 0.3)]), 0.3 + 1e-3, 0.1)
    assert found.error[0] > 1e-3  # smooth ones are known to 1e-9


# -- check-grad ----------------------------------------------------------------------------------------------------


def test_all_numbers_of_a_scene_have_the_derivative_that_differences_give():
    """Along y too, where the angle of an axis jumps by π."""
    upright = RELAXING | {"vesicle": [{"reduced_area": 0.9, "angle": 90.0}]}
    rows = list(gradcheck.check_gradients(parse(upright), 0.005, 5))
    assert {row.number for row in rows} == {
        "vesicle.angle", "vesicle.center[0]", "vesicle.center[1]", "vesicle.length", "vesicle.bending",
        "vesicle.reduced_area",
    }  # fmt: skip
    assert {row.verdict for row in rows} == {"agree"}
    turned = next(row for row in rows if (row.number, row.quantity) == ("vesicle.angle", "inclination"))
    assert abs(turned.forward - math.pi / 180) < 1e-10
    table, text = derivatives(rows)
    assert len(table.rows) == len(rows) and text.startswith(f"{len(rows)} of {len(rows)} agree, 0 disagree")


def rows_of(forward, backward, found, error):
    values = [{"a": np.array([value])} for value in (1.0, forward, backward, found, error)]
    (row,) = gradcheck._rows("n", 1.0, *values)
    return row.verdict


def test_a_disagreement_is_called_one():
    assert rows_of(2.0, 2.0, 2.0, 0.0) == "agree"
    assert rows_of(2.0, 2.0 + 1e-6, 2.0, 0.0) == "DISAGREE"
    assert rows_of(2.0, 2.0, 2.0 + 1e-5, 1e-9) == "DISAGREE"
    assert rows_of(2.0, 2.0, 2.1, 0.2).startswith("no verdict")
    assert rows_of(np.nan, 2.0, 2.0, 0.0) == "DISAGREE"
    assert rows_of(0.0, 0.0, 0.0, 0.0) == "agree"  # a number without influence


def test_derivatives_of_a_run_that_breaks_down_are_no_derivatives():
    """Neither of the run itself, nor by differences to runs that break down."""
    with pytest.raises(gradcheck.BrokenDown, match="unresolved"):
        next(gradcheck.check_gradients(parse(RELAXING | {"numerics": {"nodes": 16}}), 0.005, 5))
    beside = differences.central(lambda x: np.array([x if x <= 1.0 else np.nan]), 1.0, 0.1)
    assert rows_of(1.0, 1.0, beside.value[0], beside.error[0]) == "no verdict: runs beside this one break down"
    assert rows_of(1.0, 2.0, beside.value[0], beside.error[0]) == "DISAGREE"


def test_check_grad_refuses_bad_input_in_one_line(capsys):
    assert answer(["check-grad", "nothing.toml"]) == 2
    assert answer(["check-grad", "pop", "--t-end", "-1"]) == 2
    assert "--t-end = -1.0, expected a positive finite number" in capsys.readouterr().err


# -- steady shapes -------------------------------------------------------------------------------------------------


def test_the_energy_of_a_shape_at_rest_scales_back_with_its_size():
    """Newton's method from an ellipse to the shape of least bending energy; scaling it scales its energy back.

    To what 16 nodes leave of the equations, which are more than the unknowns: 1.5e-5 of the energy.
    """
    file = parse({"t_end": 0.1, "vesicle": [{"reduced_area": 0.95}], "numerics": {"nodes": 16}})
    rest = sensitivity.AtRest(file, ("bending_energy", "deformation"), Unknowns.of(scene_of(file, {}).x))
    values = {"vesicle.length": 1.0, "vesicle.reduced_area": 0.95}
    found, slopes = sensitivity.jacobian(rest, values)
    np.testing.assert_allclose(slopes["bending_energy"]["vesicle.length"], -found["bending_energy"], rtol=1e-4)


def test_a_steady_shape_that_is_not_found_has_no_diagnostics():
    """From an outline folded by its eighth mode, Newton's method goes astray."""
    file = parse({"t_end": 0.1, "vesicle": [{"reduced_area": 0.95}], "numerics": {"nodes": 32}})
    scene = scene_of(file, {})
    folded = scene.x * (1 + 0.5 * jnp.cos(8 * 2 * jnp.pi * jnp.arange(32) / 32))[:, None]
    lost = steady_shape(scene, Unknowns.of(folded))
    assert not lost.converged
    assert np.isnan(lost.diagnostics["bending_energy"]).all()


def test_a_steady_shape_is_sought_of_one_vesicle():
    two = [{"reduced_area": 0.9}, {"reduced_area": 0.9, "center": [4.0, 0.0]}]
    scene = scene_of(parse(RELAXING | {"vesicle": two}), {})
    with pytest.raises(ValueError, match="one vesicle, but the scene has 2"):
        steady_shape(scene, Unknowns.of(scene.x))


# -- sensitivities -------------------------------------------------------------------------------------------------


def quadratic(values):
    return {"a": values["p"] ** 2 * values["q"] + jnp.array([0.0, 1.0]) * values["q"]}


def test_jacobian_and_second_order_of_a_polynomial():
    values = {"q": 3.0, "p": 2.0}
    for reverse in (False, True):
        outputs, slopes = sensitivity.jacobian(quadratic, values, reverse=reverse)
        np.testing.assert_allclose(outputs["a"], [12.0, 15.0])
        np.testing.assert_allclose(slopes["a"]["p"], [12.0, 12.0])
        np.testing.assert_allclose(slopes["a"]["q"], [4.0, 5.0])
    second = sensitivity.second_order(quadratic, values)["a"]
    np.testing.assert_allclose(second["p", "p"], [6.0, 6.0])
    np.testing.assert_allclose(second["p", "q"], second["q", "p"])
    np.testing.assert_allclose(second["q", "p"], [4.0, 4.0])
    with pytest.raises(ValueError, match="expected one number"):
        sensitivity.gradient(quadratic, values)
    slope = sensitivity.gradient(lambda values: values["p"] ** 2 * values["q"], values)
    assert slope == {"p": 12.0, "q": 4.0}


# -- the critical field --------------------------------------------------------------------------------------------


def test_the_least_deformation_is_found_between_saves():
    t = np.linspace(0, 1, 21)
    instant, value = critical_field.least(t, np.cosh(4 * (t - 0.43)) - 2)
    assert abs(instant - 0.43) < 1e-4 and abs(value + 1) < 1e-6


def test_a_bracket_without_a_boundary_is_refused():
    field = {"beta": 1.0, "conductivity_ratio": 0.1}
    file = parse(RELAXING | {"field": field, "saves": 5, "vesicle": [{"reduced_area": 0.9, "angle": 90.0}]})
    with pytest.raises(NoCriticalValue, match="least deformations are 0"):
        critical_field.critical_field(file, (0.1, 0.2), march=Fixed(4))
    with pytest.raises(NoCriticalValue, match="a critical field needs a field"):
        critical_field.critical_field(parse(RELAXING), (0.1, 0.2))


# -- fits ----------------------------------------------------------------------------------------------------------


def test_boxes_are_searched_in_logarithms_where_positive():
    inside = boxes.boxes({"a": (0.1, 10.0), "b": (-1.0, 3.0)})
    values = {"a": 0.7, "b": 2.0}
    c = boxes.to_coordinates(values, inside)
    back = boxes.to_values(jnp.asarray(c), inside)
    assert {name: pytest.approx(float(back[name])) for name in values} == values
    assert c == pytest.approx([np.log(0.7), 0.75])
    moved = boxes.to_values(jnp.asarray(c + 1e-6), inside)
    slope = [(float(moved[name]) - values[name]) / 1e-6 for name in values]
    np.testing.assert_allclose(boxes.slopes(values, inside), slope, rtol=1e-4)
    with pytest.raises(ValueError, match=r"a = \(2.0, 1.0\)"):
        boxes.boxes({"a": (2.0, 1.0)})
    with pytest.raises(ValueError, match="expected a number inside"):
        boxes.to_coordinates({"a": 20.0, "b": 0.0}, inside)


def test_bending_is_found_from_a_relaxation_and_a_place_that_nothing_tells_is_named(tmp_path):
    """From three times too stiff; deformation says nothing about where the vesicle is."""
    file = parse(RELAXING | {"vesicle": [{"reduced_area": 0.9, "bending": 3.0}]})
    march, noise = Fixed(2), 1e-4
    blank = Observations(0.02, {"deformation": np.zeros((8, 1))}, {"deformation": noise})

    def deformation(bending):
        return shown(Model.of(file, blank, march), {"vesicle.bending": bending})["deformation"]

    seen = deformation(1.0) + noise * np.random.default_rng(0).normal(size=(8, 1))
    observations = blank._replace(seen={"deformation": seen})
    bounds = {"vesicle.bending": (0.1, 10.0), "vesicle.center[0]": (-1.0, 1.0)}
    kept = tmp_path / "starts.json"
    told = []
    found = fit.fit(
        file, bounds, observations, starts=1, march=march, checkpoint=kept, progress=lambda *call: told.append(call)
    )
    assert len(told) == found.starts[0].iterations + 1  # each run, and the end of the start
    assert told[0][:2] == (0, 1) and told[0][2].startswith("start 1 of 1, run 1: χ² = ")
    assert told[-1] == (1, 1, f"start 1 of 1 is done: χ² = {found.chi2:.6g}")
    low, high = found.intervals["vesicle.bending"]
    assert low < 1.0 < high
    best = found.values["vesicle.bending"]
    slope = np.linalg.norm(deformation(1.01 * best) - deformation(0.99 * best)) / np.log(1.01 / 0.99)
    assert np.log(high / low) / 2 == pytest.approx(intervals.NORMAL_95 * noise / slope, rel=1e-3)
    assert found.chi2 < 25 and found.observations == 8
    assert found.loose == ("+1.00 vesicle.center[0]",) and found.intervals["vesicle.center[0]"] is None
    assert "not determined alone" in str(found)
    assert found.starts[0].converged

    stored = json.loads(kept.read_text())
    stored["starts"][0]["iterations"] = -7  # so that it shows that nothing was searched again
    kept.write_text(json.dumps(stored))
    told.clear()
    again = fit.fit(
        file, bounds, observations, starts=1, march=march, checkpoint=kept, progress=lambda *call: told.append(call)
    )
    assert len(told) == 1
    assert again.starts[0].iterations == -7 and again.values == found.values
    with pytest.raises(ValueError, match="of the same scene, bounds and observations"):
        fit.fit(file, {"vesicle.bending": (0.1, 9.0)}, observations, starts=1, march=march, checkpoint=kept)


def test_gradient_descent_finds_what_the_trust_region_finds(tmp_path):
    """Bending and, on the edge of what is asked, a length whose best value is out of its bounds."""
    file = parse(RELAXING | {"vesicle": [{"reduced_area": 0.9, "bending": 3.0}]})
    march, noise = Fixed(2), 1e-4
    blank = Observations(0.02, {"deformation": np.zeros((8, 1))}, {"deformation": noise})
    seen = shown(Model.of(file, blank, march), {"vesicle.bending": 1.0})["deformation"]
    observations = blank._replace(seen={"deformation": seen + noise * np.random.default_rng(0).normal(size=(8, 1))})
    how = {"starts": 1, "march": march, "max_steps": 300}
    bounds = {"vesicle.bending": (0.1, 10.0)}
    trusted = fit.fit(file, bounds, observations, **how)
    kept = tmp_path / "starts.json"
    told = []
    descended = fit.fit(
        file, bounds, observations, **how, method=optax.adam(0.1), checkpoint=kept,
        progress=lambda *call: told.append(call),
    )  # fmt: skip
    assert len(told) == descended.starts[0].iterations + 1
    (low, high), best = trusted.intervals["vesicle.bending"], trusted.values["vesicle.bending"]
    assert abs(descended.values["vesicle.bending"] - best) < 1e-2 * (high - low)
    np.testing.assert_allclose(descended.intervals["vesicle.bending"], (low, high), rtol=1e-3)
    assert descended.starts[0].converged and descended.starts[0].iterations < 300
    assert descended.chi2 == pytest.approx(trusted.chi2, rel=1e-4)

    again = fit.fit(file, bounds, observations, **how, method=optax.adam(0.1), checkpoint=kept)
    assert again.starts == descended.starts
    with pytest.raises(ValueError, match="of the same scene, bounds and observations"):
        fit.fit(file, bounds, observations, **how, method=optax.adam(0.2), checkpoint=kept)

    held = fit.fit(file, {"vesicle.bending": (2.0, 10.0)}, observations, **how, method=optax.adam(0.1))
    assert held.values["vesicle.bending"] == pytest.approx(2.0, rel=1e-5) and held.starts[0].converged


def test_a_descent_that_runs_into_a_breakdown_makes_shorter_steps(monkeypatch):
    """On a parabola about 0.3 whose runs break down below 0.25; the first step would end at 0.2, half of it at 0.35."""
    tried = []

    def parabola(c, target):
        tried.append(float(c[0]))
        return jnp.where(c < 0.25, jnp.nan, 100 * (c - 0.3)), jnp.array([[100.0]])

    monkeypatch.setattr(descent, "linearised", parabola)
    target = search.Target(None, (("a", boxes.Box(0.0, 1.0)),), {}, {})
    method = optax.sgd(1.5e-4)
    found = descent.descent({"a": 0.5}, target, 1e-8, 100, method=method)
    np.testing.assert_allclose(tried[:3], [0.5, 0.2, 0.35], rtol=1e-12)
    assert found.converged and found.iterations == len(tried) < 30
    assert found.ended["a"] == pytest.approx(0.3, abs=1e-6)
    short = descent.descent({"a": 0.5}, target, 1e-8, 3, method=method)
    assert not short.converged and short.iterations == 3 and short.ended["a"] == pytest.approx(0.35)
    nowhere = descent.descent({"a": 0.1}, target, 1e-8, 3, method=method)
    assert not nowhere.converged and nowhere.chi2 == math.inf and nowhere.iterations == 1


def test_a_start_with_which_the_run_breaks_down_leads_nowhere_and_the_others_count():
    """A tiny vesicle is too stiff for these few steps; from one twice too long the length is found."""
    file = parse(RELAXING | {"vesicle": [{"reduced_area": 0.9}]})
    march = Fixed(2)
    blank = Observations(0.02, {"deformation": np.zeros((8, 1))}, {"deformation": 1e-4})
    model = Model.of(file, blank, march)
    seen = shown(model, {"vesicle.length": 1.0})
    bounds = {"vesicle.length": (0.01, 100.0)}
    observed = blank._replace(seen=seen)
    found = fit.fit(file, bounds, observed, starts=[{"vesicle.length": 0.02}, {"vesicle.length": 2.0}], march=march)
    assert found.values["vesicle.length"] == pytest.approx(1.0, rel=1e-4)
    assert not np.isfinite(found.starts[0].chi2) and not found.starts[0].converged


def test_observations_without_a_deviation_are_refused():
    observations = Observations(0.1, {"deformation": np.zeros((3, 1))}, {})
    with pytest.raises(ValueError, match="deformation is missing, expected a positive number"):
        fit.fit(parse(RELAXING), {"vesicle.bending": (0.1, 10.0)}, observations)


def test_radii_of_an_ellipse():
    alpha = 2 * np.pi * np.arange(64) / 64
    x = jnp.asarray(np.stack([2 * np.cos(alpha) + 1, np.sin(alpha)], axis=-1))[None]
    found = radii(x, 4)
    np.testing.assert_allclose(found, [[2.0, 1.0, 2.0, 1.0]], atol=1e-3)
