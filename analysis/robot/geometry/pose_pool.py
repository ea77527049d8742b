"""Poses that an arm can take in front of a tracker: within limits, clear of floor and column, seen.

The arm is a chain of lines between its joints' frames and the tool; its covers are not known. So distances are kept
that covers of common arms fill, and a person watches the first run.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.kinematics.arm import Arm, Array, Mask, forward, link_frames
from analysis.robot.kinematics.newton import conditioning

_FLOOR_MM = 100.0
"""Height above the base's mounting plane that every joint from the elbow on keeps."""
_COLUMN_MM = 250.0
"""Distance from axis 1 that wrist and tool keep below the shoulder's height and beside it."""
_MARGIN_RAD = np.radians(5.0)
_HALF_TURN = np.pi
"""No joint goes further from zero than half a turn, whatever its limits: cables and hoses."""
_LEAST_CONDITIONING = 0.01
_BESIDE_MM = 120.0
"""Distance that arm and line of sight keep."""
_AT_TOOL = 0.9
"""Share of the line of sight, from the tracker on, that the arm must not cross: it holds the target at its end."""
_FACING = float(np.cos(np.radians(30.0)))
"""A corner cube in a ball is seen within 30° of its axis."""
_STEP_RAD = np.radians(5.0)
_DRAWS = 40


@dataclass(frozen=True)
class Sight:
    """Where the tracker stands, tracker_mm (3,) in the robot's base, and the tool's axis (3,) along which its target
    looks; None for a target that is seen from everywhere."""

    tracker_mm: Array
    faces: Array | None = None


def drawn_poses(arm: Arm, count: int, sight: Sight | None, rng: np.random.Generator) -> Array:
    """Joint angles (n, 6) rad of at most so many poses, drawn evenly in joint space, that are clear and seen."""
    low, high = joint_ranges(arm)
    drawn = np.empty((0, len(low)))
    for _ in range(_DRAWS):
        q = rng.uniform(low, high, (4 * count, len(low)))
        q = q[is_clear(arm, q)]
        q = q[is_seen(arm, q, sight)] if sight else q
        drawn = np.concatenate([drawn, q])
        if len(drawn) >= count:
            break
    return drawn[:count]


def joint_ranges(arm: Arm) -> tuple[Array, Array]:
    """Return the lowest and highest angles (axes,) rad to which joints go; a lowest above its highest if the limits of
    an axis leave it nothing."""
    low, high = arm.limits.T
    return np.maximum(low + _MARGIN_RAD, -_HALF_TURN), np.minimum(high - _MARGIN_RAD, _HALF_TURN)


