import numpy as np
import pytest

from analysis.robot.geometry.driven_programs import circle_program
from analysis.robot.kinematics.arm import Array, arm_of, forward, roll_pitch_yaw, transforms, without_setup
from analysis.runs.controller_poses import ControllerPoses, controller_doubt, controller_poses, rig_as_recorded
from rigs.load import load
from rigs.rig import Rig
from rigs.schema.condition import POSE
from rigs.schema.robot import Robot

RIG = load("ur10e-cell")[0]
OWN = [(0.2, 0, 0), (0.1, -0.05, 0), (-0.4, -0.01, 0.03), (0.4, -0.76, 0.02), (0.06, -0.09, 0), (-0.06, 0.05, 0)]
"""Differences of a, alpha, beta from the data sheet, in mm and degrees: sizes of the factory constants of real arms."""


def own_arm() -> Robot:
    axes = [
        axis.model_copy(update={"a_mm": axis.a_mm + a, "alpha_deg": axis.alpha_deg + alpha, "beta_deg": beta})
        for axis, (a, alpha, beta) in zip(RIG.robot.axes, OWN, strict=True)
    ]
    return RIG.robot.model_copy(update={"axes": tuple(axes)})


def stream_of(robot: Robot, q: Array, T_flange_tool: Array | None = None) -> dict[str, Array]:
    T = forward(without_setup(arm_of(robot)), q) @ (np.eye(4) if T_flange_tool is None else T_flange_tool)
    pose = [[*frame[:3, 3], *np.degrees(roll_pitch_yaw(frame))] for frame in T]
    joints = {f"q{axis}_deg": angles for axis, angles in enumerate(np.degrees(q).T, 1)}
    return joints | dict(zip(POSE, np.array(pose).T, strict=True))


def poses_of(robot: Robot, T_flange_tool: Array | None = None) -> ControllerPoses:
    return controller_poses(stream_of(robot, circle_program(RIG, "acw").q, T_flange_tool))


def apart_mm(rig: Rig, robot: Robot) -> float:
    q = np.random.default_rng(5).uniform(-2, 2, (100, 6))
    T, its_T = (forward(without_setup(arm_of(one)), q)[:, :3, 3] for one in (rig.robot, robot))
    return float(np.linalg.norm(T - its_T, axis=1).max())


def test_one_circle_shows_the_constants_of_the_controller_everywhere():
    rig = rig_as_recorded(RIG, poses_of(own_arm()))
    assert rig.controller == "constants" and apart_mm(RIG, own_arm()) > 1
    assert apart_mm(rig, own_arm()) < 1e-3


def test_controller_with_the_data_sheet_is_recognised():
    rig = rig_as_recorded(RIG, poses_of(RIG.robot))
    assert (rig.controller, rig.robot.axes) == ("data_sheet", RIG.robot.axes)


def test_poses_of_a_tool_leave_the_controller_unknown_and_are_reported():
    tool = transforms(np.array([[0.0, 30.0, 150.0, 0.0, 40.0, 0.0]]))[0]
    poses = poses_of(own_arm(), tool)
    assert rig_as_recorded(RIG, poses) is RIG
    assert len(controller_doubt(RIG, poses)) == 1


@pytest.mark.parametrize("stated", ["data_sheet", "constants"])
def test_stated_controller_is_kept_and_its_contradiction_reported(stated):
    rig = RIG.model_copy(update={"robot": RIG.robot.model_copy(update={"controller": stated})})
    assert rig_as_recorded(rig, poses_of(own_arm())) is rig
    assert len(controller_doubt(rig, poses_of(own_arm()))) == 1
    assert controller_doubt(rig, poses_of(RIG.robot)) == []


def test_run_without_poses_changes_nothing():
    stream = stream_of(RIG.robot, circle_program(RIG, "acw").q[:5])
    assert controller_poses({name: column for name, column in stream.items() if name not in POSE}) is None
    assert controller_poses(stream | {POSE[2]: np.full(5, np.nan)}) is None
