from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize

from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward, forward_and_jacobian
from analysis.robot.kinematics.newton import newton_in_part, turned_rad
from rigs.arms import arm_names, load_arm
from rigs.load import parse
from rigs.schema.robot import Pose, Robot, identity
from tests.support.refusals import refused
from tests.worlds.arms.seven_axes import constants_of
from tests.worlds.stranger.screws import arm_from, pose

WIDOWX = arm_of(load_arm("widowx-250").robot)
"""Five axes; without its last joint four."""


def four_axes() -> Arm:
    short = {key: getattr(WIDOWX, key)[:4] for key in ("a", "alpha", "beta", "d", "offset", "limits", "speed")}
    return replace(WIDOWX, **short, coupling=np.eye(4))


def postures(arm: Arm, count: int) -> Array:
    return np.random.default_rng(4).uniform(0.2, 1.0, (count, arm.axes))


@pytest.mark.parametrize("arm", [WIDOWX, four_axes()], ids=["five", "four"])
def test_place_is_reached_with_the_nearest_remaining_turn(arm):
    """scipy looks for a nearer turn among the postures that keep the place, and finds none."""
    q = postures(arm, 2)
    wanted = forward(arm, q)
    wanted[:, :3, :3] = wanted[:, :3, :3] @ turned_about([0.06, -0.05, 0.08])
    found, reached = newton_in_part(arm, wanted, q)
    assert reached.all()
    np.testing.assert_allclose(forward(arm, found)[:, :3, 3], wanted[:, :3, 3], atol=1e-6)
    for at, target in zip(found, wanted, strict=True):

        def turned(x: Array, target: Array = target) -> float:
            return float(turned_rad(forward(arm, x[None]), target[None])[0] ** 2)

        place = {"type": "eq", "fun": lambda x, target=target: forward(arm, x[None])[0, :3, 3] - target[:3, 3]}
        best = minimize(turned, at + 0.002, constraints=[place], method="SLSQP", options={"ftol": 1e-14})
        assert np.sqrt(turned(at)) <= np.sqrt(best.fun) + 1e-5
        assert turned(at) > 1e-6  # there is a turn that it cannot have


def turned_about(vector: list[float]) -> Array:
    angle = float(np.linalg.norm(vector))
    x, y, z = np.array(vector) / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def test_a_place_out_of_reach_is_not_taken():
    far = np.eye(4)[None].copy()
    far[0, :3, 3] = [2000, 0, 0]
    assert not newton_in_part(WIDOWX, far, postures(WIDOWX, 1))[1].any()


def test_true_tool_pose_decides():
    aside = np.array([3.0, -2.0, 1.0])

    def really(q: Array) -> Array:
        T = forward(WIDOWX, q)
        T[:, :3, 3] += aside
        return T

    q = postures(WIDOWX, 5)
    found, reached = newton_in_part(WIDOWX, forward(WIDOWX, q), q, really)
    assert reached.all()
    np.testing.assert_allclose(really(found)[:, :3, 3], forward(WIDOWX, q)[:, :3, 3], atol=1e-6)
    assert forward_and_jacobian(WIDOWX, found)[1].shape[2] == 5


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


@pytest.mark.parametrize(
    ("written", "what"),
    [
        ("tests: {circle: {centre_mm: [0, 0, 0], posture_deg: [0, 0, 0, 0, 0, 0]}}", "imported poses"),
        ("effects: [{effect: backlash, axis: 8}]", "axis"),
    ],
)
def test_unsupported_features_of_seven_axes_are_refused(written, what):
    with refused("rig_file.invalid"):
        parse(f"name: seven\n{load_arm('franka-fr3').text}{written}\n", "seven.yaml")


def test_a_coupling_of_another_size_is_refused():
    robot = load_arm("franka-fr3").robot
    with pytest.raises(ValueError, match="axes lists 7 axes, but coupling has 6 rows"):
        Robot.model_validate({"name": "x", "axes": [one.model_dump() for one in robot.axes], "coupling": identity(6)})
