"""Flows and fields of the user's own that depend on time: steps see their changes, stated or not."""

import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.stepping.loop import stops_of

SPEED, BEGIN, WIDTH, T_END = 100.0, 0.16, 0.002, 0.3
CIRCLE = jaxves.circle(16)


def pulse(x, t):
    """A uniform flow during 1/150 of the run, which moves a vesicle by SPEED WIDTH."""
    return jnp.where((t > BEGIN) & (t < BEGIN + WIDTH), jnp.array([SPEED, 0.0]), 0.0)


class Start(eqx.Module):
    """A uniform flow that rises from zero within `rise`, and its kinks."""

    begin: jax.Array
    rise: float = 1e-5

    def __call__(self, x, t):
        return SPEED * jnp.clip((t - self.begin) / self.rise, 0.0, 1.0) * jnp.array([1.0, 0.0])

    def breakpoints(self):
        return jnp.stack([self.begin, self.begin + self.rise])


def in_flow(flow):
    return jaxves.make_scene(CIRCLE, flow=flow)


def in_field(E_inf, **others):
    return jaxves.make_scene(CIRCLE, field=jaxves.dc_field(1.0, conductivity_ratio=0.5, E_inf=E_inf, **others))


def stops(scene):
    return np.unique(stops_of(scene, T_END))


def test_no_step_passes_over_a_pulse_that_nobody_stated():
    result = jaxves.simulate(in_flow(pulse), T_END, saves=1)
    assert result.word == "complete"
    np.testing.assert_allclose(result.diagnostics["center"][-1, 0, 0], SPEED * WIDTH, rtol=1e-2)


@pytest.mark.parametrize("scene_in", [in_flow, in_field])
def test_steps_end_on_both_sides_of_a_jump_and_divide_what_changes(scene_in):
    of_pulse = stops(scene_in(pulse))
    for jump in (BEGIN, BEGIN + WIDTH):
        near = np.abs(of_pulse - jump) < T_END / 1000
        assert np.any(of_pulse[near] < jump) and np.any(of_pulse[near] > jump)
    of_sine = stops(scene_in(lambda x, t: jnp.array([0.0, jnp.sin(30.0 * t)])))
    passed = [np.sum(np.abs(np.diff(np.sin(30.0 * np.linspace(*ends, 99))))) for ends in itertools.pairwise(of_sine)]
    total = np.sum(np.abs(np.diff(np.sin(30.0 * np.linspace(0.0, T_END, 9999)))))
    assert len(of_sine) == 34 and max(passed) < 1.2 / 32 * total
    np.testing.assert_array_equal(stops(scene_in(lambda x, t: jnp.array([0.0, 1.0]))), [0.0, T_END])


@jax.jit
def moved(numbers):
    result = jaxves.simulate(in_flow(Start(numbers[0])), numbers[1], saves=1)
    return result.diagnostics["center"][-1, 0, 0]


def test_stated_times_and_the_end_of_the_run_have_derivatives():
    """The path is SPEED (t_end - begin - rise/2), which steps between kinks give exactly."""
    at = jnp.array([BEGIN, T_END])
    np.testing.assert_allclose(moved(at), SPEED * (T_END - BEGIN - 5e-6), rtol=1e-9)
    np.testing.assert_allclose(jax.jacfwd(moved)(at), [-SPEED, SPEED], rtol=1e-7)


def test_stated_times_are_among_the_stops_also_with_a_factor_of_time():
    start = Start(jnp.asarray(BEGIN), 1e-6)
    factor = jaxves.PiecewiseLinear([0.1, 0.2], [1.0, 2.0])
    both = jaxves.TimeDependent(in_flow(start).flow, factor)
    for scene, times in (
        (in_flow(start), [BEGIN, BEGIN + 1e-6]),
        (in_field(start), [BEGIN, BEGIN + 1e-6]),
        (in_flow(both), [0.1, BEGIN, BEGIN + 1e-6, 0.2]),
        (in_field(start, history=factor), [0.1, BEGIN, BEGIN + 1e-6, 0.2]),
    ):
        assert np.max(np.min(np.abs(stops(scene)[:, None] - times), axis=0)) < 1e-12
        part = scene.flow or scene.field
        samples = np.unique(part.steep_times(scene.x, T_END))
        assert len(samples) > 1


def test_times_that_are_no_times_are_refused():
    def flow(x, t):
        return jnp.array([x[1], 0.0])

    flow.breakpoints = lambda: 0.1
    with pytest.raises(ValueError, match=r"flow.breakpoints\(\) = 0.1, expected the times at which it is not smooth"):
        in_flow(flow)
    with pytest.raises(ValueError, match=r"E_inf.breakpoints\(\) = nan, expected"):
        flow.breakpoints = lambda: np.nan
        in_field(flow)


@pytest.mark.parametrize("flow", [None, jaxves.Shear(1.0)])
def test_scenes_without_such_functions_are_not_sampled(flow):
    field = jaxves.dc_field(1.0, conductivity_ratio=0.5)
    traced = jax.make_jaxpr(lambda t_end: stops_of(jaxves.make_scene(CIRCLE, flow=flow, field=field), t_end))(T_END)
    own = jax.make_jaxpr(lambda t_end: stops_of(in_flow(pulse), t_end))(T_END)
    assert "cumsum" not in str(traced) and "scan" not in str(traced)
    assert "cumsum" in str(own)
