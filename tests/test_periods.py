"""Means over whole periods of a resolved AC field: in runs, with derivatives, in files, and the classes from them."""

import contextlib
import io

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.cli.commands import answer
from jaxves.equation.equation import equation_for
from jaxves.geometry import shapes
from jaxves.observables import classes
from jaxves.observables.diagnostics import integrands_of
from jaxves.physics.scene import dc_field, make_scene
from jaxves.physics.waveform import AC
from jaxves.stepping.adaptive import Adaptive
from jaxves.stepping.loop import initial_state
from jaxves.stepping.marching import simulate

N, PERIOD = 24, 0.04
MARCH = Adaptive(1e-3, recorded=64)


def scene(numbers):
    """Of β and the frequency, in units of the usual ones."""
    field = dc_field(6.4 * numbers[0], conductivity_ratio=0.3, history=AC(numbers[1] / PERIOD))
    return make_scene(shapes.ellipse(N, 0.98, angle=1.5), field=field)


def means(numbers, march=MARCH):
    """The mean, least and greatest D in the second period and its change, at a saved time that is no multiple of it."""
    result = simulate(scene(numbers), 2.3 * PERIOD, saves=1, march=march)
    found = jnp.stack([result.diagnostics[name][-1, 0] for name in classes.DIAGNOSTICS[1:]])
    return found, found


ONES = jnp.ones(2)


@pytest.fixture(scope="module")
def differentiated():
    """The derivatives in reverse mode, and the values."""
    return jax.jit(jax.jacrev(means, has_aux=True))(ONES)


@pytest.fixture(scope="module")
def run():
    window = jnp.array([PERIOD, 2 * PERIOD])
    march = Adaptive(1e-5, recorded=None)
    return jax.jit(lambda: simulate(scene(ONES), 2 * PERIOD, saves=16, march=march, average=window))()


def test_the_mean_over_a_period_is_the_integral_of_steps_that_end_with_the_period(differentiated, run):
    """The window of averages has its own steps, ends of steps at both ends, and a hundredth of the tolerance."""
    found = differentiated[1]
    saved = np.asarray(run.diagnostics[classes.DEFORMATION])[8:, 0]
    swing = np.ptp(saved)
    exact = float(run.averages[classes.DEFORMATION][0])
    assert swing > 0.02
    np.testing.assert_allclose(run.diagnostics[classes.MEAN][-1, 0], exact, atol=1e-12)
    np.testing.assert_allclose(found[0], exact, atol=0.01 * swing)
    np.testing.assert_allclose(found[1:3], [saved.min(), saved.max()], atol=0.15 * swing)
    np.testing.assert_allclose(found[3], saved[-1] - saved[0], atol=0.05 * swing)
    assert found[1] < found[0] < found[2]


def test_before_the_first_period_has_ended_its_mean_is_not_known(run):
    mean = np.asarray(run.diagnostics[classes.MEAN])[:, 0]
    assert np.all(np.isnan(mean[:8])) and np.all(np.isfinite(mean[8:])) and len(np.unique(mean[8:])) == 2


def test_the_derivative_of_recorded_steps_is_that_of_the_loop_that_made_them(differentiated):
    """Which JAX finds by itself, forwards.

    Two programs round differently. Four derivatives of the nodes multiply round-off by (N/2)⁴, once in each step.
    """
    reverse, values = differentiated
    loop, same = jax.jit(jax.jacfwd(lambda numbers: means(numbers, MARCH.forwards()), has_aux=True))(ONES)
    assert jnp.all(jnp.abs(reverse) > 1e-4)
    rounding = np.finfo(float).eps * (N / 2) ** 4 * MARCH.recorded  # 3e-10, with the greatest number of steps
    np.testing.assert_allclose(values, same, rtol=rounding)
    np.testing.assert_allclose(reverse, loop, rtol=1e-8, atol=1e-11)


def test_a_scene_without_a_period_carries_none():
    for history in (None, AC(9.0, averaged=True)):
        still = make_scene(shapes.ellipse(N, 0.98), field=dc_field(1.0, conductivity_ratio=0.1, history=history))
        assert integrands_of(still, window=False) is None
        state = eqx.filter_eval_shape(lambda s=still: initial_state(equation_for(s), MARCH))
        assert state.period is None and not state.y.integrals


TABLES = {
    "t_end": 2.1,
    "saves": 7,
    "vesicle": [{"reduced_area": 0.97, "angle": 90.0}],
    "field": {"beta": 3.2, "conductivity_ratio": 0.5, "time": {"kind": "ac", "frequency": 0.5}},
    "numerics": {"nodes": 32, "tolerance": 1e-3, "certify": False},
}


def test_files_sweeps_and_show_have_the_class_of_a_vesicle_that_breathes(tmp_path):
    """It becomes oblate twice in every period. The saved values alone look like POP."""
    jaxves.run(TABLES, tmp_path / "run.h5")
    record = jaxves.load(tmp_path / "run.h5")
    assert jaxves.class_names(record.diagnostics) == ["breathing"]
    assert jaxves.class_names(record.diagnostics[classes.DEFORMATION]) != ["breathing"]
    swept = jaxves.sweep({"scene": TABLES, "axes": {"field.time.frequency": [0.5, 5.0]}}, tmp_path / "sweep.h5")
    assert swept.classes[0] == "breathing" != swept.classes[1]
    for name in classes.DIAGNOSTICS[1:]:  # another program, whose round-off chooses other steps of this tolerance
        value, swing = swept.data[f"{name}_final"][0], 0.28
        np.testing.assert_allclose(value, record.diagnostics[name][-1], atol=0.05 * swing)
    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert answer(["show", str(tmp_path / "run.h5")]) == 0
    assert "class: breathing (by means over periods)" in out.getvalue()
