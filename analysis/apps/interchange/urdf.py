"""Import of a URDF as the `robot:` section of a rig file, verified against an independent library.

The file is read as joints and masses in mm, with a size limit and no entities or macros. Frames are computed by
pytransform3d. That library accepts partial numbers and ignores speeds, so numbers are checked first. Shapes are
dropped, because the kinematics need no meshes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.robot.description.axis_lines import AxisLines
from analysis.robot.description.rig_section import Joint, RobotSection, checked_section
from analysis.robot.kinematics.arm import RAIL_MM, Array
from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from rigs.files import read_text
from rigs.schema.robot import Pose, Rail
from rigs.schema.vocabulary import FEWEST_AXES, MOST_AXES
from rigs.text import first_of

if TYPE_CHECKING:
    from pytransform3d.urdf import Joint as LibraryJoint


_MOST_BYTES = 10_000_000
"""Size limit; the URDF of a humanoid has half a megabyte, and meshes are separate files."""
_MOST_PARTS = 2000
"""Limit of links and joints; a humanoid with both hands has about a hundred."""
_MOST_ATTRIBUTES = 10_000
"""Limit of equals signs in an element or comment. An element has about three, and the XML library needs quadratic
time for attributes: 90 s for 200,000."""
_LARGEST = 1e6
"""Limit in metres, radians or kilograms."""
_TYPES = ("revolute", "continuous", "prismatic", "fixed")
_NUMBERS = {
    ("origin", "xyz"): 3,
    ("origin", "rpy"): 3,
    ("axis", "xyz"): 3,
    ("limit", "lower"): 1,
    ("limit", "upper"): 1,
    ("limit", "velocity"): 1,
    ("mass", "value"): 1,
}
"""Number of values in the attributes used."""
_GIVE_URDF = "give a URDF file, such as the output of xacro"
_XACRO = "expand the macros first: xacro FILE > arm.urdf"


@dataclass(frozen=True)
class UrdfJoint:
    """A joint; infinite limits are absent."""

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
class Mass:
    """The mass of a link in kg, and the centre (3,) mm in the frame of the link."""

    kg: float
    centre_mm: Array


@dataclass(frozen=True)
class Urdf:
    """Content of a file: joints, and a forest of links with masses by name."""

    name: str
    masses: dict[str, Mass]
    joints: tuple[UrdfJoint, ...]


def read_urdf(path: Path) -> Urdf:
    """Read the links and joints of a file. Raises FileError, and CellError if the library is missing."""
    try:
        from pytransform3d.urdf import UrdfException, parse_urdf  # noqa: PLC0415 - an extra of the package
    except ModuleNotFoundError as error:
        problem = f"needs the Python package {error.name}, which is missing"
        raise CellError("import-urdf", problem, to_install("pytransform3d"), code="package.missing") from None
    from lxml import etree  # noqa: PLC0415 - comes with it

    where = str(path)
    root = _xml_root(path)
    for part in root:
        _require_numbers(part, where)
    for joint in root.findall("joint"):
        if (kind := joint.get("type")) not in _TYPES:
            problem = f"joint {joint.get('name')} " + (f"is {kind}" if kind else "has no type")
            raise FileError(where, problem, "write type revolute, or remove the joint", code="urdf.not_urdf")
    try:
        name, links, joints = parse_urdf(etree.tostring(root, encoding="unicode"))
    except UrdfException as error:
        raise FileError(
            where, f"not readable as URDF: {str(error).rstrip('.')}", "correct it", code="urdf.not_urdf"
        ) from None
    for kind, names in (("link", [link.name for link in links]), ("joint", [joint.joint_name for joint in joints])):
        if twice := _twice(names):
            raise FileError(where, f"has two {kind}s named {twice}", "rename one of them", code="urdf.twice")
    if twice := _twice([joint.child for joint in joints]):
        raise FileError(
            where, f"link {twice} is the child of two joints", "remove one of them: a URDF is a tree", code="urdf.tree"
        )
    masses = {str(link.name): Mass(link.mass, _in_mm(link.inertial_frame)[:3, 3]) for link in links}
    return Urdf(name, masses, tuple(map(_joint, joints, root.findall("joint"))))


def _xml_root(path: Path) -> Any:
    """The <robot> element after checks of size and macros, with shapes removed."""
    from lxml import etree  # noqa: PLC0415

    where = str(path)
    try:
        text = read_text(path, _MOST_BYTES)
    except OSError as error:
        raise FileError(where, error.strerror or str(error), _GIVE_URDF, code="file.unreadable") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # A few lines of nested entities expand to gigabytes.
        raise FileError(
            where,
            "declares a document type or entities, which are not allowed in a URDF",
            "remove <!DOCTYPE …>",
            code="urdf.entities",
        )
    if max(part.count("=") for part in text.split("<")) > _MOST_ATTRIBUTES:
        raise FileError(
            where, f"has an element of more than {_MOST_ATTRIBUTES} attributes", _GIVE_URDF, code="urdf.too_large"
        )
    parser = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise FileError(where, f"not XML: {error.msg}", _GIVE_URDF, code="urdf.not_urdf") from None
    if root.tag != "robot":
        raise FileError(
            where, f"is not a URDF: the root element is <{root.tag}>, not <robot>", _GIVE_URDF, code="urdf.not_urdf"
        )
    if any("xacro" in str(part.tag) for part in root.iter()):
        raise FileError(where, "is xacro, not URDF", _XACRO, code="urdf.xacro")
    if (count := len(root.findall("link")) + len(root.findall("joint"))) > _MOST_PARTS:
        raise FileError(
            where,
            f"has {count} links and joints, more than {_MOST_PARTS}",
            "give the URDF of a single arm",
            code="urdf.too_large",
        )
    # Drop everything except joints, and links with masses.
    for parent, kept in ((root, ("link", "joint")), *((link, ("inertial",)) for link in root.findall("link"))):
        for part in list(parent):
            if part.tag not in kept:
                parent.remove(part)
    for inertial in root.findall("link/inertial"):
        for inertia in inertial.findall("inertia"):
            inertial.remove(inertia)
    return root


def _require_numbers(part: Any, where: str) -> None:
    """Refuse a link or joint with an impossible number; normalise numbers for the library."""
    for element in part.iter():
        for key, words in element.attrib.items():
            if "${" in words or "$(" in words:
                raise FileError(where, "is xacro, not URDF: numbers are given as ${…}", _XACRO, code="urdf.xacro")
            if not (count := _NUMBERS.get((element.tag, key))):
                continue
            try:
                numbers = [float(word) for word in words.split()]
            except ValueError:
                numbers = []
            possible = len(numbers) == count and all(abs(number) < _LARGEST for number in numbers)
            if not possible or (element.tag == "mass" and numbers[0] < 0):
                fact = f"{part.tag} {part.get('name')} has {element.tag} {key}={words!r}"
                raise FileError(
                    where,
                    fact,
                    f"write {'three numbers' if count == 3 else 'a number'} in the range of a robot arm",
                    code="urdf.value",
                )
            element.set(key, " ".join(map(repr, numbers)))


def _twice(names: Sequence[str | None]) -> str | None:
    return next((name for name in names if names.count(name) > 1), None)


def _joint(joint: LibraryJoint, element: Any) -> UrdfJoint:
    """Convert a joint of the library, and add attributes ignored by it."""
    limit, mimic = element.find("limit"), element.find("mimic")
    return UrdfJoint(
        name=str(joint.joint_name),
        type=joint.joint_type,
        parent=str(joint.parent),
        child=str(joint.child),
        T_parent_child=_in_mm(joint.child2parent),
        axis=np.asarray(joint.joint_axis, dtype=float),
        lower=joint.limits[0],
        upper=joint.limits[1],
        velocity=math.inf if limit is None else float(limit.get("velocity", math.inf)),
        follows=None if mimic is None else mimic.get("joint", ""),
    )


def _in_mm(T: Array) -> Array:
    T = T.copy()
    T[:3, 3] *= 1000.0
    return T


_SLIDES = "a sliding joint is supported only as a rail below all turning joints: exclude it with --base or --tip"
_ENDLESS_RAD = 2 * np.pi
"""Limits of a continuous joint: a full turn in each direction, the usual range of controllers."""
_REMEDY = "choose the ends of the arm with --base and --tip"
_GRIPPER = ("gripper", "jaw", "finger", "claw")
"""Words in the names of gripper joints and links, as in SO-100, SO-101, WidowX and Robotiq."""
_LISTED = 5
_DECIMALS, _MM = 9, 1000.0
"""Decimals of metres."""
_NONE = 1e-13
"""Smaller components of a direction are rounded to zero."""


@dataclass(frozen=True)
class Chain:
    """The joints between two links of a URDF."""

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
        return tuple(joint for joint in self.down if self.turns(joint))

    def turns(self, joint: UrdfJoint) -> bool:
        """True for an axis of the arm."""
        return joint.moves and joint is not self.rail


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
        raise FileError(where, problem, remedy, code="urdf.gripper")
    if loose := next((joint for joint in chain.up if joint.moves), None):
        raise FileError(where, f"joint {loose.name} moves the base {start}", _REMEDY, code="urdf.base_moves")
    for joint in moving:
        _require_an_axis(joint, where, rail=joint is chain.rail)
    if not FEWEST_AXES <= (count := len(chain.turning)) <= MOST_AXES:
        problem = f"{count} turning joints from {start} to {end}; an arm needs {FEWEST_AXES} to {MOST_AXES}"
        raise FileError(where, problem, _REMEDY, code="urdf.axes")
    return chain


def axes_of(chain: Chain) -> AxisLines:
    """Axes of a chain in its base frame, in mm, all joints at zero, and its rail."""
    T, rail = _T_base_parting(chain), None
    points, directions = [], []
    for joint in chain.down:
        T = T @ joint.T_parent_child
        if not joint.moves:
            continue
        direction = T[:3, :3] @ joint.axis / np.linalg.norm(joint.axis)
        if joint is chain.rail:
            x, y, z = (0.0 if abs(part) < _NONE else float(part) for part in direction)
            low, high = (_MM * round(end, _DECIMALS) for end in (joint.lower, joint.upper))
            rail = Rail(direction=(x, y, z), limits_mm=(low, high))
        else:
            points.append(T[:3, 3])
            directions.append(direction)
    return AxisLines(np.array(points), np.array(directions), T, rail)


def joints_of(urdf: Urdf, chain: Chain) -> tuple[Joint, ...]:
    """Limits, speed, and the mass of all links fixed to the joint's link."""
    T = _T_base_parting(chain)
    joints = []
    for joint in chain.down:
        T = T @ joint.T_parent_child
        if not chain.turns(joint):
            continue
        # Mass and moment of the link and all links fixed to it, in the base frame
        kg, moment, todo = 0.0, np.zeros(3), [(joint.child, T)]
        while todo:
            link, T_link = todo.pop()
            part = urdf.masses[link]
            kg += part.kg
            moment += part.kg * (T_link[:3, :3] @ part.centre_mm + T_link[:3, 3])
            fixed = (rigid for rigid in urdf.joints if rigid.parent == link and not rigid.moves)
            todo += [(rigid.child, T_link @ rigid.T_parent_child) for rigid in fixed]
        limits = [-_ENDLESS_RAD, _ENDLESS_RAD] if joint.type == "continuous" else [joint.lower, joint.upper]
        low, high = np.degrees(limits).round(9).tolist()
        speed = round(float(np.degrees(joint.velocity)), 9)
        joints.append(Joint(joint.name, (low, high), speed, kg, moment / (kg or 1.0)))
    return tuple(joints)


