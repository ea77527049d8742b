"""The files of `rig export-urdf`, read by the programs that they are for: MuJoCo, xacro, yourdfpy.

    pip install mujoco xacro yourdfpy    # in an environment of its own beside rig: none of them is in the lock
    python tests/trials/outside_readers.py        # of that environment, PYTHONPATH=.

Prints for each reader how far its poses are from those of the model at most, in mm, and for MuJoCo what it makes of a
play and of a compliance: where the hinge of a play stops, and by how much a joint gives way for a torque. Arms are
read as they stand and on a rail; kinematics.yaml by the expressions that the makers' macros of xacro have.
"""

from __future__ import annotations

import sys
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from analysis.apps.interchange.driver_kinematics import LINKS, driver_kinematics, ur_driver_text
from analysis.apps.interchange.mjcf_text import JointTraits, mjcf_text
from analysis.apps.interchange.urdf_text import macro_name, urdf_text, xacro_text
from analysis.correction.work import tool_poses
from analysis.robot.kinematics.arm import Array
from analysis.robot.model.predict import geometric_arm, model_of
from rigs.rig import Rig
from tests.support.changed_arms import changed, within_limits
from tests.support.trial import Trial, main

PLAY_DEG, SOFT_DEG_PER_NM = 0.04, 2e-3
DRIVERS = {"ur": "ur-driver", "franka": "franka", "ufactory": "xarm"}
"""Who reads a file of kinematics, by how the names of the arms begin."""


def draw(given: Namespace) -> Iterator[str]:
    yield from given.arms


def judged(name: str) -> str:
    return "\n".join(_lines(name))


def _lines(name: str) -> Iterator[str]:
    for rail in (False, True):
        rig = changed(name, rail=rail)
        q = within_limits(rig)
        expected, label = tool_poses(model_of(rig), q), f"{name} on a rail" if rail else name
        yield apart(f"{label}, mujoco", mujoco_poses(rig, q), expected)
        yield apart(f"{label}, xacro + yourdfpy", urdf_poses(rig, q), expected)
    rig = changed(name)
    yield f"{name}, mujoco: {traits_of(rig)}"
    if driver := next((driver for maker, driver in DRIVERS.items() if name.startswith(maker)), None):
        arm, q = geometric_arm(model_of(rig)), within_limits(rig)
        outer, inner = np.linalg.inv(arm.T_world_base), np.linalg.inv(arm.T_flange_tool)
        expected = outer @ tool_poses(model_of(rig), q) @ inner
        yield apart(f"{name}, kinematics of {driver} by xacro + yourdfpy", driver_poses(rig, driver, q), expected)


def apart(what: str, poses: Array, expected: Array) -> str:
    """State how far poses (n, 4, 4) mm are off at most, in place and in the elements of the turn."""
    off = np.abs(poses - expected).max(axis=0)
    return f"{what}: off by {off[:3, 3].max():.1e} mm and {off[:3, :3].max():.1e} rad at most"


def mujoco_model(rig: Rig) -> Any:
    """MuJoCo's model of a rig, with a play in axis 2 and a compliance in axis 3."""
    import mujoco  # noqa: PLC0415 - not in the lock

    traits = JointTraits({2: PLAY_DEG}, {3: SOFT_DEG_PER_NM})
    return mujoco.MjModel.from_xml_string(mjcf_text(rig.robot, geometric_arm(model_of(rig)), traits, "rig"))


def mujoco_poses(rig: Rig, q: Array) -> Array:
    """Poses (n, 4, 4) mm of the tool by MuJoCo."""
    import mujoco  # noqa: PLC0415

    model = mujoco_model(rig)
    data, poses = mujoco.MjData(model), []
    for angles in q:
        data.qpos[:] = 0.0
        for joint, value in zip(joints_of(rig), angles, strict=True):
            data.joint(joint).qpos[0] = value
        mujoco.mj_kinematics(model, data)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = data.site("tool").xmat.reshape(3, 3), 1000 * data.site("tool").xpos
        poses.append(T)
    return np.array(poses)


def joints_of(rig: Rig) -> list[str]:
    """The names of the joints in the order of the columns of an angle."""
    return [*(axis.name for axis in rig.robot.axes), *(["rail"] if rig.robot.rail else [])]


def urdf_poses(rig: Rig, q: Array) -> Array:
    """Poses (n, 4, 4) mm of the tool: a description that calls the macro, expanded by xacro, read by yourdfpy."""
    import xacro  # noqa: PLC0415
    import yourdfpy  # noqa: PLC0415

    arm = geometric_arm(model_of(rig))
    with tempfile.TemporaryDirectory() as folder:
        macro, own, urdf = (Path(folder) / name for name in ("arm.xacro", "own.xacro", "own.urdf"))
        macro.write_text(xacro_text(rig.robot, arm, "rig"), encoding="utf-8")
        own.write_text(
            f'<robot name="own" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="{macro}"/>'
            f'<link name="table"/><xacro:{macro_name(rig.robot)} prefix="left_" parent="table"/></robot>',
            encoding="utf-8",
        )
        urdf.write_text(xacro.process_file(str(own)).toxml(), encoding="utf-8")
        robot = yourdfpy.URDF.load(str(urdf), load_meshes=False, build_scene_graph=True)
    plain = urdf_text(rig.robot, arm, "rig")
    names = [f"left_{joint}" for joint in joints_of(rig)]
    assert sorted(robot.actuated_joint_names) == sorted(names), plain[:200]
    return poses_of(robot, names, q, "left_tool", "table")


