"""An arm as a macro of xacro, by which another description includes it under a prefix and on a parent of its own.

The macro is the URDF of `urdf_text` without its world: an empty description that includes and calls it has the same
joints as that URDF.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import product
from xml.etree import ElementTree

from analysis.arms.urdf_text import urdf_text, xml_text
from analysis.kinematics.arm import Arm
from rigs.errors import FileError
from rigs.schema.robot import Robot

_XACRO = "http://www.ros.org/wiki/xacro"
_EXPANDS = re.compile(r"\$+[{(]")
"""What xacro takes for an expression to be computed."""


def macro_name(robot: Robot) -> str:
    """Return the name of the macro: the robot's, with what xacro knows as a name."""
    letters = re.sub(r"\W+", "_", robot.name.casefold(), flags=re.ASCII).strip("_")
    return letters if letters and not letters[0].isdigit() else f"arm_{letters}".rstrip("_")


def xacro_text(robot: Robot, arm: Arm, where: str, remarks: Sequence[str] = ()) -> str:
    """Return a file of xacro with a macro of an arm, with parameters prefix (of all names) and parent (a link).

    where: the rig file, for errors. Raises FileError as `urdf_text` does, and for names that xacro would compute.
    """
    for name in (robot.name, *(axis.name for axis in robot.axes)):
        if _EXPANDS.search(name):
            raise FileError(f"{where}, robot", f"xacro would compute the name {name!r}", "take the $ from it")
    ElementTree.register_namespace("xacro", _XACRO)
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))  # noqa: S314 - it is ours
    urdf = ElementTree.fromstring(urdf_text(robot, arm, where, remarks).encode(), parser)  # noqa: S314
    root = ElementTree.Element("robot")
    name = macro_name(robot)
    root.append(ElementTree.Comment(f' include this file, then: <xacro:{name} prefix="left_" parent="table"/> '))
    macro = ElementTree.SubElement(root, f"{{{_XACRO}}}macro", name=name, params="prefix:='' parent:=world")
    for part in urdf:
        if part.get("name") == "world" and part.tag == "link":
            continue
        # The prefix before the names of links and joints, and the parent in the place of the world.
        for element, key in product(part.iter(), ("name", "link")):
            if called := element.get(key):
                element.set(key, "${parent}" if called == "world" else "${prefix}" + called)
        (root if callable(part.tag) else macro).append(part)
    return xml_text(root)
