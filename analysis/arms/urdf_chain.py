"""The arm between two links of a URDF: its turning joints, their axes, limits and masses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.arms.axis_lines import AxisLines
from analysis.arms.robot_section import Joint
from analysis.arms.urdf_file import Urdf, UrdfJoint
from analysis.kinematics.arm import Array
from rigs.errors import FileError
from rigs.schema.robot import Rail
from rigs.schema.vocabulary import FEWEST_AXES, MOST_AXES

_SLIDES = "only a rail below all turning joints can slide: leave it out, with --base or --tip"
_ENDLESS_RAD = 2 * np.pi
"""Limits of a joint that turns without end: a turn to either side, as most controllers that show such a joint count."""
_REMEDY = "choose the ends of the arm with --base and --tip"
_GRIPPER = ("gripper", "jaw", "finger", "claw")
"""What joints and links of a gripper are called; SO-100, SO-101, WidowX and Robotiq's are."""
_LISTED = 5
_DECIMALS, _MM = 9, 1000.0
"""Decimals of metres as written."""
_NONE = 1e-13
"""A part of a direction below this is the rounding of zero."""


@dataclass(frozen=True)
class Chain:
    """Joints from one link of a URDF to another: up, from the base to where the ways part, which are fixed, and down
    from there to the tip."""

    base: str
    tip: str
    up: tuple[UrdfJoint, ...]
    down: tuple[UrdfJoint, ...]

    @property
    def rail(self) -> UrdfJoint | None:
        """The joint that slides below all that turn."""
        first = next((joint for joint in self.down if joint.moves), None)
        return first if first is not None and first.type == "prismatic" else None

    @property
    def turning(self) -> tuple[UrdfJoint, ...]:
        """The joints that are neither fixed nor the rail, from the base."""
        return tuple(joint for joint in self.down if self.turns(joint))

    def turns(self, joint: UrdfJoint) -> bool:
        """Whether a joint is an axis of the arm."""
        return joint.moves and joint is not self.rail


def chain_of(urdf: Urdf, base: str | None, tip: str | None, where: str) -> Chain:
    """Return the chain of four to seven turning joints between two links.

    base: default is the link `base`, or else the root; tip: default is `tool0`, or else the only link at an end.
    Raises FileError for any other chain.
    """
    names = list(urdf.masses)
    for name in (base, tip):
        if name is not None and name not in names:
            raise FileError(where, f"has no link {name}", f"its links are {listed(names)}")
    above = {joint.child: joint for joint in urdf.joints}
    start = base or ("base" if "base" in names else _root(names, above, where))
    end = tip or ("tool0" if "tool0" in names else _only_end(urdf, start, above, where))
    up, down = _path(start, above, where), _path(end, above, where)
    while up and down and up[0] is down[0]:
        up, down = up[1:], down[1:]
    chain = Chain(start, end, tuple(reversed(up)), tuple(down))
    moving = [joint for joint in down if joint.moves]
    last = moving[-1] if moving else None
    if tip is None and last and any(word in f"{last.name} {last.child}".lower() for word in _GRIPPER):
        problem = f"its last joint, {last.name} to {last.child}, moves a gripper by its name"
        remedy = f"choose the flange: --tip {last.parent}, or --tip {last.child} if it is an axis"
        raise FileError(where, problem, remedy)
    if loose := next((joint for joint in chain.up if joint.moves), None):
        raise FileError(where, f"joint {loose.name} moves the base {start} itself", _REMEDY)
    for joint in moving:
        _require_an_axis(joint, where, rail=joint is chain.rail)
    if not FEWEST_AXES <= (count := len(chain.turning)) <= MOST_AXES:
        problem = f"{count} turning joints from {start} to {end}, where an arm has {FEWEST_AXES} to {MOST_AXES}"
        raise FileError(where, problem, _REMEDY)
    return chain


def axes_of(chain: Chain) -> AxisLines:
    """Return the axes of a chain in its base frame, in mm, all joints at zero, and its rail."""
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
    """Return what the URDF says of each joint: limits, speed, and the mass of all links that are fixed behind it."""
    T = _T_base_parting(chain)
    joints = []
    for joint in chain.down:
        T = T @ joint.T_parent_child
        if not chain.turns(joint):
            continue
        mass, centre = _mass(urdf, joint.child, T)
        limits = [-_ENDLESS_RAD, _ENDLESS_RAD] if joint.type == "continuous" else [joint.lower, joint.upper]
        low, high = np.degrees(limits).round(9).tolist()
        speed = round(float(np.degrees(joint.velocity)), 9)
        joints.append(Joint(joint.name, (low, high), speed, mass, centre))
    return tuple(joints)


