"""A URDF as the `robot:` section of a rig file, held against the library that read it before anyone sees it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.arms.axis_lines import AxisLines
from analysis.arms.robot_section import Section, checked_section
from analysis.arms.urdf_chain import Chain, axes_of, chain_of, joints_of, listed, others_of
from analysis.arms.urdf_file import read_urdf
from analysis.kinematics.arm import RAIL_MM, Array
from rigs.schema.robot import Pose

_EXACT_RAD, _SLIGHT_RAD = 1e-6, 0.02
"""Axes are parallel or at right angles to a micrometre a metre, or say so where they are nearly so, within a degree."""


@dataclass(frozen=True)
class UrdfArm:
    """An arm of a URDF, from the link base to the link tip. doubts: what a person should look at."""

    section: Section
    base: str
    tip: str
    doubts: tuple[str, ...]


def import_urdf(path: Path, base: str | None = None, tip: str | None = None) -> UrdfArm:
    """Return the arm between two links of a URDF. Raises FileError for what has no four to seven axes."""
    urdf = read_urdf(path)
    chain = chain_of(urdf, base, tip, str(path))
    axes = axes_of(chain)
    head = (
        f"From {path.name}: {chain.base} to {chain.tip}. Joints count as in the URDF, which may not be as the",
        "controller counts: compare zeros, signs, and J3 of a FANUC, and correct offset_deg and coupling.",
    )
    section = checked_section(urdf.name, axes, joints_of(urdf, chain), head, lambda q: library_poses(chain, q), path)
    doubts, robot = _slightly_off(axes, chain), section.robot
    # A person who writes another base or tool loses what is between.
    if robot.base != Pose():
        doubts.append(
            "axis 1 does not go through the base's origin: the way there is in base; keep it as part of yours"
        )
    if robot.tool != Pose():
        doubts.append(
            f"the tip is not on axis {len(robot.axes)}: the way there is in tool; keep it as part of yours, or choose "
            "another --tip"
        )
    if others := others_of(urdf, chain):
        doubts.append(f"further moving joints are left out, with the masses on them: {listed(others)}")
    if endless := [joint.name for joint in chain.turning if joint.type == "continuous"]:
        limits = "limits_deg are a turn to either side; correct them where the controller counts otherwise"
        doubts.append(f"joints turn without end: {listed(endless)}; {limits}")
    return UrdfArm(section, chain.base, chain.tip, tuple(doubts))


def library_poses(chain: Chain, q: Array) -> Array:
    """Return the poses (n, 4, 4) mm of the tip in the base frame as pytransform3d computes them; q (n, axes) rad, with
    where the rail stands in m, of a chain that has one."""
    from pytransform3d.urdf import UrdfTransformManager  # noqa: PLC0415 - an extra of the package

    frames = UrdfTransformManager()
    for joint in (*chain.up, *chain.down):
        kind = "revolute" if chain.turns(joint) else "prismatic" if joint is chain.rail else "fixed"
        frames.add_joint(joint.name, joint.child, joint.parent, joint.T_parent_child, joint.axis, joint_type=kind)
    poses = []
    for angles in q.tolist():
        for joint, angle in zip(chain.turning, angles, strict=False):
            frames.set_joint(joint.name, angle)
        if chain.rail:
            frames.set_joint(chain.rail.name, RAIL_MM * angles[-1])
        poses.append(frames.get_transform(chain.tip, chain.base))
    return np.array(poses, dtype=float)


def _slightly_off(axes: AxisLines, chain: Chain) -> list[str]:
    """What to say of successive axes that are nearly, and not quite, parallel or at right angles."""
    pairs = []
    for z, z_next, *joints in zip(
        axes.directions[:-1], axes.directions[1:], chain.turning[:-1], chain.turning[1:], strict=True
    ):
        sine, cosine = float(np.linalg.norm(np.cross(z, z_next))), abs(float(z @ z_next))
        if _EXACT_RAD < (off := min(sine, cosine)) < _SLIGHT_RAD:
            kind = "parallel" if sine < cosine else "a right angle"
            pairs.append(f"{' and '.join(joint.name for joint in joints)} {np.degrees(off):.4f} degrees off {kind}")
    if not pairs:
        return []
    remedy = "they are kept so; if the URDF was rounded (1.571 for 1.5707963267948966), correct it there"
    return [f"axes are nearly, and not quite, as they are built: {', '.join(pairs)}; {remedy}"]
