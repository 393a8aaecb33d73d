"""Classes of motion of two vesicles, from histories made up of known ones."""

import subprocess
import sys

import numpy as np
import pytest

from jaxves.cli import run_summary
from jaxves.observables import pair_classes
from jaxves.results.run_store import Record

T = np.linspace(0, 8, 161)
FIELD = np.pi / 2
TO_FIELD = np.deg2rad(20) + np.deg2rad(70) * np.minimum(T / 2, 1)  # from 20° to the field, then along it
LATER = np.maximum(T - 2, 0)
DRAINING = 1.2 * np.exp(-0.5 * T)
CLOSER = 2.6 - 0.3 * np.tanh(T)
APART = 2.6 + 0.1 * np.tanh(T)


def case(angle, separation=CLOSER, gap=DRAINING):
    return T, angle, separation, gap


HISTORIES = {
    "straight to a chain": ("chain", case(TO_FIELD)),
    "a chain below the axis": ("chain", case(TO_FIELD - np.pi)),
    "an overshoot that comes back": ("chain", case(TO_FIELD + 0.3 * np.sin(2 * LATER) * np.exp(-2 * LATER))),
    "swings that die away": ("chain", case(TO_FIELD + 0.4 * np.sin(6 * LATER) * np.exp(-LATER))),
    "swings that stay small": ("chain", case(TO_FIELD + np.deg2rad(3) * np.sin(6 * LATER))),
    "swings that stay": ("oscillation", case(TO_FIELD + 0.4 * np.sin(6 * LATER))),
    "swings that grow": ("oscillation", case(TO_FIELD + 0.02 * LATER * np.sin(6 * LATER) * np.exp(0.3 * LATER))),
    "swings that have not died away yet": ("open", case(TO_FIELD + 1.5 * np.sin(3 * LATER) * np.exp(-0.2 * LATER))),
    "turning": ("circulation", case(np.deg2rad(20) + T)),
    "turning the other way": ("circulation", case(np.deg2rad(20) - T)),
    "turning, as a wrapped angle": ("circulation", case(np.angle(np.exp(1j * (0.3 + T))))),
    "moving apart": ("repulsion", case(np.full(161, 0.0), APART, APART - 1.4)),
    "moving apart and turning": ("open", case(np.deg2rad(20) * (1 + T / 8), APART, APART - 1.4)),
    "aligned but parting": ("open", case(np.full(161, FIELD - 0.2) + 0.025 * T, APART, APART - 1.4)),
    "passing the field": ("open", case(FIELD - 0.9 + 0.14 * T)),
    "at rest off the field, in touch": ("slanted", case(FIELD - 0.6 * np.tanh(T))),
    "at rest off the field, apart": ("open", case(FIELD - 0.6 * np.tanh(T), gap=1.2 - 0.02 * T)),
    "in touch off the field, still turning": ("open", case(FIELD - 0.6 + 0.02 * T)),
    "not there yet": ("open", case(np.deg2rad(20) + np.deg2rad(5) * T)),
}


@pytest.mark.parametrize("name", HISTORIES)
def test_a_history_has_its_class(name):
    word, (t, angle, separation, gap) = HISTORIES[name]
    assert pair_classes.classify(t, angle, separation, gap, FIELD) == word


@pytest.mark.parametrize("name", HISTORIES)
def test_the_class_knows_no_frame(name):
    """Neither the numbering of the vesicles, nor mirroring, nor turning everything changes it, nor rows of NaN."""
    word, (t, angle, separation, gap) = HISTORIES[name]
    assert pair_classes.classify(t, angle + np.pi, separation, gap, FIELD) == word
    assert pair_classes.classify(t, angle + 0.7, separation, gap, FIELD + 0.7) == word
    assert pair_classes.classify(t, np.pi - angle, separation, gap, FIELD) == word
    ended = [np.append(f, [np.nan, np.nan]) for f in (t, angle, separation, gap)]
    assert pair_classes.classify(*ended, FIELD) == word


def test_swings_are_counted_between_passages_through_the_field():
    """Tilt 0.4 sin: the first swing begins at the first passage, the last complete one ends at the last."""
    tilt = 0.4 * np.sin(np.linspace(-1.0, 10.0, 1101))  # passages at 0, π, 2π, 3π
    np.testing.assert_allclose(pair_classes.swings(tilt), [0.4, -0.4, 0.4], atol=1e-4)
    assert len(pair_classes.swings(np.ones(5))) == 0


def test_nothing_known_is_open():
    nothing = np.full(3, np.nan)
    assert pair_classes.classify(nothing, nothing, nothing, nothing, 0.0) == "open"
    one = np.zeros(1)
    assert pair_classes.classify(one, one, one + 2, one + 1, 0.0) == "open"


def test_classifying_saved_numbers_needs_no_jax():
    code = "import sys; from jaxves.observables import pair_classes; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_result_is_classified_in_the_frame_of_its_field():
    """What `jaxves show` says: the field's direction is the scene's."""
    t, angle, separation, gap = HISTORIES["straight to a chain"][1]
    nothing = np.zeros((161, 2, 4))
    found = {"line_angle": angle + np.pi / 2, "separation": separation, "min_gap": gap}

    def class_in(direction):
        scene = f"[field]\ndirection = {direction}\n"
        shapes = np.zeros((161, 2, 4, 2)), None, nothing, np.full((161, 2), 4), np.arange(161), {}
        return run_summary.pair_class(Record(t, *shapes, found, None, {}, "complete", scene))

    assert class_in([-1.0, 0.0]) == "chain"
    assert class_in([0.0, 1.0]) == "slanted"
