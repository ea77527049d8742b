"""Export of an arm as a URDF, `world` → `base_link` → `link_1` … `link_n` → `flange` → `tool`, and as a xacro macro.

Joint values are the controller's angles. A rail is a prismatic joint between `rail_base`, fixed in the world, and
`base_link`. Unknown moments of inertia and torques are zero. The macro has a prefix and a parent link.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import product
from xml.etree import ElementTree

import numpy as np

from analysis.robot.kinematics.arm import RAIL_MM, Arm, Array, roll_pitch_yaw
from rigs.errors import FileError
from rigs.schema.robot import Robot

RAIL_JOINT = "rail"
_ZERO = 1e-15
"""Magnitude in m and rad of a rounded zero: a thousandth of the permitted difference between file and arm."""


def joint_senses(arm: Arm, where: str, kind: str) -> list[int]:
    """Direction 1 or -1 of each axis relative to the controller's angle. kind: of file, for errors.

    Raises FileError if an axis is coupled to another, or turns by a different ratio.
    """
    senses = np.sign(np.diag(arm.coupling))
    if not np.array_equal(arm.coupling, np.diag(senses)) or not senses.all():
        wrong = (arm.coupling != np.diag(senses)).any(axis=1) | (senses == 0)
        axis = int(np.flatnonzero(wrong)[0]) + 1
        problem = f"axis {axis} is coupled to other joints or has a different ratio, which {kind} cannot represent"
        remedy = (
            "in a copy, set coupling to the signs only, and convert joint angles to axis angles before using the file"
        )
        raise FileError(f"{where}, robot.coupling", problem, remedy, code="output.invalid")
    return [int(sense) for sense in senses]


def joint_origins(arm: Arm) -> Array:
    """Joint frames (n, 4, 4) in mm with all angles zero, each relative to the previous joint."""
    c, s = np.cos(arm.offset), np.sin(arm.offset)
    turned = np.tile(np.eye(4), (len(arm.a), 1, 1))
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 1, 0], turned[:, 1, 1] = c, -s, s, c
    return np.asarray(arm.links_at_zero @ turned)


def rail_way(arm: Arm) -> Array:
    """Direction (3,) of the rail in the base frame."""
    assert arm.rail is not None  # noqa: S101 - asked for rails alone
    way: Array = arm.T_world_base[:3, :3].T @ arm.rail
    return way / np.linalg.norm(way)


def metres_and_rpy(T: Array) -> tuple[list[float], list[float]]:
    """x, y, z in metres and roll, pitch, yaw in rad of a frame (4, 4) in mm."""
    values = np.concatenate([T[:3, 3] / 1000.0, roll_pitch_yaw(T)])
    values[np.abs(values) < _ZERO] = 0.0
    return values[:3].tolist(), values[3:].tolist()


_RAIL_M_S = 1.0
"""Rail speed in the file. A URDF requires it, but a rig file does not contain it."""
_HYPHENS = re.compile("-(?=-)")
"""Consecutive hyphens, which would end an XML comment."""
_HEAD = (
    "Lengths are in metres and angles in radians. Joints turn by the angles that the controller reports. Moments of "
    "inertia and torques are unknown: they are written as 0."
)
_RAIL_HEAD = f"The joint {RAIL_JOINT} moves the arm in metres. Its speed is unknown: it is written as 1 m/s."


def urdf_text(robot: Robot, arm: Arm, where: str, remarks: Sequence[str] = ()) -> str:
    """Write an arm as URDF, with names, limits and masses of a robot.

    remarks: sentences at the top. Raises FileError if axes are coupled or a name is invalid.
    """
    return xml_text(_urdf(robot, arm, where, remarks))


def _urdf(robot: Robot, arm: Arm, where: str, remarks: Sequence[str]) -> ElementTree.Element:
    senses = joint_senses(arm, where, "a URDF")
    require_names(robot, where)
    fixed = _fixed_joints(robot)
    root = ElementTree.Element("robot", name=robot.name)
    add_remarks(root, (_HEAD, *([_RAIL_HEAD] if robot.rail else []), *remarks))
    _link(root, "world")
    _link(root, stands := "rail_base" if robot.rail else "base_link")
    _joint(root, fixed[0], "fixed", ("world", stands), arm.T_world_base)
    if robot.rail:
        _link(root, "base_link")
        slide = _joint(root, RAIL_JOINT, "prismatic", (stands, "base_link"), np.eye(4))
        low, high = (end / RAIL_MM for end in robot.rail.limits_mm)
        _limited(slide, rail_way(arm).tolist(), low, high, _RAIL_M_S)
    before = "base_link"
    for k, (axis, sense, T) in enumerate(zip(robot.axes, senses, joint_origins(arm), strict=True), start=1):
        _link(root, link := f"link_{k}", axis.mass_kg, axis.centre_mm)
        turns = _joint(root, axis.name, "revolute", (before, link), T)
        low, high, speed = np.radians([*axis.limits_deg, axis.speed_deg_s]).tolist()
        _limited(turns, (0, 0, sense), low, high, speed)
        before = link
    _link(root, "flange", robot.payload_kg)
    _joint(root, fixed[1], "fixed", (before, "flange"), np.eye(4))
    _link(root, "tool")
    _joint(root, fixed[2], "fixed", ("flange", "tool"), arm.T_flange_tool)
    return root


def require_names(robot: Robot, where: str) -> None:
    """Raise FileError for a name that is invalid in XML or shared by two joints."""
    names = [axis.name for axis in robot.axes]
    for k, name in enumerate(names, start=1):
        if not name.strip() or not name.isprintable():
            problem = f"axis {k} has the name {name!r}, which is not valid in a URDF"
            raise FileError(f"{where}, robot.axes", problem, "use printable characters only", code="output.invalid")
        if name in (*names[: k - 1], *_fixed_joints(robot), *([RAIL_JOINT] if robot.rail else [])):
            raise FileError(
                f"{where}, robot.axes",
                f"two joints would be named {name!r}",
                "rename one of them",
                code="output.invalid",
            )
    if not robot.name.isprintable():
        problem = f"the name {robot.name!r} is not valid in a URDF"
        raise FileError(f"{where}, robot.name", problem, "use printable characters only", code="output.invalid")


def _fixed_joints(robot: Robot) -> tuple[str, str, str]:
    return "world-base_link", f"link_{len(robot.axes)}-flange", "flange-tool"


def _link(root: ElementTree.Element, name: str, kg: float = 0.0, centre_mm: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
    link = ElementTree.SubElement(root, "link", name=name)
    if kg > 0:
        inertial = ElementTree.SubElement(link, "inertial")
        ElementTree.SubElement(inertial, "origin", xyz=numbers_text([x / 1000.0 for x in centre_mm]), rpy="0.0 0.0 0.0")
        ElementTree.SubElement(inertial, "mass", value=repr(float(kg)))
        moments = dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0.0")
        ElementTree.SubElement(inertial, "inertia", moments)


def _joint(
    root: ElementTree.Element, name: str, kind: str, links: tuple[str, str], T_parent_joint: Array
) -> ElementTree.Element:
    """Add a joint between two links, parent and child, at T_parent_joint (4, 4) mm."""
    joint = ElementTree.SubElement(root, "joint", name=name, type=kind)
    xyz, rpy = metres_and_rpy(T_parent_joint)
    ElementTree.SubElement(joint, "origin", xyz=numbers_text(xyz), rpy=numbers_text(rpy))
    ElementTree.SubElement(joint, "parent", link=links[0])
    ElementTree.SubElement(joint, "child", link=links[1])
    return joint


def _limited(joint: ElementTree.Element, way: Sequence[float], lower: float, upper: float, speed: float) -> None:
    ElementTree.SubElement(joint, "axis", xyz=" ".join(map(repr, way)))
    limit = {"lower": repr(lower), "upper": repr(upper), "velocity": repr(speed), "effort": "0.0"}
    ElementTree.SubElement(joint, "limit", limit)


def numbers_text(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def xml_text(root: ElementTree.Element) -> str:
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="utf-8"?>\n{ElementTree.tostring(root, encoding="unicode")}\n'


def add_remarks(root: ElementTree.Element, remarks: Iterable[str]) -> None:
    for remark in remarks:
        root.append(ElementTree.Comment(f" {_HYPHENS.sub('- ', remark)} "))


_XACRO = "http://www.ros.org/wiki/xacro"
_EXPANDS = re.compile(r"\$+[{(]")


def macro_name(robot: Robot) -> str:
    letters = re.sub(r"\W+", "_", robot.name.casefold(), flags=re.ASCII).strip("_")
    return letters if letters and not letters[0].isdigit() else f"arm_{letters}".rstrip("_")


def xacro_text(robot: Robot, arm: Arm, where: str, remarks: Sequence[str] = ()) -> str:
    """Write a macro of an arm with a prefix for all names and a parent link as parameters.

    Raises FileError like `urdf_text`, and for a name that xacro would evaluate.
    """
    for name in (robot.name, *(axis.name for axis in robot.axes)):
        if _EXPANDS.search(name):
            raise FileError(
                f"{where}, robot",
                f"xacro would evaluate the name {name!r}",
                "remove the $ from it",
                code="output.invalid",
            )
    ElementTree.register_namespace("xacro", _XACRO)
    root = ElementTree.Element("robot")
    name = macro_name(robot)
    root.append(ElementTree.Comment(f' include this file, then: <xacro:{name} prefix="left_" parent="table"/> '))
    macro = ElementTree.SubElement(root, f"{{{_XACRO}}}macro", name=name, params="prefix:='' parent:=world")
    for part in _urdf(robot, arm, where, remarks):
        if part.get("name") == "world" and part.tag == "link":
            continue
        # add the prefix to link and joint names, and replace the world by the parent
        for element, key in product(part.iter(), ("name", "link")):
            if called := element.get(key):
                element.set(key, "${parent}" if called == "world" else "${prefix}" + called)
        (root if callable(part.tag) else macro).append(part)
    return xml_text(root)