def others_of(urdf: Urdf, chain: Chain) -> tuple[str, ...]:
    """Return the names of joints that move and are not of the chain."""
    within = {joint.name for joint in chain.down}
    return tuple(joint.name for joint in urdf.joints if joint.moves and joint.name not in within)


def _require_an_axis(joint: UrdfJoint, where: str, *, rail: bool) -> None:
    """One joint as a rig file can have it, or the rail."""
    place = f"joint {joint.name}"
    if joint.follows is not None:
        raise FileError(where, f"{place} follows joint {joint.follows}", "write it as a joint of its own")
    if joint.type == "prismatic" and not rail:
        raise FileError(where, f"{place} is prismatic", _SLIDES)
    if np.linalg.norm(joint.axis) < 1e-6:
        raise FileError(where, f"{place} has an axis of no length", "write its direction, as 0 0 1")
    endless = joint.type == "continuous"
    if not np.isfinite([joint.velocity, *(() if endless else (joint.lower, joint.upper))]).all():
        raise FileError(where, f"{place} has no limits", "write <limit> with lower, upper and velocity")
    if (not endless and joint.lower >= joint.upper) or joint.velocity <= 0:
        problem = f"{place} has lower {joint.lower:g}, upper {joint.upper:g} and velocity {joint.velocity:g}"
        raise FileError(where, problem, "write the limits in order, and a velocity above 0")


def _root(names: Sequence[str], above: dict[str, UrdfJoint], where: str) -> str:
    if not names:
        raise FileError(where, "has no links", "give the URDF of an arm, with its xacro macros expanded")
    roots = [name for name in names if name not in above]
    if len(roots) != 1:
        problem = f"has {len(roots)} links that hang on no other" + (f": {listed(roots)}" if roots else "")
        raise FileError(where, problem, "choose the arm's own with --base")
    return roots[0]


def _only_end(urdf: Urdf, start: str, above: dict[str, UrdfJoint], where: str) -> str:
    """The only link at an end that a joint moves."""
    parents = {joint.parent for joint in urdf.joints}
    leaves = [name for name in urdf.masses if name not in parents and name != start]
    moved = [name for name in leaves if any(joint.moves for joint in _path(name, above, where))]
    if not moved:
        raise FileError(where, "has no moving joint", f"give the URDF of an arm of {FEWEST_AXES} to {MOST_AXES} axes")
    if len(moved) > 1:
        raise FileError(where, f"has {len(moved)} ends: {listed(moved)}", "choose one with --tip")
    return moved[0]


def _path(link: str, above: dict[str, UrdfJoint], where: str) -> list[UrdfJoint]:
    """The joints from the root to a link."""
    path: list[UrdfJoint] = []
    while joint := above.get(link):
        if len(path) > len(above):
            raise FileError(where, f"the links above {link} form a circle", "correct it: a URDF is a tree")
        path.append(joint)
        link = joint.parent
    return path[::-1]


def _mass(urdf: Urdf, link: str, T: Array) -> tuple[float, Array]:
    """Mass (kg) of a link at T (4, 4) and of all that is fixed to it, and its centre (3,) mm in the base frame."""
    kg, moment, todo = 0.0, np.zeros(3), [(link, T)]
    while todo:
        link, T = todo.pop()
        part = urdf.masses[link]
        kg += part.kg
        moment += part.kg * (T[:3, :3] @ part.centre_mm + T[:3, 3])
        fixed = (joint for joint in urdf.joints if joint.parent == link and not joint.moves)
        todo += [(joint.child, T @ joint.T_parent_child) for joint in fixed]
    return kg, moment / (kg or 1.0)


def _T_base_parting(chain: Chain) -> Array:  # noqa: N802 - a frame's name
    """The frame (4, 4) mm of the link where the ways to base and tip part, in the base frame."""
    T = np.eye(4)
    for joint in chain.up:
        T = T @ np.linalg.inv(joint.T_parent_child)
    return T


def listed(names: Sequence[str]) -> str:
    """Return the first few names, and how many more there are."""
    return ", ".join(names[:_LISTED]) + (f" and {len(names) - _LISTED} more" if len(names) > _LISTED else "")
