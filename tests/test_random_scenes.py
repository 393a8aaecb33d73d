"""Random scenes are ones that users may write, and the verdict on stated errors counts what it says."""

import numpy as np

from experiments import random_scenes
from jaxves.inputs.scene_files import parse, to_toml, tomllib


def case(word="complete", stated=1e-4, true=1e-4, finer="complete"):
    return {"word": word, "stated": stated, "true": true, "finer": finer}


def test_a_hundred_random_scenes_are_valid_and_different():
    rng = np.random.default_rng(0)
    drawn = [random_scenes.drawn(rng) for _ in range(100)]
    texts = {to_toml(scene) for scene in drawn}
    assert len(texts) == 100 and all(parse(tomllib.loads(text)) in drawn for text in texts)
    assert {scene.numerics.nodes for scene in drawn} == {64, "auto"}
    assert 2 <= sum(scene.pair is not None for scene in drawn) <= 25
    assert all(0 < scene.t_end <= 0.5 for scene in drawn)


def test_the_verdict_counts_runs_that_are_off_by_more_than_they_state():
    found = [case(), case(stated=1e-6), case(true=9e-4), case(stated=1.0), case(word="unresolved"), case(finer="")]
    verdict = random_scenes.verdict(found)
    assert verdict["scenes"] == 6 and verdict["words"] == {"complete": 5, "unresolved": 1}
    assert verdict["complete and stated at most 1e-2"] == 4
    assert verdict["complete without a finer run"] == 1
    assert verdict["off by more than ten times what they state"] == 1
    assert abs(verdict["least of stated over true"] - 1e-2) < 1e-12
    assert abs(verdict["median of stated over true"] - np.median([1, 1e-2, 1 / 9, 1e4])) < 1e-12
