"""Programs that a user would take instead of rig's kinematics, behind rig's arms. Each takes radians and mm.

EAIK and pinocchio have an arm as axes and places at its zero, py-opw-kinematics as published parameters, the Robotics
Toolbox as elementary transforms. Where one cannot be imported its row says so.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from analysis.robot.kinematics.arm import Arm, Array, forward, link_frames
from tests.support.benchmarks import Peer
from tests.support.five_arms import OPW, PeerArm

MM = 1000.0
"""mm of a metre, the unit of the peers."""


# private _robot: the peer alone is timed, without the units and the flange that PeerArm puts around it


def opw_forward(name: str, q: Array) -> Peer:
    """py-opw-kinematics: poses as matrices."""
    robot, degrees = PeerArm(OPW[name])._robot, np.degrees(q @ OPW[name].coupling.T)
    return Peer("py-opw-kinematics", lambda: robot.batch_forward(degrees).as_matrix())


def opw_branches(name: str, T: Array) -> Peer:
    robot = PeerArm(OPW[name])._robot
    return Peer("py-opw-kinematics", lambda: robot.reach(RigidTransform.from_matrix(_flange(name, T))).joints)


def opw_along(name: str, T: Array, start: Array) -> Peer:
    """py-opw-kinematics: at each pose the branch nearest to the one before."""
    robot, begin = PeerArm(OPW[name])._robot, tuple(np.degrees(OPW[name].coupling @ start).tolist())
    return Peer(
        "py-opw-kinematics",
        lambda: robot.batch_inverse(RigidTransform.from_matrix(_flange(name, T)), current_joints=begin),
    )


def _flange(name: str, T: Array) -> Array:
    """Poses (n, 4, 4) of the flange in the base, as the peer has them, from those of the tool in the world."""
    arm = OPW[name].arm()
    return np.linalg.inv(arm.T_world_base) @ T @ np.linalg.inv(arm.T_flange_tool)


def eaik_branches(arm: Arm, T: Array) -> Peer:
    try:
        from eaik.IK_HP import HPRobot  # noqa: PLC0415 - may be missing
    except ImportError as error:
        return Peer("EAIK", missing=str(error))
    still = np.zeros((1, 6))
    frames, tool = link_frames(arm, still)[0], forward(arm, still)[0]
    places = np.vstack([np.zeros(3), frames[:, :3, 3], tool[:3, 3]])
    # Rounded: it takes axes for parallel, and decides how to solve, within less than their rounding.
    robot = HPRobot(np.round(frames[:, :3, 2], 14), np.round(np.diff(places, axis=0) / MM, 14))
    poses = T.copy()
    poses[:, :3, 3] /= MM
    poses[:, :3, :3] = poses[:, :3, :3] @ tool[:3, :3].T
    return Peer("EAIK", lambda: robot.IK_batched(poses, 1))


def toolbox_one(arm: Arm, T: Array) -> Peer:
    """Robotics Toolbox for Python: one solution of each pose by Levenberg-Marquardt, from random starts."""
    try:
        from roboticstoolbox import ET, ETS  # noqa: PLC0415 - may be missing
    except ImportError as error:
        return Peer("roboticstoolbox ik_LM, one solution", missing=str(error))
    chain = ETS()
    for axis in range(6):
        chain = chain * ET.Rx(arm.alpha[axis]) * ET.tx(arm.a[axis] / MM) * ET.Ry(arm.beta[axis]) * ET.Rz()
        chain = chain * ET.tz(arm.d[axis] / MM)
    poses = np.linalg.inv(arm.T_world_base) @ T @ np.linalg.inv(arm.T_flange_tool)
    poses[:, :3, 3] /= MM
    return Peer("roboticstoolbox ik_LM, one solution", lambda: [chain.ik_LM(pose, tol=1e-12) for pose in poses])


def pinocchio_along(arm: Arm, T: Array, start: Array) -> Peer:
    """Pinocchio: Newton from each pose to the next, in a loop of Python."""
    try:
        import pinocchio as pin  # noqa: PLC0415 - may be missing
    except ImportError as error:
        return Peer("pinocchio, Newton", missing=str(error))
    model = pin.Model()
    placement, joint = pin.SE3(arm.T_world_base), 0
    for axis in range(6):
        placement = placement * pin.SE3(pin.utils.rotate("x", arm.alpha[axis]), np.zeros(3))
        placement = placement * pin.SE3(pin.utils.rotate("y", arm.beta[axis]), np.array([arm.a[axis], 0, 0]))
        joint = model.addJoint(joint, pin.JointModelRZ(), placement, f"J{axis + 1}")
        placement = pin.SE3(np.eye(3), np.array([0, 0, arm.d[axis]]))
    tool = pin.Frame("tool", joint, 0, placement * pin.SE3(arm.T_flange_tool), pin.FrameType.OP_FRAME)
    frame = model.addFrame(tool)
    data = model.createData()
    targets = [pin.SE3(pose) for pose in T]

    def walk() -> Array:
        theta, path = arm.coupling @ start + arm.offset, []
        for target in targets:
            for _ in range(20):
                pin.forwardKinematics(model, data, theta)
                error = pin.log6(pin.updateFramePlacement(model, data, frame).actInv(target)).vector
                if np.abs(error).max() < 1e-9:
                    break
                theta = theta + np.linalg.solve(pin.computeFrameJacobian(model, data, theta, frame, pin.LOCAL), error)
            path.append(theta)
        return np.array(path)

    return Peer("pinocchio, Newton", walk)
