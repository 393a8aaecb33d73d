"""The advice of a run names what its nodes do not resolve, and the nodes that it had."""

import numpy as np
import pytest

from jaxves.base import status
from jaxves.observables.checks import Checks
from jaxves.runs.advice import NodesOfRun, advice

LIMITS = Checks()
FIXED = NodesOfRun(64, 64, False, neck=0.5)
FINE = {
    "spectral_tail": np.full((3, 2), 0.1 * LIMITS.tail),
    "length": np.full((3, 2), 6.4),
    "self_gap": np.full((3, 2), 1.0),
    "min_gap": np.full(3, 0.05),
    "film_error": np.full(3, 0.1 * LIMITS.film),
}


def told(word="unresolved", nodes=FIXED, **ends):
    """The advice for a run of two vesicles, whose last row has these diagnostics."""
    histories = {name: history.copy() for name, history in FINE.items()}
    for name, end in ends.items():
        histories[name][-1] = end
    return advice(word, nodes, histories)


def test_a_run_whose_rows_were_fine_has_the_general_advice_and_its_nodes():
    assert told() == f"{status.ADVICE['unresolved']} This run had 64 nodes; without the key `nodes` they are adapted."
    assert told(nodes=NodesOfRun(64, 96, True, neck=0.5)).endswith("This run could use at most 96 nodes.")


@pytest.mark.parametrize(
    ("ends", "reason"),
    [
        ({"spectral_tail": [0.0, 3 * LIMITS.tail]}, f"ends at {3 * LIMITS.tail:.1g} of its largest mode"),
        ({"self_gap": [1.0, 0.03]}, "a neck or a fold is 0.3 node spacings wide"),
        ({"film_error": 3 * LIMITS.film}, "the narrowest film is 0.05 a thick"),
    ],
)
def test_what_is_not_resolved_is_named_and_nothing_else(ends, reason):
    found = told(**ends)
    assert reason in found and found.count("At the last saved time") == 1


def test_a_film_wider_than_the_node_spacing_is_not_the_reason():
    assert "film is" not in told(film_error=3 * LIMITS.film, min_gap=0.2)


@pytest.mark.parametrize("word", ["complete", "interrupted", "too many steps"])
def test_where_nodes_are_no_cure_they_are_not_named(word):
    assert told(word) == status.ADVICE[word]
