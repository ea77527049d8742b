"""A URDF file as links and joints: bounded, without entities or macros, read by yourdfpy.

Shapes are left out before that library sees the file: the geometry of an arm needs none of its meshes.
"""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any, NoReturn

from rigs.errors import CellError, FileError
from rigs.files import read_bytes

_MOST_BYTES = 10_000_000
"""The URDF of a humanoid has half a megabyte; meshes are files of their own."""
_MOST_PARTS = 2000
"""Links and joints; a humanoid with both hands has some hundred."""
_XACRO = "expand the macros first: xacro FILE > arm.urdf"
_REMEDY = "give a URDF file, as xacro writes it"
_UNREADABLE = (AttributeError, IndexError, KeyError, TypeError, ValueError, ArithmeticError, RuntimeWarning)
"""What yourdfpy raises where a part lacks a name, has a word for a number, or an angle without end."""
_LARGEST = 1e6
"""No arm has so many metres, radians or kilograms."""


def yourdfpy_module() -> Any:
    """Return the library, which is an extra of the package. Raises CellError where it is missing."""
    try:
        import yourdfpy  # noqa: PLC0415 - an extra, and a second to load
    except ModuleNotFoundError as error:
        raise CellError("import-urdf", f"needs {error.name}, which is missing", "pip install yourdfpy") from None
    return yourdfpy


def read_urdf(path: Path) -> Any:
    """Return the yourdfpy.Robot of a file, its shapes left out. Raises FileError."""
    yourdfpy = yourdfpy_module()
    where = str(path)
    data = _without_shapes(_text(path), where)
    try:
        robot = yourdfpy.URDF.load(io.BytesIO(data), build_scene_graph=False, load_meshes=False).robot
    except _UNREADABLE as error:
        what = "a link or joint lacks its name, parent or child, or has a word for a number"
        raise FileError(where, f"not readable as URDF ({error}): {what}", _REMEDY) from None
    _require_names(robot, where)
    for joint in robot.joints:
        _require_numbers(joint, where)
    for link in robot.links:
        _require_mass(link, where)
    return robot


def _text(path: Path) -> str:
    try:
        data = read_bytes(path, _MOST_BYTES)
    except OSError as error:
        raise FileError(str(path), error.strerror or str(error), _REMEDY) from None
    try:
        text = data.decode()
    except UnicodeDecodeError:
        raise FileError(str(path), "is no UTF-8 text", _REMEDY) from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # a few lines of entities of entities make gigabytes
        raise FileError(str(path), "declares a document type or entities, which no URDF needs", "remove <!DOCTYPE …>")
    return text


def _without_shapes(text: str, where: str) -> bytes:
    """The links' inertials and the joints of a URDF, as XML again."""
    from lxml import etree  # noqa: PLC0415 - comes with yourdfpy

    parser = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(text.encode(), parser)
    except etree.XMLSyntaxError as error:
        raise FileError(where, f"not XML: {error.msg}", _REMEDY) from None
    if root.tag != "robot":
        raise FileError(where, f"is no URDF: it is a <{root.tag}>, not a <robot>", _REMEDY)
    if any("xacro" in str(part.tag) for part in root.iter()):
        raise FileError(where, "is xacro, not URDF", _XACRO)
    for part in list(root):
        if part.tag not in ("link", "joint"):
            root.remove(part)
    if len(root) > _MOST_PARTS:
        raise FileError(where, f"has {len(root)} links and joints, more than {_MOST_PARTS}", "give that of one arm")
    for part in root.findall("link/*"):
        if part.tag != "inertial":
            part.getparent().remove(part)
    if any("${" in value or "$(" in value for part in root.iter() for value in part.attrib.values()):
        raise FileError(where, "is xacro, not URDF: it has ${…} for numbers", _XACRO)
    return bytes(etree.tostring(root, encoding="utf-8"))


def _require_names(robot: Any, where: str) -> None:
    links, joints = [link.name for link in robot.links], [joint.name for joint in robot.joints]
    for kind, names in (("link", links), ("joint", joints)):
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise FileError(where, f"has two {kind}s named {twice}", "rename one of them")
    for joint in robot.joints:
        for end, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                raise FileError(where, f"joint {joint.name} has the {end} {name}, which is no link", "correct its name")
    children = [joint.child for joint in robot.joints]
    if twice := next((name for name in children if children.count(name) > 1), None):
        raise FileError(where, f"link {twice} is the child of two joints", "remove one of them: a URDF is a tree")


def _require_numbers(joint: Any, where: str) -> None:
    limit = joint.limit
    numbers = [*joint.axis, *([] if joint.origin is None else joint.origin.flat)]
    numbers += [] if limit is None else [one for one in (limit.lower, limit.upper, limit.velocity) if one is not None]
    if len(joint.axis) != 3 or not all(map(_is_possible, numbers)):
        _impossible(f"joint {joint.name}", where)


def _require_mass(link: Any, where: str) -> None:
    inertial = link.inertial
    if inertial is None or inertial.mass is None:
        return
    origin = [] if inertial.origin is None else inertial.origin.flat
    if not all(map(_is_possible, [inertial.mass, *origin])) or inertial.mass < 0:
        _impossible(f"the mass of link {link.name}", where)


def _is_possible(number: float) -> bool:
    return math.isfinite(number) and abs(number) < _LARGEST


def _impossible(place: str, where: str) -> NoReturn:
    raise FileError(where, f"{place} has numbers that no arm has", "write metres, radians and kg; an axis has three")
