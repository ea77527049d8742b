import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from rigs import arms
from rigs.arms import ArmFile, arm_names, load_arm
from rigs.errors import FileError
from rigs.load import SHIPPED, example_cell, load, parse, shipped
from rigs.schema.feedback import NoFeedback
from rigs.schema.limits import Limits
from rigs.schema.robot import Pose, Robot
from tests.support.second_sources import SOURCES

ARMS = arm_names()


def test_the_library_has_these_arms():
    assert set(ARMS) == set(SOURCES)
    assert list(ARMS) == sorted(ARMS)
    assert len(ARMS) == len(list(Path(arms.__file__).parent.glob("*.yaml"))) == 31


@pytest.mark.parametrize("name", ARMS)
def test_name_of_an_arm_brings_no_cell(name):
    rig, _ = load(name)
    assert rig.robot == load_arm(name).robot and rig.robot.tool == Pose() and rig.robot.payload_kg == 0
    assert not rig.gauges.recorded and isinstance(rig.feedback, NoFeedback)
    assert (rig.tests, rig.limits, rig.effects) == (type(rig.tests)(), Limits(), ())


def test_no_shipped_cell_has_the_name_of_an_arm():
    assert not set(shipped()) & set(ARMS)
    for cell in shipped():
        if cell.endswith("-cell"):
            assert load(cell)[0].robot.arm == cell.removesuffix("-cell")


@pytest.mark.parametrize(("name", "cell"), [("ur10e", "ur10e-cell"), ("ur10", "ur10-cell"), ("ur5e", None)])
def test_bare_arm_refers_to_its_shipped_cell(name, cell):
    rig, _ = load(name)
    assert example_cell(rig) == cell
    assert example_cell(rig.model_copy(update={"name": "mine"})) is None


def test_cell_is_not_a_bare_arm():
    assert load("ur10e-cell")[0].name == "ur10e" and example_cell(load("ur10e-cell")[0]) is None


@pytest.mark.parametrize("name", ARMS)
def test_the_text_of_an_arm_is_its_robot(name):
    arm = load_arm(name)
    assert arm.name == name
    assert list(yaml.safe_load(arm.text)) == ["robot"]
    assert Robot.model_validate(yaml.safe_load(arm.text)["robot"]) == arm.robot
    assert arm.robot.name == f"{arm.maker} {arm.model}"


@pytest.mark.parametrize("name", [name for name in ARMS if len(load_arm(name).robot.axes) == 6])
def test_an_arm_is_pasted_into_a_rig_file(name):
    text = (SHIPPED / "paper-fanuc.yaml").read_text(encoding="utf-8")
    section = re.search(r"^robot:\n(?:(?: .*|#.*)?\n)+", text, re.M)
    assert section
    pasted = parse(text.replace(section.group(), load_arm(name).text + "\n"), "pasted.yaml")
    assert pasted.robot == load_arm(name).robot


@pytest.mark.parametrize("name", ARMS)
def test_each_source_names_a_place_and_is_held_against(name):
    sources = load_arm(name).sources.model_dump(exclude_defaults=True)
    assert all(len(words) > 8 for words in sources.values())
    assert {"geometry", "second", "third"} & set(sources) == set(SOURCES[name])


@pytest.mark.parametrize("name", ARMS)
def test_masses_are_complete_and_within_the_arm(name):
    masses = [axis.mass_kg for axis in load_arm(name).robot.axes]
    assert all(masses) or not any(masses)
    assert sum(masses) < 60
    assert all(abs(one) < 700 for axis in load_arm(name).robot.axes for one in axis.centre_mm)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("UR10a", "ur10 or ur10e"),
        ("GP 7", "yaskawa-gp7?"),
        ("kr6", "kuka-kr-6-r900-2 or kuka-kr-6-r900-sixx?"),
        ("fanuc-m-21ia", "fanuc-m-20ia"),
        ("fanuc_m_20i", "fanuc-m-20ia"),
        ("comau", "rig arms"),
        ("../arms/ur10e", "ur10e"),
        ("", "rig arms"),
    ],
)
def test_an_unknown_arm_is_refused_with_the_names_that_are_near(name, remedy):
    with pytest.raises(FileError, match=re.escape(remedy)):
        load_arm(name)


@pytest.mark.parametrize("name", ["fanuc_m_20ia", "FANUC M-20iA"])
def test_an_arm_is_loaded_by_its_name_as_people_write_it(name):
    assert load_arm(name) == load_arm("fanuc-m-20ia")


@pytest.mark.parametrize(
    ("name", "source_rad"),
    [
        ("fanuc-lr-mate-200id", (-2.450966, 4.886922)),
        ("fanuc-m-10ia", (-3.14, 4.61)),
        ("fanuc-m-20ia", (-3.228859, 4.766843)),
    ],
)
def test_the_limits_of_a_fanucs_j3_are_those_of_j3_alone(name, source_rad):
    assert load_arm(name).robot.axes[2].limits_deg == pytest.approx(np.degrees(source_rad), abs=0.5)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"repeatability_mm": 0.1}, "belong together"),
        ({"maker": None}, "maker"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_a_number_without_its_source_is_refused(change, what):
    file = Path(arms.__file__).parent / "yaskawa-gp7.yaml"
    data = yaml.safe_load(file.read_text(encoding="utf-8"))
    ArmFile.model_validate(data)
    with pytest.raises(ValidationError, match=what):
        ArmFile.model_validate(data | change)
