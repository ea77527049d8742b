"""The files of `rig export-urdf`, read by the programs that they are for: MuJoCo, xacro, yourdfpy.

    pip install mujoco xacro yourdfpy    # in an environment of its own beside rig: none of them is in the lock
    scripts/dev outside_readers ur10e franka-fr3

Prints for each reader how far its poses are from those of the model at most, in mm, and for MuJoCo what it makes of a
play and of a compliance: where the hinge of a play stops, and by how much a joint gives way for a torque.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arms.mjcf_text import JointTraits, mjcf_text
from analysis.arms.urdf_text import urdf_text
from analysis.arms.xacro_text import macro_name, xacro_text
from analysis.correction.work import tool_poses
from analysis.kinematics.arm import Array
from analysis.model.predict import geometric_arm, model_of
from rigs.rig import Rig
from tests.support.changed_arms import changed, within_limits

PLAY_DEG, SOFT_DEG_PER_NM = 0.04, 2e-3


def main() -> None:
    """Read the files of each arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("arms", nargs="*", default=["ur10e", "franka-fr3"])
    for name in parser.parse_args().arms:
        rig = changed(name)
        q = within_limits(rig)
        expected = tool_poses(model_of(rig), q)
        for reader, poses in (("mujoco", mujoco_poses(rig, q)), ("xacro + yourdfpy", urdf_poses(rig, q))):
            print(f"{name}, {reader}: poses off by {np.abs(poses - expected)[:, :3, 3].max():.1e} mm at most")
        print(f"{name}, mujoco: {traits_of(rig)}")


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
        for axis, angle in zip(rig.robot.axes, angles, strict=True):
            data.joint(axis.name).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = data.site("tool").xmat.reshape(3, 3), 1000 * data.site("tool").xpos
        poses.append(T)
    return np.array(poses)


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
    assert robot.actuated_joint_names == [f"left_{axis.name}" for axis in rig.robot.axes], plain[:200]
    poses = []
    for angles in q:
        robot.update_cfg(np.array(angles))
        T = np.array(robot.get_transform("left_tool", "table"))
        T[:3, 3] *= 1000
        poses.append(T)
    return np.array(poses)


def traits_of(rig: Rig) -> str:
    """Where the hinge of a play stops, and how far a compliance gives way under a torque at rest."""
    import mujoco  # noqa: PLC0415

    model = mujoco_model(rig)
    play = model.joint(f"{rig.robot.axes[1].name}_play").range
    soft = model.joint(f"{rig.robot.axes[2].name}_compliance").stiffness[0]
    return (
        f"play {np.degrees(play[1] - play[0]):.12g}° of {PLAY_DEG}°, compliance {np.degrees(1 / soft):.12g} °/Nm of "
        f"{SOFT_DEG_PER_NM:g}; {mujoco.__version__}"
    )


if __name__ == "__main__":
    main()