def _ends(urdf: Urdf, base: str | None, tip: str | None, above: dict[str, UrdfJoint], where: str) -> tuple[str, str]:
    """End links of an arm: requested links, links with the usual names, or the root and the only movable end link."""
    names = list(urdf.masses)
    for name in (base, tip):
        if name is not None and name not in names:
            raise FileError(
                where, f"has no link {name}", f"its links are {first_of(names, _LISTED)}", code="urdf.link_missing"
            )
    start = base or "base"
    if start not in names:
        if not names:
            raise FileError(
                where, "has no links", "give the URDF of an arm, after expanding xacro macros", code="urdf.no_links"
            )
        roots = [name for name in names if name not in above]
        if len(roots) != 1:
            problem = f"has {len(roots)} links without a parent" + (f": {first_of(roots, _LISTED)}" if roots else "")
            raise FileError(where, problem, "choose the base link of the arm with --base", code="urdf.ambiguous")
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
            code="urdf.no_joints",
        )
    if len(moved) > 1:
        raise FileError(
            where, f"has {len(moved)} ends: {first_of(moved, _LISTED)}", "choose one with --tip", code="urdf.tree"
        )
    return start, moved[0]


def _require_an_axis(joint: UrdfJoint, where: str, *, rail: bool) -> None:
    place = f"joint {joint.name}"
    if joint.follows is not None:
        problem = (
            f"{place} follows joint {joint.follows}, as in a parallelogram; rig describes arms whose joints all move"
        )
        raise FileError(
            where,
            f"{problem} by themselves",
            "choose an end before that joint with --tip, if there is one",
            code="urdf.parallel",
        )
    if joint.type == "prismatic" and not rail:
        raise FileError(where, f"{place} is prismatic", _SLIDES, code="urdf.prismatic")
    if np.linalg.norm(joint.axis) < 1e-6:
        raise FileError(
            where,
            f"{place} has an axis of zero length",
            "write the direction of the axis, such as 0 0 1",
            code="urdf.value",
        )
    endless = joint.type == "continuous"
    if not np.isfinite([joint.velocity, *(() if endless else (joint.lower, joint.upper))]).all():
        raise FileError(
            where, f"{place} has no limits", "write <limit> with lower, upper and velocity", code="urdf.no_limits"
        )
    if (not endless and joint.lower >= joint.upper) or joint.velocity <= 0:
        problem = f"{place} has lower {joint.lower:g}, upper {joint.upper:g} and velocity {joint.velocity:g}"
        raise FileError(
            where, problem, "write the limits in ascending order, and a velocity above 0", code="urdf.value"
        )


