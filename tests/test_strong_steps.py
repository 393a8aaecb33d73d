"""Steps, grids and warnings for strong fields and flows."""

import tomllib

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.equation import norms
from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.geometry.curve import Curve
from jaxves.inputs.scene_files import parse
from jaxves.inputs.uses import RUN
from jaxves.observables.wrinkles import missed_wrinkles
from jaxves.physics import membrane
from jaxves.physics.flow import Extension
from jaxves.physics.scene import make_scene
from jaxves.potentials.self_refined import Refinement
from jaxves.runs.case import Case
from jaxves.runs.strength import stress, strong_steps
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.marching import simulate


def scene_file(text):
    return parse(tomllib.loads("t_end = 0.1\n[[vesicle]]\nreduced_area = 0.9\n" + text))


def test_the_growth_rate_is_the_largest_of_all_waves():
    curve, bending, sigma = Curve.from_nodes(shapes.circle(32, length=2.0)), 1.5, -700.0
    q = np.linspace(0, 25, 200_001)
    rates = (-sigma * q - bending * q**3) / 4
    found = membrane.wrinkle_growth(curve, jnp.full(32, sigma), jnp.asarray(bending))
    assert float(found) == pytest.approx(rates.max(), rel=1e-8)
    waves = membrane.fastest_wrinkle(curve, jnp.full(32, sigma), jnp.asarray(bending))
    assert float(waves) == pytest.approx(2.0 * q[rates.argmax()], rel=1e-4)
    assert float(membrane.wrinkle_growth(curve, jnp.full(32, 3.0), jnp.asarray(bending))) == 0


def test_steps_follow_the_growth_of_the_fastest_wrinkle():
    """No step may be longer than 0.05 growth times; at this tolerance errors alone would allow a few long steps."""
    scene = make_scene(shapes.ellipse(32, 0.95, angle=jnp.pi / 2), flow=Extension(12.0))
    march = Adaptive(1e-2, per_growth=0.05, first=2e-5)
    result = simulate(scene, 2e-3, saves=2, march=march)
    assert result.word == "complete"
    compression = -np.max(np.asarray(result.diagnostics["tension_min"]))  # at its weakest
    growth = compression**1.5 / (6 * np.sqrt(3))
    assert int(result.state.steps) >= 2e-3 * growth / 0.05 > 6
    assert float(march.first_step()) == 2e-5


def test_wrinkles_on_a_viscous_vesicle_grow_as_slowly_as_its_fluids_allow():
    """The force of a wave moves both fluids, so that its rate is that at equal viscosities over their mean."""
    equation = equation_for(make_scene(shapes.ellipse(32, 0.95, angle=jnp.pi / 2), flow=Extension(12.0)))
    y = equation.start()
    frozen = eqx.filter_jit(equation.freeze)(jnp.zeros(()), y)
    equal = float(norms.fastest_growth(equation, frozen))
    for ratio, factor in ((1.0, 1.0), (9.0, 0.2), (1e8, 2e-8), (1e-6, 2.0)):
        contrast = eqx.tree_at(
            lambda e: e.scene.viscosity_ratio, equation, jnp.array([ratio]), is_leaf=lambda leaf: leaf is None
        )
        assert float(norms.fastest_growth(contrast, frozen)) == pytest.approx(factor * equal, rel=1e-5) != 0


def test_only_strong_fields_and_flows_change_the_steps():
    for weak in (
        "[field]\nbeta = 3.2\nconductivity_ratio = 0.1\n",
        "[flow]\nkind = 'shear'\ncapillary_number = 50.0\n",
        "",
    ):
        march = Case.of(scene_file(weak), RUN).march()
        assert march.per_growth is None and march.first is None
    strong = {
        "[field]\nbeta = 0.1\nconductivity_ratio = 0.1\nchi = 1e-5\n": 1e-7,  # charged within χ
        "[field]\nbeta = 10.0\nconductivity_ratio = 0.1\nchi = 1e-3\n": 1e-6,  # deformed within 1/B
        "[flow]\nkind = 'extension'\ncapillary_number = -1e3\n": 2.5e-6,
        "[flow]\nkind = 'linear'\ngradient = [[0.0, 0.0], [4e3, 0.0]]\n": 6.25e-7,
    }
    for text, first in strong.items():
        march = Case.of(scene_file(text), RUN).march()
        assert march.per_growth == 2 and float(march.first) == pytest.approx(first)


def test_factors_of_time_and_soft_or_large_vesicles_make_a_field_strong():
    field, flow = "[field]\nbeta = 3.2\nconductivity_ratio = 0.1\n", "[flow]\nkind = 'shear'\ncapillary_number = 10.0\n"
    assert stress(scene_file(field)) == 40 == stress(scene_file(flow))
    factors = {
        field + "[field.time]\nkind = 'ac'\nfrequency = 1.0\namplitude = -3.0\noffset = 1.0\n": 16,
        field + "[field.time]\nkind = 'table'\ntimes = [0.0, 0.1]\nvalues = [1.0, -10.0]\n": 100,
        field + "[field.time]\nkind = 'pulse'\nstart = 0.0\nduration = 0.1\n": 1,
        flow + "[flow.time]\nkind = 'sine'\nfrequency = 1.0\namplitude = 20.0\n": 20,
        field.replace("beta", "permittivity_ratio = 30.0\nbeta"): 30,
        field.replace("beta", "permittivity_ratio = 0.1\nbeta"): 1,
        "bending = 0.01\n" + field: 100,
        "length = 2.0\n" + flow: 8,
        flow.replace("shear", "poiseuille") + "half_width = 0.5\n": 8,
    }
    for text, factor in factors.items():
        assert stress(scene_file(text)) == pytest.approx(40 * factor)
        assert bool(strong_steps(scene_file(text))) == (40 * factor > 300)
    soft = strong_steps(scene_file("bending = 0.01\n" + field))  # moves as fast as a usual one
    assert soft["first"] == min(1e-4, 0.01 / 40)


def test_the_least_step_is_far_below_the_first_one():
    assert Adaptive(1e-4).controller.smallest == 1e-11 == Adaptive(1e-4, first=1e-4).controller.smallest
    assert float(Adaptive(1e-4, first=1e-12).controller.smallest) == pytest.approx(1e-18)


def test_finer_grids_have_at_most_2048_nodes():
    assert Refinement.for_nodes(64) == Refinement.for_nodes(256) == Refinement()
    assert Refinement.for_nodes(512).factors == (1, 2, 4)
    assert Refinement.for_nodes(2048).factors == (1,)
    shortest = [Refinement.for_nodes(N).resolved / N for N in (256, 512, 1024, 2048)]
    np.testing.assert_allclose(shortest, shortest[0])


def test_a_compressed_start_that_nothing_disturbs_is_reported():
    t, ones = np.linspace(0, 0.01, 11), np.ones((11, 1))
    plain = {"vesicle": [{"shape": "ellipse", "bending": 1.0}]}

    def found(tension, tables=plain, t=t):
        return missed_wrinkles(tables, t, tension * ones, 2 * np.pi * ones)

    assert "about 12 wrinkles" in found(-432.0) and "e^8.6" in found(-432.0)  # √(432/3) waves, 432^1.5/(6√3)/100
    assert found(-432.0, t=t / 10) is None  # too short
    assert found(-100.0, t=10 * t) is None  # too few waves
    assert found(1e4) is None
    assert found(-432.0, {"vesicle": [{"bending": 100.0}]}) is None  # too stiff
    assert found(-432.0, {"vesicle": [{"bending": 1.0, "disturbance": 1e-6}]}) is None
