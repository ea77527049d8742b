import datetime as dt
from typing import Any

import numpy as np
import pytest

from analysis.apps.commission.init_answers import Answers
from analysis.apps.commission.questionnaire import circle_from_start
from analysis.apps.commission.rig_file_text import chosen_arm, rig_text
from analysis.robot.kinematics.arm import arm_of, forward
from rigs.arms import arm_names, load_arm
from rigs.load import load, parse
from rigs.schema.limits import Limit, Limits, limits_of_tolerance
from rigs.schema.robot import Pose
from tests.support.drivers import FEEDBACKS, GAUGES, egm, keyence, modbus, rsi, rtde
from tests.support.refusals import refused

TODAY = dt.date(2026, 11, 21)
TOOL = Pose(xyz_mm=(0, 0, 150), rpy_deg=(0, 90, 0))


def answers(**changes: Any) -> Answers:
    given = {"feedback": rtde(), "gauges": (keyence(), keyence(channel=2)), "baseline_mm": 60.0, "tool": TOOL}
    return Answers(**(given | changes))


@pytest.mark.parametrize("arm", [name for name in arm_names() if len(load_arm(name).robot.axes) == 6])
def test_every_arm_comes_through(arm):
    chosen = chosen_arm(arm)
    rig = parse(rig_text(answers(), chosen, "cell", TODAY), "cell.yaml")
    assert rig.robot == chosen.robot.model_copy(update={"tool": TOOL})
    assert rig.limits.data_sheet_rp_mm == chosen.repeatability_mm
    assert (rig.name, rig.effects, rig.tests.circle) == ("cell", (), None)


@pytest.mark.parametrize("arm", ["ur10e", "fanuc-m-10ia"])
def test_the_allowed_error_becomes_limits(arm):
    chosen = chosen_arm(arm)
    rig = parse(rig_text(answers(tolerance_mm=0.14), chosen, "cell", TODAY), "cell.yaml")
    assert rig.limits == limits_of_tolerance(0.14, 70.0, chosen.repeatability_mm)
    assert rig.limits.of("yaw", "band_deg") == Limit(watch=0.0573, fail=0.115)  # 0.14 mm over 70 mm
    none = parse(rig_text(answers(tolerance_mm=0.0), chosen, "cell", TODAY), "cell.yaml")
    assert none.limits == Limits(data_sheet_rp_mm=chosen.repeatability_mm)


@pytest.mark.parametrize("group", [group for _, group, _ in GAUGES], ids=[name for name, *_ in GAUGES])
def test_every_gauge_comes_through(group):
    rig = parse(rig_text(answers(gauges=tuple(group)), chosen_arm("ur10e"), "cell", TODAY), "cell.yaml")
    placed = [gauge.model_copy(update={"offset_mm": at}) for gauge, at in zip(group, (30.0, -30.0), strict=False)]
    assert [gauge for _, gauge in rig.gauges] == placed


@pytest.mark.parametrize("feedback", [one for _, one in FEEDBACKS], ids=[name for name, _ in FEEDBACKS])
def test_every_robot_comes_through(feedback):
    text = rig_text(answers(feedback=feedback), chosen_arm("ur10e"), "cell", TODAY)
    assert parse(text, "cell.yaml").feedback == feedback


def test_circle_is_written_and_unconfirmed_values_are_marked():
    rig, _ = load("ur10e-cell")
    circle = circle_from_start(rig.robot, [2, -75.3, 101.4, 55.2, 84.6, 107.8], 70.0)
    text = rig_text(answers(circle=circle, gauges=(modbus(),), feedback=rsi()), chosen_arm("ur10e"), "cell", TODAY)
    made = parse(text, "cell.yaml")
    assert made.tests.circle == circle and made.gauges.g2 is None
    assert rsi().origin.instruments in text
    assert all(len(line) < 250 for line in text.splitlines())


def test_a_name_that_would_be_more_than_a_name():
    chosen = chosen_arm("ur10e")
    robot = chosen.robot.model_copy(update={"name": "a # b: {c}\nname: forged"})
    text = rig_text(answers(feedback=egm()), type(chosen)(robot, None, "x\nname: forged"), "cell", TODAY)
    rig = parse(text, "cell.yaml")
    assert (rig.name, rig.robot.name) == ("cell", robot.name)


def test_a_circle_from_one_pose_has_that_pose():
    rig, _ = load("paper-fanuc")
    q_deg = list(rig.tests.circle.posture_deg)
    circle = circle_from_start(rig.robot, q_deg, 55.0)
    T = forward(arm_of(rig.robot), np.radians([q_deg]))[0]
    np.testing.assert_allclose(np.array(circle.centre_mm) + 55.0 * np.array(circle.zero), T[:3, 3], atol=2e-3)
    np.testing.assert_allclose(circle.normal, T[:3, 0], atol=1e-6)
    np.testing.assert_allclose(np.dot(circle.normal, circle.zero), 0.0, atol=2e-6)
    for values, decimals in ((circle.centre_mm, 3), (circle.posture_deg, 3), (circle.normal, 6), (circle.zero, 6)):
        assert list(values) == np.round(values, decimals).tolist()


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("robot: {name: x}\n", "rig_file.invalid"),
        ("name: x\n", "arm.invalid"),
        ("- 1\n", "arm.invalid"),
        ("robot: [\n", "rig_file.invalid"),
        ("<robot name='x'/>\n", "arm.invalid"),
    ],
)
def test_wrong_arm_file_is_refused(tmp_path, text, code):
    path = tmp_path / "arm.yaml"
    path.write_text(text)
    with refused(code):
        chosen_arm(str(path))


def test_an_arm_from_a_file_and_one_that_is_not_there(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(load("ur10e-cell")[1])
    assert chosen_arm(str(path)).robot == load("ur10e-cell")[0].robot
    with refused("arm.unknown", "not an arm of the library"):
        chosen_arm("no-such-arm")
