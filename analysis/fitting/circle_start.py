"""Where a driven circle starts and which way is anticlockwise: normal, zero direction and posture.

docs/geometry.md has the tool's x axis along the normal, so the tool decides its sign where it was held so; otherwise
the label of the run does. The acw circle starts where its angle is smallest, after the lead-in, and a cw program drives
the same joint angles back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.geometry.circle import CircleFrame, circle_frame
from analysis.kinematics.arm import Array
from rigs.schema.declared_tests import Circle
from rigs.schema.vocabulary import Direction

_ALONG_NORMAL = float(np.cos(np.radians(30.0)))
"""The tool's x axis is held along the normal where it is nearer to it than this."""
_CLEAR_RAD = np.radians(20.0)
"""A motion that ends nearer to where it began went both ways."""
_HARDLY = 0.01
"""A lap that lacks this share of a turn is whole."""
_SAME_START_RAD = np.radians(5.0)
"""A start this near to that of the rig file is the same: the ends of a program with a lead-in are seen to a degree."""
_HELD_RAD = np.radians(2.0)
"""A tool this near to its place in a circle test is held as the program holds it."""


@dataclass(frozen=True)
class Start:
    """The circle with its sign and zero direction; at (3,) unit vector to where the acw circle starts; posture (6,) rad
    there; arc_rad driven; keeps_zero: the rig file's zero direction stands; doubts in words."""

    circle: CircleFrame
    at: Array
    posture: Array
    arc_rad: float
    keeps_zero: bool
    doubts: tuple[str, ...]


def start_of(circle: CircleFrame, T: Array, q: Array, direction: Direction | None, known: Circle | None) -> Start:
    """The start of a circle from one stretch of tool poses T (n, 4, 4) in mm and angles q (n, 6) rad in order of time.

    direction: as the run is labelled; known: the circle of the rig file, if it has one."""
    phi = circle.angle(T[:, :3, 3])
    doubts: list[str] = []
    if _sense(circle, T, phi, direction, known, doubts) < 0:
        circle, phi = circle_frame(circle.centre, -circle.n, circle.u, circle.radius), -phi
    arc = float(np.ptp(phi))
    laps = int(arc / (2 * np.pi) + _HARDLY)
    lead = max(0.0, (arc - 2 * np.pi * laps) / 2) if laps else 0.0
    begins = float(phi.min()) + lead
    row = int(np.abs(phi - begins).argmin())
    begun = np.radians(known.start_deg) if known else 0.0
    zero = circle.radial(np.array([begins - begun]))[0]
    keeps_zero = False
    if known is not None and abs(np.dot(_unit(known.zero), circle.n)) < _ALONG_NORMAL:
        own = circle_frame(circle.centre, circle.n, _unit(known.zero), circle.radius)
        keeps_zero = bool(own.u @ zero > np.cos(_SAME_START_RAD))
        zero = own.u if keeps_zero else zero
    circle = circle_frame(circle.centre, circle.n, zero, circle.radius)
    at = circle.radial(np.array([begun]))[0]
    return Start(circle, at, q[row], arc, keeps_zero, (*doubts, *_tool_doubts(circle, T)))


def _sense(
    circle: CircleFrame, T: Array, phi: Array, direction: Direction | None, known: Circle | None, doubts: list[str]
) -> float:
    """1 where the normal has its sign, -1 where it must be turned round."""
    along = float(T[:, :3, 0].mean(axis=0) @ circle.n)
    net = float(phi[-1] - phi[0])
    went = 0.0 if abs(net) < _CLEAR_RAD else float(np.sign(net))
    labelled = -1.0 if direction == "cw" else 1.0
    if abs(along) > _ALONG_NORMAL:
        sign = float(np.sign(along))
        if direction and went and sign * went != labelled:
            other = "acw" if direction == "cw" else "cw"
            doubts.append(
                f"about the tool's x axis, which is the normal, the robot moved {other}, and the run is labelled "
                f"{direction}: correct it with rig relabel RUN --direction {other}, or turn robot.tool by 180° about z"
            )
        return sign
    if went:
        return labelled * went
    doubts.append("the robot went both ways alike, so that the sign of the normal is a guess: check it")
    return float(np.sign(circle.n @ (_unit(known.normal) if known else [0.0, 0.0, 1.0])) or 1.0)


def _tool_doubts(circle: CircleFrame, T: Array) -> list[str]:
    """What is to be said of how the tool was held, against how a circle test holds it."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 - slow to import, needed here only

    held = circle.poses(circle.angle(T[:, :3, 3]))[:, :3, :3]
    turn = Rotation.from_matrix(np.swapaxes(T[:, :3, :3], 1, 2) @ held)
    mean = turn.mean()
    off, spread = mean.magnitude(), float(np.degrees((mean.inv() * turn).magnitude().max()))
    if off < _HELD_RAD and spread < np.degrees(_HELD_RAD):
        return []
    what = (
        f"the tool was held {np.degrees(off):.0f}° from where the test holds it (z to the centre, x along the normal)"
    )
    if spread < np.degrees(_HELD_RAD):
        return [f"{what}: the program will turn it so, unless robot.tool.rpy_deg is corrected"]
    return [f"{what}, and not evenly (by up to {spread:.0f}°): the program will turn it so"]


def _unit(vector: tuple[float, float, float]) -> Array:
    unit: Array = np.array(vector) / np.linalg.norm(vector)
    return unit
