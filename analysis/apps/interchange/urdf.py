"""Import of a URDF as the `robot:` section of a rig file, verified against an independent library.

The file is read as joints and masses in mm, with a size limit and no entities or macros. Shapes are ignored, because
the kinematics need no meshes. pytransform3d reads the joints a second time and computes the poses for the comparison.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from analysis.robot.description.axis_lines import AxisLines
from analysis.robot.description.rig_section import Joint, RobotSection, checked_section
from analysis.robot.kinematics.arm import Array, transform
from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from rigs.files import read_text
from rigs.schema.robot import Pose, Rail
from rigs.schema.vocabulary import FEWEST_AXES, MOST_AXES
from rigs.text import first_of

_MOST_BYTES = 10_000_000
"""Size limit; the URDF of a humanoid has half a megabyte, and meshes are separate files."""
_MOST_PARTS = 2000
"""Limit of links and joints; a humanoid with both hands has about a hundred."""
_LARGEST = 1e6
_TYPES = ("revolute", "continuous", "prismatic", "fixed")
_GIVE_URDF = "give a URDF file, such as the output of xacro"


@dataclass(frozen=True)
class UrdfJoint:
    name: str
    type: str
    parent: str
    child: str
    T_parent_child: Array
    """Frame (4, 4) at zero, with the position in mm."""
    axis: Array
    """In that frame, of any length."""
    lower: float
    """In rad; also `upper`, and `velocity` in rad/s."""
    upper: float
    velocity: float
    follows: str | None
    """The joint that this one mimics."""

    @property
    def moves(self) -> bool:
        return self.type != "fixed"


@dataclass(frozen=True)
class Urdf:
    name: str
    masses: dict[str, tuple[float, Array]]
    """Mass of each link in kg by name, and its centre (3,) mm in the frame of the link."""
    joints: tuple[UrdfJoint, ...]
    kinematics: str
    """The URDF with nothing but the places of its links and joints."""


def read_urdf(path: Path) -> Urdf:
    where = str(path)
    root = _xml_root(path)
    name, masses, bare = _attribute(root, "name", where), dict[str, tuple[float, Array]](), ElementTree.Element("robot")
    bare.set("name", name)
    for link in root.findall("link"):
        link_name = _attribute(link, "name", where)
        if link_name in masses:
            raise FileError(where, f"has two links named {link_name}", "rename one of them", code="urdf.invalid")
        (kg,) = _numbers(link, "inertial/mass", "value", (0.0,), where)
        if kg < 0:
            raise FileError(where, f"link {link_name} has the mass {kg:g} kg", "correct it", code="urdf.invalid")
        masses[link_name] = kg, _frame(link, "inertial/origin", where)[:3, 3]
        ElementTree.SubElement(bare, "link", name=link_name)
    joints = tuple(_joint(joint, where) for joint in root.findall("joint"))
    bare.extend(map(_bare, root.findall("joint")))
    names, children = [joint.name for joint in joints], [joint.child for joint in joints]
    if unknown := [end for joint in joints for end in (joint.parent, joint.child) if end not in masses]:
        raise FileError(where, f"link {unknown[0]} of a joint is missing", "correct the joint", code="urdf.invalid")
    if twice := _twice(names):
        raise FileError(where, f"has two joints named {twice}", "rename one of them", code="urdf.invalid")
    if twice := _twice(children):
        remedy = "remove one of them: a URDF is a tree"
        raise FileError(where, f"link {twice} is the child of two joints", remedy, code="urdf.invalid")
    return Urdf(name, masses, joints, ElementTree.tostring(bare, encoding="unicode"))


def _xml_root(path: Path) -> ElementTree.Element:
    where = str(path)
    try:
        text = read_text(path, _MOST_BYTES)
    except OSError as error:
        raise FileError(where, error.strerror or str(error), _GIVE_URDF, code="file.unreadable") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # A few lines of nested entities expand to gigabytes.
        problem = "declares a document type or entities, which are not allowed in a URDF"
        raise FileError(where, problem, "remove <!DOCTYPE …>", code="urdf.invalid")
    try:
        root = ElementTree.fromstring(text.encode())  # noqa: S314 - no entities
    except ElementTree.ParseError as error:
        raise FileError(where, f"not XML: {error}", _GIVE_URDF, code="urdf.invalid") from None
    if root.tag != "robot":
        problem = f"is not a URDF: the root element is <{root.tag}>, not <robot>"
        raise FileError(where, problem, _GIVE_URDF, code="urdf.invalid")
    if any("xacro" in str(part.tag) or any("${" in value for value in part.attrib.values()) for part in root.iter()):
        raise FileError(
            where, "is xacro, not URDF", "expand the macros first: xacro FILE > arm.urdf", code="urdf.invalid"
        )
    if (count := len(root.findall("link")) + len(root.findall("joint"))) > _MOST_PARTS:
        problem = f"has {count} links and joints, more than {_MOST_PARTS}"
        raise FileError(where, problem, "give the URDF of a single arm", code="file.too_large")
    return root


def _joint(element: ElementTree.Element, where: str) -> UrdfJoint:
    name, kind = _attribute(element, "name", where), element.get("type")
    if kind not in _TYPES:
        problem = f"joint {name} is {kind}" if kind else f"joint {name} has no type"
        raise FileError(where, problem, "write type revolute, or remove the joint", code="urdf.invalid")
    ends = [element.find(end) for end in ("parent", "child")]
    if any(end is None for end in ends):
        raise FileError(where, f"joint {name} lacks the parent or the child", "add it", code="urdf.invalid")
    parent, child = (_attribute(end, "link", where) for end in ends if end is not None)
    bounds = (("lower", -math.inf), ("upper", math.inf), ("velocity", math.inf))
    ((lower,), (upper,), (velocity,)) = (_numbers(element, "limit", key, (value,), where) for key, value in bounds)
    if kind == "continuous":
        lower, upper = -_ENDLESS_RAD, _ENDLESS_RAD
    axis = np.array(_numbers(element, "axis", "xyz", (1.0, 0.0, 0.0), where))
    mimic = element.find("mimic")
    follows = None if mimic is None else mimic.get("joint", "")
    T = _frame(element, "origin", where)
    return UrdfJoint(name, kind, parent, child, T, axis, lower, upper, velocity, follows)


_KINEMATICS = {"parent": ("link",), "child": ("link",), "origin": ("xyz", "rpy"), "axis": ("xyz",)}
"""Attributes of the parts of a joint that pytransform3d needs. Its parser takes quadratic time for attributes."""


def _bare(joint: ElementTree.Element) -> ElementTree.Element:
    bare = ElementTree.Element("joint", {key: joint.attrib[key] for key in ("name", "type")})
    for tag, keys in _KINEMATICS.items():
        if (part := joint.find(tag)) is not None:
            ElementTree.SubElement(bare, tag, {key: part.attrib[key] for key in keys if key in part.attrib})
    return bare


def _attribute(element: ElementTree.Element, key: str, where: str) -> str:
    if (value := element.get(key)) is None:
        raise FileError(where, f"an element <{element.tag}> has no {key}", "add it", code="urdf.invalid")
    return value


def _frame(element: ElementTree.Element, origin: str, where: str) -> Array:
    x, y, z = _numbers(element, origin, "xyz", (0.0, 0.0, 0.0), where)
    rpy = _numbers(element, origin, "rpy", (0.0, 0.0, 0.0), where)
    roll, pitch, yaw = np.degrees(rpy).tolist()
    return transform(Pose.model_construct(xyz_mm=(_MM * x, _MM * y, _MM * z), rpy_deg=(roll, pitch, yaw)))


def _numbers(
    element: ElementTree.Element, below: str, key: str, default: tuple[float, ...], where: str
) -> tuple[float, ...]:
    """Numbers of an attribute, as many as the default. Raises FileError for impossible ones."""
    part = element.find(below)
    words = None if part is None else part.get(key)
    if words is None:
        return default
    try:
        numbers = tuple(map(float, words.split()))
    except ValueError:
        numbers = ()
    if len(numbers) != len(default) or not all(abs(number) < _LARGEST for number in numbers):
        problem = f"{element.tag} {element.get('name')} has {below} {key}={words!r}"
        remedy = f"write {'three numbers' if len(default) == 3 else 'a number'} in the range of a robot arm"
        raise FileError(where, problem, remedy, code="urdf.invalid")
    return numbers


def _twice(names: Sequence[str]) -> str | None:
    return next((name for name in names if names.count(name) > 1), None)


_SLIDES = "a sliding joint is supported only as a rail below all turning joints: exclude it with --base or --tip"
_ENDLESS_RAD = 2 * np.pi
"""Limits of a continuous joint: a full turn in each direction, the usual range of controllers."""
_REMEDY = "choose the ends of the arm with --base and --tip"
_GRIPPER = ("gripper", "jaw", "finger", "claw")
_LISTED = 5
_DECIMALS, _MM = 9, 1000.0
_NONE = 1e-13


@dataclass(frozen=True)
class Chain:
    base: str
    tip: str
    up: tuple[UrdfJoint, ...]
    """Fixed joints from the base to the common ancestor."""
    down: tuple[UrdfJoint, ...]
    """Joints from there to the tip."""

    @property
    def rail(self) -> UrdfJoint | None:
        """The prismatic joint below all turning joints, if any."""
        first = next((joint for joint in self.down if joint.moves), None)
        return first if first is not None and first.type == "prismatic" else None

    @property
    def turning(self) -> tuple[UrdfJoint, ...]:
        """The axes of the arm."""
        return tuple(joint for joint in self.down if joint.moves and joint is not self.rail)


def chain_of(urdf: Urdf, base: str | None, tip: str | None, where: str) -> Chain:
    """Find the chain of four to seven turning joints between two links.

    base: by default the link `base`, otherwise the root. tip: by default `tool0`, otherwise the only end link. Raises
    FileError for any other chain.
    """
    above = {joint.child: joint for joint in urdf.joints}
    start, end = _ends(urdf, base, tip, above, where)
    up, down = _path(start, above, where), _path(end, above, where)
    while up and down and up[0] is down[0]:
        up, down = up[1:], down[1:]
    chain = Chain(start, end, tuple(reversed(up)), tuple(down))
    moving = [joint for joint in down if joint.moves]
    last = moving[-1] if moving else None
    if tip is None and last and any(word in f"{last.name} {last.child}".lower() for word in _GRIPPER):
        problem = f"the last joint, {last.name} to {last.child}, belongs to a gripper according to its name"
        remedy = f"choose the flange: --tip {last.parent}, or --tip {last.child} if the joint is an axis"
        raise FileError(where, problem, remedy, code="urdf.invalid")
    if loose := next((joint for joint in chain.up if joint.moves), None):
        raise FileError(where, f"joint {loose.name} moves the base {start}", _REMEDY, code="urdf.invalid")
    for joint in moving:
        _require_an_axis(joint, where, rail=joint is chain.rail)
    if not FEWEST_AXES <= (count := len(chain.turning)) <= MOST_AXES:
        problem = f"{count} turning joints from {start} to {end}; an arm needs {FEWEST_AXES} to {MOST_AXES}"
        raise FileError(where, problem, _REMEDY, code="urdf.invalid")
    return chain


def axes_and_joints(urdf: Urdf, chain: Chain) -> tuple[AxisLines, tuple[Joint, ...]]:
    """Axes of a chain in its base frame, in mm, all joints at zero, with its rail, and the joints of these axes."""
    T, rail = np.eye(4), None
    for joint in chain.up:
        T = T @ np.linalg.inv(joint.T_parent_child)
    points, directions, joints = [], [], []
    for joint in chain.down:
        T = T @ joint.T_parent_child
        if not joint.moves:
            continue
        direction = T[:3, :3] @ joint.axis / np.linalg.norm(joint.axis)
        if joint is chain.rail:
            x, y, z = (0.0 if abs(part) < _NONE else float(part) for part in direction)
            low, high = (_MM * round(end, _DECIMALS) for end in (joint.lower, joint.upper))
            rail = Rail(direction=(x, y, z), limits_mm=(low, high))
            continue
        points.append(T[:3, 3])
        directions.append(direction)
        low, high, speed = np.degrees([joint.lower, joint.upper, joint.velocity]).round(_DECIMALS).tolist()
        joints.append(Joint(joint.name, (low, high), speed, *_mass_beyond(urdf, joint, T)))
    return AxisLines(np.array(points), np.array(directions), T, rail), tuple(joints)


def _mass_beyond(urdf: Urdf, joint: UrdfJoint, T: Array) -> tuple[float, Array]:
    """Mass in kg that a joint at T carries rigidly (all links fixed to its own), and its centre (3,) mm in the base."""
    kg, moment, todo = 0.0, np.zeros(3), [(joint.child, T)]
    while todo:
        link, T_link = todo.pop()
        mass_kg, centre_mm = urdf.masses[link]
        kg += mass_kg
        moment += mass_kg * (T_link[:3, :3] @ centre_mm + T_link[:3, 3])
        fixed = (rigid for rigid in urdf.joints if rigid.parent == link and not rigid.moves)
        todo += [(rigid.child, T_link @ rigid.T_parent_child) for rigid in fixed]
    return kg, moment / (kg or 1.0)


def _ends(urdf: Urdf, base: str | None, tip: str | None, above: dict[str, UrdfJoint], where: str) -> tuple[str, str]:
    """End links of an arm: requested links, links with the usual names, or the root and the only movable end link."""
    names = list(urdf.masses)
    for name in (base, tip):
        if name is not None and name not in names:
            raise FileError(
                where, f"has no link {name}", f"its links are {first_of(names, _LISTED)}", code="urdf.invalid"
            )
    start = base or "base"
    if start not in names:
        if not names:
            raise FileError(
                where, "has no links", "give the URDF of an arm, after expanding xacro macros", code="urdf.invalid"
            )
        roots = [name for name in names if name not in above]
        if len(roots) != 1:
            problem = f"has {len(roots)} links without a parent" + (f": {first_of(roots, _LISTED)}" if roots else "")
            raise FileError(where, problem, "choose the base link of the arm with --base", code="urdf.invalid")
        start = roots[0]
    if tip or "tool0" in names:
        return start, tip or "tool0"
    parents = {joint.parent for joint in urdf.joints}
    leaves = [name for name in names if name not in parents and name != start]
    moved = [name for name in leaves if any(joint.moves for joint in _path(name, above, where))]
    if not moved:
        raise FileError(
            where,
            "has no moving joint",
            f"give the URDF of an arm of {FEWEST_AXES} to {MOST_AXES} axes",
            code="urdf.invalid",
        )
    if len(moved) > 1:
        raise FileError(
            where, f"has {len(moved)} ends: {first_of(moved, _LISTED)}", "choose one with --tip", code="urdf.invalid"
        )
    return start, moved[0]


def _require_an_axis(joint: UrdfJoint, where: str, *, rail: bool) -> None:
    place = f"joint {joint.name}"
    if joint.follows is not None:
        problem = f"{place} follows joint {joint.follows}, as in a parallelogram, which rig does not describe"
        remedy = "choose an end before that joint with --tip, if there is one"
        raise FileError(where, problem, remedy, code="urdf.invalid")
    if joint.type == "prismatic" and not rail:
        raise FileError(where, f"{place} is prismatic", _SLIDES, code="urdf.invalid")
    if np.linalg.norm(joint.axis) < 1e-6:
        remedy = "write the direction of the axis, such as 0 0 1"
        raise FileError(where, f"{place} has an axis of zero length", remedy, code="urdf.invalid")
    if not (-math.inf < joint.lower < joint.upper < math.inf and 0 < joint.velocity < math.inf):
        problem = f"{place} has lower {joint.lower:g}, upper {joint.upper:g} and velocity {joint.velocity:g}"
        remedy = "write <limit> with lower below upper, and a velocity above 0"
        raise FileError(where, problem, remedy, code="urdf.invalid")


def _path(link: str, above: dict[str, UrdfJoint], where: str) -> list[UrdfJoint]:
    path: list[UrdfJoint] = []
    while joint := above.get(link):
        if len(path) > len(above):
            raise FileError(
                where,
                f"the links above {link} form a circle",
                "correct the links: a URDF is a tree",
                code="urdf.invalid",
            )
        path.append(joint)
        link = joint.parent
    return path[::-1]


_EXACT_RAD, _SLIGHT_RAD = 1e-6, 0.02
"""Axes count as parallel or perpendicular within a micrometre per metre. Deviations up to a degree are reported."""


@dataclass(frozen=True)
class UrdfArm:
    """An arm between two links of a URDF, with remarks for the user to check."""

    section: RobotSection
    base: str
    tip: str
    doubts: tuple[str, ...]


def import_urdf(path: Path, base: str | None = None, tip: str | None = None) -> UrdfArm:
    """Read the arm between two links of a URDF. Raises FileError unless it has four to seven axes."""
    urdf = read_urdf(path)
    chain = chain_of(urdf, base, tip, str(path))
    axes, joints = axes_and_joints(urdf, chain)
    head = (
        f"From {path.name}: {chain.base} to {chain.tip}. Joints count as in the URDF, which may differ from the",
        "controller: compare zeros, signs, and J3 of a FANUC, and correct offset_deg and coupling.",
    )
    section = checked_section(urdf.name, axes, joints, head, lambda q: library_poses(urdf, chain, q), path)
    doubts, robot, pairs = list[str](), section.robot, []
    for z, z_next, *pair in zip(
        axes.directions[:-1], axes.directions[1:], chain.turning[:-1], chain.turning[1:], strict=True
    ):
        sine, cosine = float(np.linalg.norm(np.cross(z, z_next))), abs(float(z @ z_next))
        if _EXACT_RAD < (off := min(sine, cosine)) < _SLIGHT_RAD:
            kind = "parallel" if sine < cosine else "a right angle"
            pairs.append(f"{' and '.join(joint.name for joint in pair)} {np.degrees(off):.4f} degrees off {kind}")
    if pairs:
        remedy = "the angles are not changed; if the URDF is rounded (1.571 for 1.5707963267948966), correct the URDF"
        doubts.append(f"axes deviate slightly from their nominal directions: {', '.join(pairs)}; {remedy}")
    # A base or tool entered by the user would replace the part in between.
    if robot.base != Pose():
        doubts.append(
            "axis 1 does not pass through the origin of the base: the transform between them is in base; include "
            "that transform in your own base"
        )
    if robot.tool != Pose():
        doubts.append(
            f"the tip is not on axis {len(robot.axes)}: the transform between them is in tool; include "
            "that transform in your own tool, or choose a different --tip"
        )
    within = {joint.name for joint in chain.down}
    if others := [joint.name for joint in urdf.joints if joint.moves and joint.name not in within]:
        doubts.append(f"further moving joints are ignored, with the masses on them: {first_of(others, _LISTED)}")
    if endless := [joint.name for joint in chain.turning if joint.type == "continuous"]:
        limits = "limits_deg are set to a turn in each direction; correct them if the controller's limits differ"
        doubts.append(f"joints without limits: {first_of(endless, _LISTED)}; {limits}")
    return UrdfArm(section, chain.base, chain.tip, tuple(doubts))


def library_poses(urdf: Urdf, chain: Chain, q: Array) -> Array:
    """Poses (n, 4, 4) mm of the tip in the base frame, read and computed by pytransform3d.

    q (n, axes): joint angles in rad, followed by the rail position in m, if any. Raises CellError if the library is
    missing.
    """
    try:
        from pytransform3d.urdf import UrdfTransformManager, parse_urdf  # noqa: PLC0415 - an extra of the package
    except ModuleNotFoundError as error:
        problem = f"needs the Python package {error.name}, which is missing"
        raise CellError("import-urdf", problem, to_install("pytransform3d"), code="package.missing") from None
    # Its check of each product of rotations, in every pose, takes most of the time.
    frames: Any = UrdfTransformManager(check=False)
    sliding = chain.rail.name if chain.rail else None
    for joint in parse_urdf(urdf.kinematics)[2]:
        kind = "prismatic" if joint.joint_name == sliding else "fixed" if joint.joint_type == "fixed" else "revolute"
        ends = joint.joint_name, joint.child, joint.parent
        frames.add_joint(*ends, joint.child2parent, joint.joint_axis, joint_type=kind)
    poses = []
    for values in q.tolist():
        for name, value in zip([*(joint.name for joint in chain.turning), sliding], values, strict=False):
            frames.set_joint(name, value)
        poses.append(frames.get_transform(chain.tip, chain.base))
    in_mm = np.array(poses, dtype=float)
    in_mm[:, :3, 3] *= _MM
    return in_mm
