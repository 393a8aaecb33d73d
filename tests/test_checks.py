"""Each finding at a saved time gives its status, and the more severe of two findings counts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxves
from jaxves.base import status
from jaxves.equation.equation import equation_for
from jaxves.observables.checks import Checks
from jaxves.observables.observing import observe

CHECKS = Checks()


@pytest.fixture(scope="module")
def judged():
    """A function from changed diagnostics, and nodes, of an ellipse at rest to the status."""
    equation = equation_for(jaxves.make_scene(jaxves.ellipse(32, 0.9)))
    y, t = equation.start(), jnp.zeros(())

    @jax.jit
    def row_of(y):
        return observe(equation, t, y, equation.motion(t, y), jnp.zeros(1), None)

    row = row_of(y)

    @jax.jit
    def judge(row, y):
        return CHECKS.judge(equation, t, y, row)

    def code(factors=(), x=y.x, **values):
        diagnostics = dict(row.diagnostics)
        for name, factor in dict(factors).items():
            diagnostics[name] = factor * diagnostics[name]
        diagnostics |= {name: jnp.full_like(diagnostics[name], value) for name, value in values.items()}
        changed = row._replace(x=x, diagnostics=diagnostics)
        return int(judge(changed, eqx.tree_at(lambda y: y.x, y, x)))

    return code


def test_a_sound_row_lets_the_run_go_on(judged):
    assert judged() == status.RUNNING


@pytest.mark.parametrize("quantity", ["area", "length"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_area_or_length_off_by_more_than_the_limit_is_a_drift(judged, quantity, sign):
    assert judged({quantity: 1 + 0.98 * sign * CHECKS.drift}) == status.RUNNING
    assert judged({quantity: 1 + 1.02 * sign * CHECKS.drift}) == status.DRIFT


def test_a_wide_spectrum_and_a_narrow_neck_are_unresolved(judged):
    assert judged(spectral_tail=0.9 * CHECKS.tail) == status.RUNNING
    assert judged(spectral_tail=1.1 * CHECKS.tail) == status.UNRESOLVED
    assert judged(self_gap=1e-3) == status.UNRESOLVED


def test_a_tension_that_was_not_found_is_a_failed_solve(judged):
    assert judged(residual=1.0) == status.SOLVE_FAILED


def test_the_more_severe_finding_counts(judged):
    assert judged({"area": 1.1}, spectral_tail=1.0) == status.DRIFT
    assert judged({"area": 1.1}, residual=1.0) == status.SOLVE_FAILED


def test_a_membrane_through_itself_and_nodes_that_are_no_numbers_end_a_run(judged):
    alpha = 2 * np.pi * np.arange(32) / 32
    eight = jnp.stack([jnp.sin(alpha), jnp.sin(2 * alpha)], axis=-1)[None]
    assert judged({"area": 1.1}, x=eight) == status.SELF_CONTACT
    assert judged(x=eight.at[0, 3, 0].set(jnp.nan)) == status.NOT_FINITE