def axes_in_turn(arm: Arm, count: int, sight: Sight | None, rng: np.random.Generator) -> Array:
    """Joint angles (n, axes) rad of at most so many poses in which each axis in its turn goes down, up and back through
    its range while the others stand: from one posture, about which the ways are clear and seen furthest."""
    postures = drawn_poses(arm, _POSTURES, sight, rng)
    if not len(postures):
        return np.empty((0, arm.axes))
    # The angles between which a joint may turn, the others standing at a posture, clear and seen.
    ways = np.empty((len(postures), arm.axes, 2))
    for row, joint in np.ndindex(len(postures), arm.axes):
        angle, ends = postures[row, joint], []
        for end in (float(limit[joint]) for limit in joint_ranges(arm)):
            angles = np.linspace(angle, end, 2 + int(abs(end - angle) / _STEP_RAD))
            q = np.repeat(postures[row][None], len(angles), axis=0)
            q[:, joint] = angles
            free = _is_off(arm, q) & (is_seen(arm, q, sight) if sight else True)
            ends.append(angles[np.logical_and.accumulate(free)][-1])
        ways[row, joint] = min(ends), max(ends)
    best = int(np.argmax([np.log(np.ptp(way, axis=1) + _STEP_RAD).sum() for way in ways]))
    start, poses = postures[best], [postures[best]]
    for joint, (low, high) in enumerate(ways[best]):
        stops = np.linspace(low, high, max(_FEWEST_STOPS, ((count - 1) // arm.axes + 1) // 2))
        below, above = stops[stops < start[joint]], stops[stops >= start[joint]]
        for angle in (*below[::-1], *below[1:], *above, *above[-2::-1], start[joint]):
            poses.append(np.where(np.arange(arm.axes) == joint, angle, start))
    return np.array(poses)


_POSTURES, _FEWEST_STOPS = 30, 5
"""Postures to choose from, and the fewest stops of an axis each way."""


def is_clear(arm: Arm, q: Array) -> Mask:
    """Whether the arm at joint angles q (n, 6) rad keeps clear of the floor, its column and singularities (n,)."""
    return np.asarray(_is_off(arm, q) & (conditioning(arm, q) > _LEAST_CONDITIONING))


def is_way_clear(arm: Arm, begin: Array, end: Array) -> bool:
    """Whether a move of all joints together from one posture (6,) rad to another is clear; singularities are no matter
    on it."""
    count = 2 + int(np.abs(end - begin).max() / _STEP_RAD)
    return bool(_is_off(arm, begin + np.linspace(0, 1, count)[:, None] * (end - begin)).all())


def _is_off(arm: Arm, q: Array) -> Mask:
    """Whether the arm at joint angles q (n, axes) rad is off the floor and its column (n,)."""
    points = _points(arm, q)
    outer, last = points[:, 2:], points[:, 4:]  # from the elbow on, and from the wrist on
    off_column = (np.hypot(last[..., 0], last[..., 1]) > _COLUMN_MM) | (last[..., 2] > points[:, 1:2, 2] + _COLUMN_MM)
    return np.asarray((outer[..., 2] > _FLOOR_MM).all(axis=1) & off_column.all(axis=1))


def is_seen(arm: Arm, q: Array, sight: Sight) -> Mask:
    """Whether the tracker sees its target at joint angles q (n, 6) rad, (n,): the arm does not stand in between, and
    the target faces it."""
    points = _points(arm, q)
    tool = points[:, -1]
    way = sight.tracker_mm + np.linspace(0, _AT_TOOL, 40)[:, None, None] * (tool - sight.tracker_mm)
    seen = np.ones(len(q), dtype=bool)
    for begin, end in zip(points[:, :-2].transpose(1, 0, 2), points[:, 1:-1].transpose(1, 0, 2), strict=True):
        along = end - begin
        share = np.clip(((way - begin) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-9), 0, 1)
        away = np.linalg.norm(way - begin - share[..., None] * along, axis=2)  # from the line between two joints
        seen &= (away > _BESIDE_MM).all(axis=0)
    if sight.faces is not None:
        to_tracker = sight.tracker_mm - tool
        looks = _in_base(arm, forward(arm, q))[:, :3, :3] @ sight.faces
        seen &= (looks * to_tracker).sum(axis=1) > _FACING * np.linalg.norm(to_tracker, axis=1)
    return seen


def in_order_of_ways(arm: Arm, q: Array) -> Array:
    """The poses (m, 6) rad in an order in which each next is the nearest with a clear way; those without are left
    out."""
    unordered, order = list(range(1, len(q))), [0]
    while unordered:
        far = np.abs(q[unordered] - q[order[-1]]).max(axis=1)
        reachable = (k for k in np.argsort(far) if is_way_clear(arm, q[order[-1]], q[unordered[k]]))
        nearest = next(reachable, None)
        if nearest is None:
            break
        order.append(unordered.pop(int(nearest)))
    return q[order]


def _points(arm: Arm, q: Array) -> Array:
    """Joints and tool (n, 7, 3) mm in the robot's base."""
    frames = np.concatenate([link_frames(arm, q), forward(arm, q)[:, None]], axis=1)
    return np.asarray(_in_base(arm, frames)[..., :3, 3])


def _in_base(arm: Arm, T: Array) -> Array:
    return np.asarray(np.linalg.inv(arm.T_world_base) @ T)
