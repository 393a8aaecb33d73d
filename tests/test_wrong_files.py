"""Wrong files: one clear line that names the key, its value and what was expected, and nothing is written."""

import re

import pytest
import wrong_files

from jaxves.inputs import scene_files, sweep_files
from jaxves.inputs.checking import SceneError

SCENES = {name: said for table in (wrong_files.OF_VESICLE, wrong_files.OF_SCENE) for name, (_, said) in table.items()}


def complaint(load, path):
    with pytest.raises(SceneError) as refused:
        load(path)
    message = str(refused.value)
    assert "\n" not in message and message.startswith(str(path)) and "expected" in message, message
    return message


def test_there_are_a_hundred():
    assert len(SCENES) + len(wrong_files.OF_SWEEP) + len(wrong_files.OUTLINES) >= 100


@pytest.mark.parametrize("name", SCENES)
def test_a_wrong_scene_is_refused_in_one_line(name, tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(wrong_files.scene_text(name), encoding="utf-8")
    message = complaint(scene_files.read_scene, path)
    assert re.search(SCENES[name], message), message


@pytest.mark.parametrize("name", wrong_files.OF_SWEEP)
def test_a_wrong_sweep_is_refused_in_one_line(name, tmp_path):
    def planned(path):
        sweep_files.plan(sweep_files.read_sweep_file(path), origin=str(path))

    text, said = wrong_files.OF_SWEEP[name]
    path = tmp_path / "sweep.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError) as refused:
        planned(path)
    message = str(refused.value)
    assert "\n" not in message and re.search(said, message), message


@pytest.mark.parametrize("name", wrong_files.OUTLINES)
def test_a_wrong_outline_is_refused_in_one_line(name, tmp_path):
    text, said = wrong_files.OUTLINES[name]
    (tmp_path / "outline.csv").write_text(text, encoding="utf-8")
    path = tmp_path / "scene.toml"
    path.write_text(wrong_files.SCENE_OF_OUTLINE, encoding="utf-8")
    message = complaint(scene_files.read_scene, path)
    assert "vesicle[0].file" in message and re.search(said, message), message
