"""The line of advice of a run: what the nodes did not resolve at its end, and what to change in its scene."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..base import status
from ..observables.checks import Checks

_WITH_NODES = ("unresolved", "solve failed", "self-contact", "collision", "step underflow", "inaccurate")


class NodesOfRun(NamedTuple):
    """The numbers of nodes of a run: at its end, the largest that it may use, and whether they are adapted.

    `neck` is the width of the narrowest neck that is resolved, in node spacings.
    """

    now: int
    most: int
    adapted: bool
    neck: float


def advice(word: str, nodes: NodesOfRun, diagnostics: dict[str, np.ndarray]) -> str:
    """Returns the advice of `status.ADVICE`, with the reason and the nodes of this run where nodes are the cure.

    Args:
        word: the status word of the run.
        nodes: its numbers of nodes.
        diagnostics: those of all saved times by name, (T, ...).
    """
    if word not in _WITH_NODES:
        return status.ADVICE[word]
    known = word == "unresolved" and len(diagnostics["spectral_tail"])
    reasons = _reasons(nodes, {name: history[-1] for name, history in diagnostics.items()}) if known else ()
    if nodes.adapted:
        cure = f"This run could use at most {nodes.most} nodes."
    else:
        cure = f"This run had {nodes.most} nodes; without the key `nodes` they are adapted."
    return " ".join((status.ADVICE[word], *reasons, cure))


def _reasons(nodes: NodesOfRun, last: dict[str, np.ndarray]) -> Iterator[str]:
    limits, tail, spacing = Checks(), float(np.max(last["spectral_tail"])), last["length"] / nodes.now
    if tail > limits.tail:
        yield (
            f"At the last saved time the spectrum of a shape or a potential ends at {tail:.1g} of its largest mode "
            f"(limit {limits.tail:.1g})."
        )
    neck = float(np.min(last["self_gap"] / spacing))
    if neck < nodes.neck:
        yield f"At the last saved time a neck or a fold is {neck:.2g} node spacings wide."
    if "min_gap" in last and last["min_gap"] < np.max(spacing) and last["film_error"] > limits.film:
        yield (
            f"At the last saved time the narrowest film is {float(last['min_gap']):.2g} a thick. The relative error of "
            f"its drainage rate is {float(last['film_error']):.1g} (limit {limits.film:.1g})."
        )
