from __future__ import annotations

import numpy as np
import pytest

from analysis.robot.kinematics.arm import Array, arm_of, forward_and_jacobian
from rigs.arms import arm_names, load_arm
from rigs.load import parse
from rigs.schema.robot import Pose, Robot, identity
from tests.support.refusals import refused
from tests.worlds.arms.seven_axes import constants_of
from tests.worlds.stranger.screws import arm_from, pose

SEVEN = [name for name in arm_names() if len(load_arm(name).robot.axes) == 7]


def of_screws(robot: Robot, q: Array) -> Array:
    """The Jacobian (n, 6, axes) of the tool's origin by the screws of a product of exponentials."""
    posed = pose(arm_from(constants_of(robot)), q)
    across = np.cross(posed.axis, posed.p[:, None] - posed.point)
    return np.concatenate([across, posed.axis], axis=2).transpose(0, 2, 1) @ np.array(robot.coupling)


@pytest.mark.parametrize("name", [*SEVEN, "ur5", "so-101", "widowx-250"])
def test_poses_and_jacobian_are_those_of_screws(name):
    robot = load_arm(name).robot.model_copy(update={"base": Pose()})
    low, high = np.radians([axis.limits_deg for axis in robot.axes]).T
    q = np.random.default_rng(5).uniform(low, high, (300, len(low)))
    T, jacobian = forward_and_jacobian(arm_of(robot), q)
    posed = pose(arm_from(constants_of(robot)), q)
    np.testing.assert_allclose(T[:, :3, 3], posed.p, atol=1e-9)
    np.testing.assert_allclose(T[:, :3, :3], posed.R, atol=1e-12)
    np.testing.assert_allclose(jacobian, of_screws(robot, q), atol=1e-10 * 1000)


@pytest.mark.parametrize("name", SEVEN)
def test_the_jacobian_is_pinocchios(name):
    pin = pytest.importorskip("pinocchio")
    robot = load_arm(name).robot
    coupling, model = np.array(robot.coupling), pin.Model()
    at, joint = pin.SE3.Identity(), 0
    for axis in robot.axes:
        turn = pin.utils.rotate("x", np.radians(axis.alpha_deg))
        placed = at * pin.SE3(turn, turn @ np.array([axis.a_mm, 0.0, 0.0]))
        joint = model.addJoint(joint, pin.JointModelRZ(), placed, axis.name)
        at = pin.SE3(np.eye(3), np.array([0.0, 0.0, axis.d_mm]))
    frame = model.addFrame(pin.Frame("tool", joint, 0, at, pin.FrameType.OP_FRAME))
    data = model.createData()
    low, high = np.radians([axis.limits_deg for axis in robot.axes]).T
    q = np.random.default_rng(6).uniform(low, high, (100, len(low)))
    _, jacobian = forward_and_jacobian(arm_of(robot), q)
    theirs = [pin.computeFrameJacobian(model, data, one, frame, pin.LOCAL_WORLD_ALIGNED) for one in q @ coupling.T]
    np.testing.assert_allclose(jacobian, theirs @ coupling, atol=1e-10 * 1000)


def test_uncoupled_axes_turn_with_their_own_joint():
    robot = load_arm("franka-fr3").robot
    assert robot.coupling == identity(7)


@pytest.mark.parametrize(
    ("written", "what"),
    [
        (
            "tests: {circle: {centre_mm: [0, 0, 0], posture_deg: [0, 0, 0, 0, 0, 0]}}",
            "imported poses",
        ),
        ("effects: [{effect: backlash, axis: 8}]", "axis"),
    ],
)
def test_unsupported_features_of_seven_axes_are_refused(written, what):
    with refused("rig_file.value"):
        parse(f"name: seven\n{load_arm('franka-fr3').text}{written}\n", "seven.yaml")


def test_an_effect_of_an_axis_that_is_not_there_is_refused():
    with refused("rig_file.value"):
        parse(f"name: six\n{load_arm('ur5').text}effects: [{{effect: backlash, axis: 7}}]\n", "six.yaml")


def test_a_coupling_of_another_size_is_refused():
    robot = load_arm("franka-fr3").robot
    with pytest.raises(ValueError, match="7 rows of 7 numbers"):
        Robot.model_validate({"name": "x", "axes": [one.model_dump() for one in robot.axes], "coupling": identity(6)})
