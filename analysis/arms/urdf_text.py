"""An arm as the text of a URDF: `world` → `base_link` → `link_1` … `link_n` → `flange` → `tool`.

Joints have the names, senses and limits of the rig file and turn by the angles that the controller reports. A rail is a
prismatic joint between `rail_base`, which stands in the world, and `base_link`. A rig file knows masses and their
centres, and no moments of inertia or torques: these are written as zero, and say so.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from analysis.arms.joint_origins import RAIL_JOINT, joint_origins, joint_senses, metres_and_rpy, rail_way
from analysis.kinematics.arm import RAIL_MM, Arm, Array
from rigs.errors import FileError
from rigs.schema.robot import JointAxis, Rail, Robot

_RAIL_M_S = 1.0
"""What is written as the rail's speed, which a rig file does not know and a URDF must have."""
_HYPHENS = re.compile("-(?=-)")
"""Two in a row end a comment of XML."""
_HEAD = (
    "Lengths are in metres and angles in radians. Joints turn by the angles that the controller reports. Moments of "
    "inertia and torques are not known: they are written as 0."
)
_RAIL_HEAD = f"The joint {RAIL_JOINT} moves the arm in metres. Its speed is not known: it is written as 1 m/s."


def urdf_text(robot: Robot, arm: Arm, where: str, remarks: Sequence[str] = ()) -> str:
    """Return the URDF of an arm, with the names, limits and masses of a robot.

    where: the rig file, for errors. remarks: sentences at the head. Raises FileError for a coupling or for names that
    no URDF can have.
    """
    senses = joint_senses(arm, where, "a URDF")
    require_names(robot, where)
    fixed = _fixed_joints(robot)
    root = ElementTree.Element("robot", name=robot.name)
    for remark in (_HEAD, *([_RAIL_HEAD] if robot.rail else []), *remarks):
        root.append(ElementTree.Comment(f" {_HYPHENS.sub('- ', remark)} "))
    _link(root, "world")
    _link(root, stands := "rail_base" if robot.rail else "base_link")
    _joint(root, fixed[0], "fixed", ("world", stands), arm.T_world_base)
    if robot.rail:
        _link(root, "base_link")
        _sliding(_joint(root, RAIL_JOINT, "prismatic", (stands, "base_link"), np.eye(4)), robot.rail, rail_way(arm))
    before = "base_link"
    for k, (axis, sense, T) in enumerate(zip(robot.axes, senses, joint_origins(arm), strict=True), start=1):
        _link(root, link := f"link_{k}", axis.mass_kg, axis.centre_mm)
        _turning(_joint(root, axis.name, "revolute", (before, link), T), axis, sense)
        before = link
    _link(root, "flange", robot.payload_kg)
    _joint(root, fixed[1], "fixed", (before, "flange"), np.eye(4))
    _link(root, "tool")
    _joint(root, fixed[2], "fixed", ("flange", "tool"), arm.T_flange_tool)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def require_names(robot: Robot, where: str) -> None:
    """Raise FileError for names that XML cannot hold, or that would be those of two joints. where: the rig file."""
    names = [axis.name for axis in robot.axes]
    for k, name in enumerate(names, start=1):
        if not name.strip() or not name.isprintable():
            what = f"axis {k} has the name {name!r}, which no joint of a URDF can have"
            raise FileError(f"{where}, robot.axes", what, "give it a name of printable characters")
        if name in (*names[: k - 1], *_fixed_joints(robot), *([RAIL_JOINT] if robot.rail else [])):
            raise FileError(f"{where}, robot.axes", f"two joints would be named {name!r}", "rename one of them")
    if not robot.name.isprintable():
        what = f"{robot.name!r} is a name that no URDF can have"
        raise FileError(f"{where}, robot.name", what, "give it a name of printable characters")


def _fixed_joints(robot: Robot) -> tuple[str, str, str]:
    """The names of the joints that do not turn."""
    return "world-base_link", f"link_{len(robot.axes)}-flange", "flange-tool"


def _link(root: ElementTree.Element, name: str, kg: float = 0.0, centre_mm: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
    """Add a link, with its mass where it has one."""
    link = ElementTree.SubElement(root, "link", name=name)
    if kg > 0:
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=_numbers([x / 1000.0 for x in centre_mm]), rpy="0.0 0.0 0.0")
        ElementTree.SubElement(inertial, "mass", value=repr(float(kg)))
        moments = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0.0")
        ElementTree.SubElement(inertial, "inertia", moments)


def _joint(
    root: ElementTree.Element, name: str, kind: str, links: tuple[str, str], T_parent_joint: Array
) -> ElementTree.Element:
    """Add a joint between a parent and a child link at T_parent_joint (4, 4) mm, and return it."""
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    xyz, rpy = metres_and_rpy(T_parent_joint)
    ElementTree.SubElement(joint, "origin", xyz=_numbers(xyz), rpy=_numbers(rpy))
    ElementTree.SubElement(joint, "parent", link=links[0])
    ElementTree.SubElement(joint, "child", link=links[1])
    return joint


def _turning(joint: ElementTree.Element, axis: JointAxis, sense: int) -> None:
    """Add the axis and the limits of a joint that turns."""
    ElementTree.SubElement(joint, "axis", xyz=f"0 0 {sense}")
    lower, upper, speed = (repr(float(np.radians(value))) for value in (*axis.limits_deg, axis.speed_deg_s))
    ElementTree.SubElement(joint, "limit", lower=lower, upper=upper, velocity=speed, effort="0.0")


def _sliding(joint: ElementTree.Element, rail: Rail, way: Array) -> None:
    """Add the axis and the limits of a rail, whose way (3,) is in the frame of the base."""
    ElementTree.SubElement(joint, "axis", xyz=_numbers(way.tolist()))
    lower, upper = (repr(end / RAIL_MM) for end in rail.limits_mm)
    ElementTree.SubElement(joint, "limit", lower=lower, upper=upper, velocity=repr(_RAIL_M_S), effort="0.0")


def _numbers(values: Sequence[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)
