"""The comparison of fixed and adapted nodes runs scenes of the stability map, and counts only runs that end well."""

import numpy as np

from experiments import default_nodes


def measured(word="complete", error=1e-4, seconds=10.0):
    return {"word": word, "error": error, "seconds": seconds, "nodes": 64}


def test_scenes_are_those_of_the_map_with_64_nodes_and_each_verdict():
    found = default_nodes.scenes(("pop",), 2)
    assert "pop" in found and len(found) == 7
    for verdict in ("as stated", "stopped", "right"):
        assert sum(name.endswith(f"({verdict})") for name in found) == 2
    assert all(scene.numerics.nodes in (None, 64) for scene in found.values())


def test_the_table_counts_complete_and_accurate_runs_and_compares_times_of_those_that_both_complete():
    rows = [
        {"name": "a", "64": measured(error=2e-3), "auto": measured(seconds=30.0)},
        {"name": "b", "64": measured("unresolved", np.nan), "auto": measured(seconds=99.0)},
        {"name": "c", "64": measured(), "auto": measured()},
    ]
    fixed, auto, times = default_nodes.table(rows)
    assert fixed.startswith("64: 2 of 3 complete, 1 of them") and auto.startswith("auto: 3 of 3 complete, 3 of them")
    assert times.endswith("median 2.00, 1.00 to 3.00")