def poses_of(robot: Any, joints: list[str], q: Array, end: str, start: str) -> Array:
    """Poses (n, 4, 4) mm of a link in another by yourdfpy, at q (n, joints)."""
    poses = []
    for angles in q:
        robot.update_cfg(dict(zip(joints, angles, strict=True)))
        T = np.array(robot.get_transform(end, start))
        T[:3, 3] *= 1000
        poses.append(T)
    return np.array(poses)


def driver_poses(rig: Rig, driver: str, q: Array) -> Array:
    """Poses (n, 4, 4) mm of the flange in the base by a file of kinematics, whose joints a description of xacro takes
    as the makers' do: ur_description/urdf/inc/ur_common.xacro and ur_macro.xacro, franka_description/robots/common/
    utils.xacro (franka-kinematics) and franka_arm.xacro, xarm_description/urdf/xarm6/xarm6.urdf.xacro."""
    import xacro  # noqa: PLC0415
    import yourdfpy  # noqa: PLC0415

    arm, axes = geometric_arm(model_of(rig)), len(rig.robot.axes)
    text = ur_driver_text(arm, "rig") if driver == "ur-driver" else driver_kinematics(rig.robot, arm, driver, "rig")
    numbers = range(1, axes + 1)
    parts = {
        "ur-driver": [f"config['kinematics']['{link}']" for link in LINKS],
        "franka": [f"config['joint{number}']['kinematic']" for number in (*numbers, axes + 1)],
        "xarm": [f"config['kinematics']['joint{number}']" for number in numbers],
    }[driver]
    fixed = {"ur-driver": "0 0 0|0 0 ${pi}", "franka": "0 0 0|0 0 0", "xarm": "0 0 0|0 0 0"}[driver]
    ends = ["0 0 0|0 ${-pi/2} ${-pi/2}", "0 0 0|${pi/2} 0 ${pi/2}"] if driver == "ur-driver" else []
    origins = [fixed]
    for part in parts:
        xyz, rpy = (" ".join(f"${{{part}['{key}']}}" for key in keys) for keys in ("xyz", ("roll", "pitch", "yaw")))
        origins.append(f"{xyz}|{rpy}")
    links = [f'<link name="l{number}"/>' for number in range(len(origins + ends) + 1)]
    joints = []
    for number, origin in enumerate(origins + ends):
        xyz, _, rpy = origin.partition("|")
        kind = "continuous" if 1 <= number <= axes else "fixed"
        joints.append(
            f'<joint name="j{number}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="l{number}"/>'
            f'<child link="l{number + 1}"/><axis xyz="0 0 1"/></joint>'
        )
    with tempfile.TemporaryDirectory() as folder:
        config, own, urdf = (Path(folder) / name for name in ("kinematics.yaml", "own.xacro", "own.urdf"))
        config.write_text(text, encoding="utf-8")
        loaded = f'<xacro:property name="config" value="${{xacro.load_yaml(\'{config}\')}}"/>'
        head = '<robot name="own" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        own.write_text(f"{head}{loaded}{''.join(links + joints)}</robot>", encoding="utf-8")
        urdf.write_text(xacro.process_file(str(own)).toxml(), encoding="utf-8")
        robot = yourdfpy.URDF.load(str(urdf), load_meshes=False, build_scene_graph=True)
    names = [f"j{number}" for number in numbers]
    # base_link of ur_description is turned by half a turn from the controller's base
    poses = poses_of(robot, names, q, f"l{len(joints)}", "l0")
    return np.diag([-1.0, -1.0, 1.0, 1.0]) @ poses if driver == "ur-driver" else poses


def traits_of(rig: Rig) -> str:
    """Limits of the hinge of a backlash, and the deflection of a compliance under a static torque."""
    import mujoco  # noqa: PLC0415

    model = mujoco_model(rig)
    play = model.joint(f"{rig.robot.axes[1].name}_play").range
    soft = model.joint(f"{rig.robot.axes[2].name}_compliance").stiffness[0]
    return (
        f"play {np.degrees(play[1] - play[0]):.12g}° of {PLAY_DEG}°, compliance {np.degrees(1 / soft):.12g} °/Nm of "
        f"{SOFT_DEG_PER_NM:g}; {mujoco.__version__}"
    )


TRIAL = Trial(
    draw,
    judged,
    options={"ARMS": (("ur10e", "franka-fr3", "ufactory-xarm-6", "ufactory-xarm-7"), "arms of the library")},
)

if __name__ == "__main__":
    sys.exit(main(TRIAL))
