"""Poses of an arm in front of a tracker: within limits, collision-free, and visible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.robot.geometry.clearance import chain_points, in_base, is_clear, is_collision_free
from analysis.robot.kinematics.arm import Arm, Array, Mask, forward

_MARGIN_RAD = np.radians(5.0)
_HALF_TURN = np.pi
"""Limit of every joint regardless of its range, because of cables and hoses."""
_SIGHT_CLEARANCE_MM = 120.0
"""Distance between arm and line of sight."""
_AT_TOOL = 0.9
"""Share of the line of sight, from the tracker, that must be free of the arm."""
_FACING = float(np.cos(np.radians(30.0)))
"""Largest viewing angle: a corner cube in a ball is visible within 30° of its axis."""
_STEP_RAD = np.radians(5.0)
_DRAWS = 40


@dataclass(frozen=True)
class Sight:
    """View of a tracker at tracker_mm (3,) in the robot's base."""

    tracker_mm: Array
    faces: Array | None = None
    """Viewing axis (3,) of the target in the tool; None if it is visible from everywhere."""


def drawn_poses(arm: Arm, count: int, sight: Sight | None, rng: np.random.Generator) -> Array:
    """Joint angles (n, axes) rad of up to `count` random collision-free and visible poses, uniform in joint space."""
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
    low, high = arm.limits.T
    return np.maximum(low + _MARGIN_RAD, -_HALF_TURN), np.minimum(high - _MARGIN_RAD, _HALF_TURN)


def axes_in_turn(arm: Arm, count: int, sight: Sight | None, rng: np.random.Generator) -> Array:
    """At most `count` poses (n, axes) rad that move one axis at a time down, up and back through its range, the others
    in the posture with the largest ranges."""
    postures = drawn_poses(arm, _POSTURES, sight, rng)
    if not len(postures):
        return np.empty((0, arm.axes))
    # range of a joint with the others at a posture, collision-free and visible
    ways = np.empty((len(postures), arm.axes, 2))
    for row, joint in np.ndindex(len(postures), arm.axes):
        angle, ends = postures[row, joint], []
        for end in (float(limit[joint]) for limit in joint_ranges(arm)):
            angles = np.linspace(angle, end, 2 + int(abs(end - angle) / _STEP_RAD))
            q = np.repeat(postures[row][None], len(angles), axis=0)
            q[:, joint] = angles
            free = is_collision_free(arm, q) & (is_seen(arm, q, sight) if sight else True)
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
"""Candidate postures, and the fewest stops of an axis in each direction."""


def is_way_clear(arm: Arm, begin: Array, end: Array) -> bool:
    """True if a joint move between two postures (axes,) rad is collision-free; singularities are permitted."""
    count = 2 + int(np.abs(end - begin).max() / _STEP_RAD)
    return bool(is_collision_free(arm, begin + np.linspace(0, 1, count)[:, None] * (end - begin)).all())


def is_seen(arm: Arm, q: Array, sight: Sight) -> Mask:
    """Mask (n,) of postures (n, axes) rad whose target faces the tracker and is not hidden by the arm."""
    points = chain_points(arm, q)
    tool = points[:, -1]
    way = sight.tracker_mm + np.linspace(0, _AT_TOOL, 40)[:, None, None] * (tool - sight.tracker_mm)
    seen = np.ones(len(q), dtype=bool)
    for begin, end in zip(points[:, :-2].transpose(1, 0, 2), points[:, 1:-1].transpose(1, 0, 2), strict=True):
        along = end - begin
        share = np.clip(((way - begin) * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-9), 0, 1)
        # distance from the line between two joints
        away = np.linalg.norm(way - begin - share[..., None] * along, axis=2)
        seen &= (away > _SIGHT_CLEARANCE_MM).all(axis=0)
    if sight.faces is not None:
        to_tracker = sight.tracker_mm - tool
        looks = in_base(arm, forward(arm, q))[:, :3, :3] @ sight.faces
        seen &= (looks * to_tracker).sum(axis=1) > _FACING * np.linalg.norm(to_tracker, axis=1)
    return seen


def in_order_of_ways(arm: Arm, q: Array) -> Array:
    """Poses (m, axes) rad by nearest neighbours with collision-free moves; unreachable ones are dropped."""
    unordered, order = list(range(1, len(q))), [0]
    while unordered:
        far = np.abs(q[unordered] - q[order[-1]]).max(axis=1)
        reachable = (k for k in np.argsort(far) if is_way_clear(arm, q[order[-1]], q[unordered[k]]))
        nearest = next(reachable, None)
        if nearest is None:
            break
        order.append(unordered.pop(int(nearest)))
    return q[order]
