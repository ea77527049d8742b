"""A URDF file as joints and masses in mm: bounded, without entities or macros, its frames computed by pytransform3d.

That library reads a part of a word for a number and knows no speeds, so the numbers are checked before it sees them.
Shapes are left out: the geometry of an arm needs none of its meshes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.kinematics.arm import Array
from rigs.distribution import to_install
from rigs.errors import CellError, FileError
from rigs.files import read_text

if TYPE_CHECKING:
    from pytransform3d.urdf import Joint as LibraryJoint

_MOST_BYTES = 10_000_000
"""The URDF of a humanoid has half a megabyte; meshes are files of their own."""
_MOST_PARTS = 2000
"""Links and joints; a humanoid with both hands has some hundred."""
_MOST_ATTRIBUTES = 10_000
"""Signs of equality in one element, or comment, of a file: an element has some three, and the time that the library for
XML takes for attributes grows with their square, 90 s for 200,000."""
_LARGEST = 1e6
"""No arm has so many metres, radians or kilograms."""
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
"""How many numbers the attributes have that are used."""
_REMEDY = "give a URDF file, as xacro writes it"
_XACRO = "expand the macros first: xacro FILE > arm.urdf"


@dataclass(frozen=True)
class UrdfJoint:
    """A joint. T_parent_child (4, 4): its frame at zero, lengths in mm; axis (3,) in that frame, of any length;
    lower, upper (rad) and velocity (rad/s): infinite where the file has none; follows: the joint that it mimics."""

    name: str
    type: str
    parent: str
    child: str
    T_parent_child: Array
    axis: Array
    lower: float
    upper: float
    velocity: float
    follows: str | None

    @property
    def moves(self) -> bool:
        return self.type != "fixed"


@dataclass(frozen=True)
class Mass:
    """Mass of a link in kg, and its centre (3,) mm in the link's frame."""

    kg: float
    centre_mm: Array


@dataclass(frozen=True)
class Urdf:
    """A file: a forest of links, whose masses are by their names, and joints."""

    name: str
    masses: dict[str, Mass]
    joints: tuple[UrdfJoint, ...]


def read_urdf(path: Path) -> Urdf:
    """Return the links and joints of a file. Raises FileError, or CellError where the library is missing."""
    try:
        from pytransform3d.urdf import UrdfException, parse_urdf  # noqa: PLC0415 - an extra of the package
    except ModuleNotFoundError as error:
        problem = f"needs {error.name}, which is missing"
        raise CellError("import-urdf", problem, to_install("pytransform3d")) from None
    from lxml import etree  # noqa: PLC0415 - comes with it

    where = str(path)
    root = _root(path)
    for part in root:
        _require_numbers(part, where)
    for joint in root.findall("joint"):
        if (kind := joint.get("type")) not in _TYPES:
            problem = f"joint {joint.get('name')} " + (f"is {kind}" if kind else "has no type")
            raise FileError(where, problem, "write type revolute, or remove the joint")
    try:
        name, links, joints = parse_urdf(etree.tostring(root, encoding="unicode"))
    except UrdfException as error:
        raise FileError(where, f"not readable as URDF: {str(error).rstrip('.')}", "correct it") from None
    for kind, names in (("link", [link.name for link in links]), ("joint", [joint.joint_name for joint in joints])):
        if twice := _twice(names):
            raise FileError(where, f"has two {kind}s named {twice}", "rename one of them")
    if twice := _twice([joint.child for joint in joints]):
        raise FileError(where, f"link {twice} is the child of two joints", "remove one of them: a URDF is a tree")
    masses = {str(link.name): Mass(link.mass, _in_mm(link.inertial_frame)[:3, 3]) for link in links}
    return Urdf(name, masses, tuple(map(_joint, joints, root.findall("joint"))))


def _root(path: Path) -> Any:
    """The <robot> of a URDF, bounded, without macros and shapes."""
    from lxml import etree  # noqa: PLC0415

    where = str(path)
    try:
        text = read_text(path, _MOST_BYTES)
    except OSError as error:
        raise FileError(where, error.strerror or str(error), _REMEDY) from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # a few lines of entities of entities make gigabytes
        raise FileError(where, "declares a document type or entities, which no URDF needs", "remove <!DOCTYPE …>")
    if max(part.count("=") for part in text.split("<")) > _MOST_ATTRIBUTES:
        raise FileError(where, f"has an element of more than {_MOST_ATTRIBUTES} attributes", _REMEDY)
    parser = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise FileError(where, f"not XML: {error.msg}", _REMEDY) from None
    if root.tag != "robot":
        raise FileError(where, f"is not a URDF: it is a <{root.tag}>, not a <robot>", _REMEDY)
    if any("xacro" in str(part.tag) for part in root.iter()):
        raise FileError(where, "is xacro, not URDF", _XACRO)
    if (count := len(root.findall("link")) + len(root.findall("joint"))) > _MOST_PARTS:
        raise FileError(where, f"has {count} links and joints, more than {_MOST_PARTS}", "give that of one arm")
    # All is left out that is not a link with its mass, or a joint.
    for parent, kept in ((root, ("link", "joint")), *((link, ("inertial",)) for link in root.findall("link"))):
        for part in list(parent):
            if part.tag not in kept:
                parent.remove(part)
    for inertial in root.findall("link/inertial"):
        for inertia in inertial.findall("inertia"):
            inertial.remove(inertia)
    return root


def _require_numbers(part: Any, where: str) -> None:
    """Refuse a link or joint with a number that no arm has; write each as the library reads it."""
    for element in part.iter():
        for key, words in element.attrib.items():
            if "${" in words or "$(" in words:
                raise FileError(where, "is xacro, not URDF: it has ${…} for numbers", _XACRO)
            if not (count := _NUMBERS.get((element.tag, key))):
                continue
            try:
                numbers = [float(word) for word in words.split()]
            except ValueError:
                numbers = []
            possible = len(numbers) == count and all(abs(number) < _LARGEST for number in numbers)
            if not possible or (element.tag == "mass" and numbers[0] < 0):
                fact = f"{part.tag} {part.get('name')} has {element.tag} {key}={words!r}"
                raise FileError(where, fact, f"write {'three numbers' if count == 3 else 'a number'} that an arm has")
            element.set(key, " ".join(map(repr, numbers)))


def _twice(names: Sequence[str | None]) -> str | None:
    return next((name for name in names if names.count(name) > 1), None)


def _joint(joint: LibraryJoint, element: Any) -> UrdfJoint:
    """A joint of the library, with what it does not read from the element."""
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
    """A frame (4, 4) with its place in mm instead of metres."""
    T = T.copy()
    T[:3, 3] *= 1000.0
    return T
