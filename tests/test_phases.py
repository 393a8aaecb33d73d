"""Classes of motion, from histories written down by hand."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxves.observables import classes

HISTORIES = {
    "P": [[0.3, 0.2, 0.1, 0.25], [0.3, -0.005, 0.1], [-0.2, -0.1, 0.1, 0.2], [0.0, 0.3], [0.3]],
    "O": [[0.3, 0.1, -0.1, -0.3], [-0.2, -0.3], [0.3, -0.1, 0.1, -0.2], [-0.2]],
    "POP": [[0.3, -0.02, 0.3], [0.3, -0.2, -0.1, 0.02], [0.005, -0.2, 0.2], [0.3, -0.2, 0.2, -0.2, 0.2]],
    "open": [[0.3, 0.1, 0.005], [0.3, -0.2, 0.0], [0.0], [-0.2, 0.009], [np.nan]],
}
CASES = [(name, history) for name, histories in HISTORIES.items() for history in histories]


@pytest.mark.parametrize(("name", "history"), CASES)
def test_a_history_has_its_class(name, history):
    assert classes.NAMES[int(classes.classify(np.array(history)))] == name


@pytest.mark.parametrize(("name", "history"), CASES)
def test_rows_after_an_early_end_change_nothing(name, history):
    assert classes.NAMES[int(classes.classify(np.array([*history, np.nan, np.nan])))] == name


def test_many_histories_are_classified_at_once_and_traced():
    many = jnp.stack([jnp.asarray(history[:2]) for _, history in CASES if len(history) > 1], axis=1)
    traced = jax.jit(classes.classify)(many)
    one_by_one = [int(classes.classify(np.asarray(column))) for column in many.T]
    np.testing.assert_array_equal(traced, one_by_one)
    np.testing.assert_array_equal(jax.vmap(classes.classify, in_axes=1)(many), one_by_one)


def test_a_class_is_reached_when_all_have_it_and_the_start_did_not():
    prolate, dips, returns = [0.3, 0.2, 0.1], [0.3, 0.1, -0.1], [0.3, -0.1, 0.3]

    def reached(name, *vesicles):
        return classes.has_reached({classes.DEFORMATION: np.array(vesicles).T}, name)

    assert reached("O", dips) and reached("POP", returns)
    assert not reached("P", prolate)
    assert reached("P", [-0.1, -0.1, 0.1])
    assert not reached("O", [-0.1, -0.2, -0.3])
    assert not reached("POP", returns, prolate) and reached("POP", returns, returns)


def test_in_a_field_with_a_period_the_class_is_that_of_the_means_and_not_of_saved_values():
    """Saved values that always meet the field at one phase show an oblate vesicle where the mean is prolate."""
    nan, seen = np.nan, [0.3, -0.1, -0.1]

    def code(mean, least, greatest, deformation=seen, change=0.0):
        values = (deformation, mean, least, greatest, [change] * 3)
        return classes.class_names(dict(zip(classes.DIAGNOSTICS, values, strict=True)))

    assert code([nan, 0.1, 0.1], [nan, -0.005, -0.005], [nan, 0.2, 0.2]) == ["P"]
    assert code([nan, -0.1, 0.1], [nan, -0.2, -0.005], [nan, 0.005, 0.2]) == ["POP"]
    assert code([nan, 0.05, 0.05], [nan, -0.1, -0.1], [nan, 0.2, 0.2]) == ["breathing"]
    assert code([nan, 0.05, 0.05], [nan, -0.1, -0.1], [nan, 0.2, 0.2], change=-0.29) == ["P"]
    assert code([nan, nan, nan], [nan, nan, nan], [nan, nan, nan]) == ["open"]
    assert code([nan, -0.1, -0.1], [nan] + 2 * [-0.2], [nan] + 2 * [0.0], 3 * [0.3]) == ["O"]
    found = {name: np.array([[0.3], [0.2]]) for name in classes.DIAGNOSTICS}
    assert not classes.has_reached(found, "P") and classes.class_names(found) == ["P"]
    many = {name: jnp.asarray(value) for name, value in found.items()}
    np.testing.assert_array_equal(jax.jit(classes.codes_of)(many), classes.codes_of(found))


def test_classifying_saved_numbers_needs_no_jax():
    code = "import sys, numpy; from jaxves.observables.classes import classify; classify(numpy.ones(3))"
    code += "; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
