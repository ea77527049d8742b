from pathlib import Path

import numpy as np
import pytest

from analysis.intake.controller_arm import rig_with_controller
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.arms import load_arm, rig_text_of
from rigs.errors import FileError
from rigs.load import parse
from rigs.schema.robot import Robot

OWN = {"elbow": {"a_mm": -425.3}, "wrist 1": {"alpha_deg": 0.4}, "wrist 2": {"a_mm": 0.15}}


def own_arm() -> Robot:
    robot = load_arm("ur5e").robot
    axes = tuple(axis.model_copy(update=OWN.get(axis.name, {})) for axis in robot.axes)
    return robot.model_copy(update={"axes": axes})


def pendant(folder: Path, robot: Robot, count: int, decimals: int = 2) -> Path:
    low, high = [-160, -150, 20, -170, -100, -170], [160, -20, 140, 170, -20, 170]
    q = np.random.default_rng(4).uniform(low, high, (count, 6)).round(decimals)
    places = forward(arm_of(robot), np.radians(q))[:, :3, 3].round(2)
    rows = [",".join(map(str, row)) for row in np.hstack([q, places])]
    file = folder / "pendant.csv"
    file.write_text("\n".join(["q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_mm,y_mm,z_mm", *rows]) + "\n")
    return file


def test_one_pair_of_individually_measured_robots_proves_no_data_sheet(tmp_path):
    text = rig_text_of("ur5e")
    with pytest.raises(FileError):
        rig_with_controller(parse(text, ""), text, pendant(tmp_path, load_arm("ur5e").robot, 1))


def test_one_pair_confirms_the_data_sheet_of_a_maker_with_options(tmp_path):
    name = "abb-irb-120"
    pair = pendant(tmp_path, load_arm(name).robot, 1)
    assert rig_with_controller(parse(rig_text_of(name), ""), rig_text_of(name), pair)[0].controller == "data_sheet"


def test_effects_stay_relative_to_the_axes_they_were_found_with(tmp_path):
    effect = "effects:\n  - {effect: joint_offset, axis: 2, offset_deg: 0.1}\n"
    text = f"{rig_text_of('ur5e')}\n# found earlier\n{effect}"
    rig, edited, _ = rig_with_controller(parse(text, ""), text, pendant(tmp_path, own_arm(), 30, decimals=4))
    assert rig.robot.axes == load_arm("ur5e").robot.axes
    assert rig.robot.controller_axes[2].a_mm == pytest.approx(-425.3, abs=0.05)
    assert edited.endswith(f"# found earlier\n{effect}")


@pytest.mark.parametrize(
    ("arm", "expected"),
    [("ur5e", "unknown"), ("kuka-kr-6-r900-2", "unknown"), ("abb-irb-120", "unknown"), ("so-101", "data_sheet")],
)
def test_controller_that_is_not_stated_is_as_the_maker_builds_it(arm, expected):
    assert parse(rig_text_of(arm), "").controller == expected