def _path(link: str, above: dict[str, UrdfJoint], where: str) -> list[UrdfJoint]:
    """Joints from the root to a link."""
    path: list[UrdfJoint] = []
    while joint := above.get(link):
        if len(path) > len(above):
            raise FileError(
                where, f"the links above {link} form a circle", "correct the links: a URDF is a tree", code="urdf.tree"
            )
        path.append(joint)
        link = joint.parent
    return path[::-1]


def _T_base_parting(chain: Chain) -> Array:  # noqa: N802 - a frame's name
    """Frame (4, 4) mm of the common ancestor of base and tip, in the base frame."""
    T = np.eye(4)
    for joint in chain.up:
        T = T @ np.linalg.inv(joint.T_parent_child)
    return T


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
    axes = axes_of(chain)
    head = (
        f"From {path.name}: {chain.base} to {chain.tip}. Joints count as in the URDF, which may differ from the",
        "controller: compare zeros, signs, and J3 of a FANUC, and correct offset_deg and coupling.",
    )
    section = checked_section(urdf.name, axes, joints_of(urdf, chain), head, lambda q: library_poses(chain, q), path)
    doubts, robot, pairs = list[str](), section.robot, []
    for z, z_next, *joints in zip(
        axes.directions[:-1], axes.directions[1:], chain.turning[:-1], chain.turning[1:], strict=True
    ):
        sine, cosine = float(np.linalg.norm(np.cross(z, z_next))), abs(float(z @ z_next))
        if _EXACT_RAD < (off := min(sine, cosine)) < _SLIGHT_RAD:
            kind = "parallel" if sine < cosine else "a right angle"
            pairs.append(f"{' and '.join(joint.name for joint in joints)} {np.degrees(off):.4f} degrees off {kind}")
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


def library_poses(chain: Chain, q: Array) -> Array:
    """Poses (n, 4, 4) mm of the tip in the base frame, computed by pytransform3d.

    q (n, axes): joint angles in rad, followed by the rail position in m, if any.
    """
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
