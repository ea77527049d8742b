"""A file of another kind in the place of a rig file is named, and where it belongs."""

import pytest

from rigs.load import SHIPPED, load, load_hidden
from rigs.yaml_text import read_yaml
from tests.support.refusals import refused


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("e.yaml", (SHIPPED / "paper-fanuc.effects.yaml").read_text(), "--effects"),
        ("diagnosis.json", '{"condition": "fault", "accuracy": {}, "acts": []}', "the JSON of a diagnosis"),
        ("manifest.json", '{"rig_text": "", "rig_name": "cell"}', "the directory of the run"),
        ("c.json", '{"format": 1, "rig": "cell", "terms": [' + "1," * 600_000 + "1]}", "a calibration"),
        ("ur.yaml", "kinematics: {shoulder: {x: 0}}\n", "--calibration"),
        ("map.yaml", "files: []\njoints: {}\n", "--map"),
        ("arm.urdf", '<?xml version="1.0"?>\n<robot name="arm"/>\n', "rig import-urdf"),
        ("page.html", "<!doctype html>\n<html></html>\n", "a page for a browser"),
        ("weld.script", "def p():\n  movej([0, 0, 0, 0, 0, 0])\nend\n", "--program"),
        ("t.csv", "q1_deg;x_mm\n1;2\n", "rig import"),
    ],
)
def test_other_file_is_named_with_its_place(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with refused("rig_file.invalid", said):
        load(tmp_path / name)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a:\n  b: 1\n\tc: 2\n", "line 3: not YAML: a tab"),
        ("a:\n  b: 1\n  c:1\nd: 2\n", "line 3: not YAML: a key without a value"),
        ("a: b: 1\n", "an unexpected colon"),
        ("a:\n  b: 1\n c: 2\n", "the indentation"),
        ("a: [1, 2\nb: 3\n", "a list is not closed"),
        ("a: {b: 1\nc: 3\n", "a mapping is not closed"),
        ("a: 'b\n", "a quote is not closed"),
    ],
)
def test_mistake_in_yaml_is_in_words(text, said):
    with refused("rig_file.invalid", said):
        read_yaml(text, "cell.yaml")


def test_effect_of_a_missing_axis_names_the_file(tmp_path):
    (tmp_path / "e.yaml").write_text("effects: [{effect: joint_offset, axis: 7, offset_deg: 0.2}]\n")
    with refused("rig_file.invalid", "e.yaml: joint_offset 7 refers to axis 7"):
        load_hidden(tmp_path / "e.yaml").apply_to(load("paper-fanuc")[0])


def test_effects_with_more_axes_are_refused(tmp_path):
    (tmp_path / "e.yaml").write_text(f"axes: [{', '.join(['{}'] * 7)}]\n")
    with refused("rig_file.invalid", "has 7 axes, but the robot has 6"):
        load_hidden(tmp_path / "e.yaml").apply_to(load("paper-fanuc")[0])
