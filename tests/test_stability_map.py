"""Scenes of the stability map are ones that users may write, and a verdict says what happened."""

import collections

import numpy as np

from experiments import _all_models, stability_map
from jaxves.inputs.scene_files import parse, to_toml, tomllib
from jaxves.inputs.scene_tables import AcTime

COUNT = 4 * len(_all_models.MODELS)


def found(word="complete", error=1e-4, stated=1e-4, finer="complete", limits=()):
    return {"word": word, "error": error, "stated": stated, "finer": finer, "limits": list(limits)}


def verdict(finite=True, **case):
    return stability_map.verdict(found(**case), finer=object(), finite=finite)


def test_random_scenes_have_the_effects_of_their_models_and_can_be_drawn_again():
    scenes = [_all_models.drawn(3, i)[0] for i in range(COUNT)]
    assert len({to_toml(scene) for scene in scenes}) == COUNT
    assert all(parse(tomllib.loads(to_toml(scene))) == scene for scene in scenes)
    assert _all_models.drawn(3, COUNT - 1)[0] == scenes[-1] != _all_models.drawn(4, COUNT - 1)[0]
    for i, scene in enumerate(scenes):
        model, time = _all_models.model_of(i), getattr(scene.field, "time", None)
        assert (scene.field is not None) == bool(model.field) and (scene.flow is not None) == model.flow
        assert (scene.fluid is not None) == model.viscosities
        assert getattr(scene.field, "charge_relaxation", None) is not None or not model.relaxing
        assert (scene.pair is not None, scene.cell is not None) == (model.place == "pair", model.place == "cell")
        assert isinstance(time, AcTime) == (model.field in ("ac", "averaged"))
        assert getattr(time, "averaged", False) == (model.field == "averaged")
        assert 0 < scene.t_end <= 0.5


def test_copies_of_an_ellipse_touch_at_the_distance_that_is_stated():
    circle = {"reduced_area": 1.0, "angle": 20.0}
    assert abs(_all_models.touching(circle, 70.0) - 2.0) < 1e-4
    vesicle = {"reduced_area": 0.5, "angle": 30.0}
    along, across = (_all_models.touching(vesicle, angle) for angle in (30.0, 120.0))
    # 4π · π p q / (2π)² = Δ, with diameters 2p and 2q
    assert abs(along * across / 4 - 0.5) < 1e-4 and along > 2 > across


def test_chosen_scenes_are_valid_and_different():
    scenes = [to_toml(scene) for _, scene in stability_map.cases()]
    assert len(set(scenes)) == len(scenes) > 50


def test_scenes_beyond_the_stated_limits_are_known():
    within = {"neck", "ν = 10 in a flow", "β/χ = 3e3, Λ = 0.1", "χ = 10, β/χ = 1e5, Λ = 10", "cell, dense"}
    beyond = {
        "β/χ = 1e5, Λ = 0.1, 64 nodes": "wrinkles",
        "pair, gap 0.01, ν = 10": "film thinner than the node spacing",
    }
    beyond |= {"cell, Ca = 1000": "wrinkles"}
    for name, scene in stability_map.cases():
        found = stability_map.exceeded(scene)
        assert found == ([beyond[name]] if name in beyond else []) or name not in within | set(beyond)


def test_a_verdict_says_what_became_of_a_run():
    assert verdict() == "right"
    assert verdict(error=2e-3, stated=1e-3) == "as stated" == verdict(word="inaccurate", error=1.0, stated=0.2)
    assert verdict(error=2e-3, stated=1e-4) == "wrong" == verdict(error=2e-3, stated=None) == verdict(finite=False)
    assert verdict(word="unresolved", error=None) == "stopped" == verdict(word="not finite", finite=False)
    assert verdict(finer="unresolved") == "unchecked" == stability_map.verdict(found(), finer=None, finite=True)


def test_the_summary_counts_scenes_within_the_limits_and_cures():
    names = ["0 field", "1 flow", "circle"]
    cases = [found(), found(word="unresolved", limits=["wrinkles"]), found(word="drift", finer="drift")]
    verdicts = ["right", "stopped", "stopped"]
    whole = [case | {"name": n, "verdict": v} for case, n, v in zip(cases, names, verdicts, strict=True)]
    summary = stability_map.summary(whole)
    assert summary["verdicts"] == {"right": 1, "stopped": 2} and summary["scenes"] == 3
    assert summary["verdicts within the limits"] == {"right": 1, "stopped": 1} and summary["within the limits"] == 2
    assert summary["stopped, by word"] == {"unresolved": 1, "drift": 1} and summary["cured by twice the nodes"] == 1
    texts = collections.Counter(text.get_text() for text in stability_map.draw(whole).axes[0].texts)
    assert texts == collections.Counter([*names, "chosen", "random", "1e-04", "unresolved", "drift"])


def test_differences_are_taken_on_common_nodes_relative_to_large_potentials():
    class Result:
        def __init__(self, N, size):
            angle = 2 * np.pi * np.arange(N) / N
            self.t, self.V_m = np.zeros(2), size * np.cos(angle)[None, None] * np.ones((2, 1, 1))
            self.x = np.stack([np.cos(angle), np.sin(angle)], axis=-1)[None, None] * np.ones((2, 1, 1, 1))

    assert stability_map.difference(Result(16, 1.0), Result(24, 1.0), 2) < 1e-12
    assert abs(stability_map.difference(Result(16, 11.0), Result(24, 10.0), 2) - 0.1) < 1e-12
    assert abs(stability_map.difference(Result(16, 0.5), Result(24, 0.4), 2) - 0.1) < 1e-12
