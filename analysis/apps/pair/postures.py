"""Postures of two arms with the ball of one in the socket of the other."""

from __future__ import annotations

import numpy as np

from analysis.apps.pair.arm_terms import tool_points
from analysis.robot.kinematics.arm import Arm, Array, Mask, forward_and_jacobian, link_frames
from rigs.errors import FileError

_FACING = float(np.cos(np.radians(60)))
"""Cosine of the largest angle between the tool axes: a socket of less than half a ball lets the stem tilt by 60°."""
_CLEAR_MM = 150.0
"""Distance of the centre lines of both arms, except their last links. Links are 60 to 150 mm thick, so an operator must
watch the first run.
"""
_UPRIGHT = 0.5
"""Below this cosine a base is on a ceiling or wall, so the floor is not below it."""
_ROUNDS, _STEP_RAD, _DAMPING_MM = 30, 0.3, 1.0
_SEATED_MM = 1e-3
_TRIES, _BATCH = 60, 2000
_POINTS = 6


def common_postures(
    arms: tuple[Arm, Arm], points_mm: tuple[Array, Array], count: int, rng: np.random.Generator, where: str
) -> tuple[Array, Array]:
    """Random postures (n, axes) of both arms with the ball (3,) mm of one in the socket (3,) mm of the other, within
    limits, facing and clear of each other and of the floor.
    """
    first, second = arms
    qs, ps, reached, ranges = [], [], 0, []
    for low, high in (arm.limits.T for arm in arms):  # reduced to one turn, which winds up no cables
        at_least, at_most = np.minimum(-np.pi, high - 2 * np.pi), np.maximum(np.pi, low + 2 * np.pi)
        ranges.append((np.maximum(low, at_least), np.minimum(high, at_most)))
    for _ in range(_TRIES):
        q, p = (rng.uniform(*ends, size=(_BATCH, len(ends[0]))) for ends in ranges)
        T, _ = forward_and_jacobian(first, q)
        goal = tool_points(T, points_mm[0])
        near = np.linalg.norm(goal - second.T_world_base[:3, 3], axis=1) < _reach_mm(second, points_mm[1])
        q, goal, T, p = q[near], goal[near], T[near], p[near]
        if not len(q):
            continue
        p = seated(second, p, points_mm[1], goal)
        T_second, _ = forward_and_jacobian(second, p)
        good = np.linalg.norm(tool_points(T_second, points_mm[1]) - goal, axis=1) < _SEATED_MM
        good &= ((p >= second.limits[:, 0]) & (p <= second.limits[:, 1])).all(axis=1)
        good &= (T[:, :3, 2] * T_second[:, :3, 2]).sum(axis=1) < -_FACING
        q, p = q[good], p[good]
        reached += len(q)
        clear = is_clear(arms, q, p, goal[good])
        qs.append(q[clear])
        ps.append(p[clear])
        if sum(map(len, qs)) >= count:
            break
    count_clear = sum(map(len, qs))
    if count_clear < count:
        apart = float(np.linalg.norm(first.T_world_base[:3, 3] - second.T_world_base[:3, 3]))
        postures = "postures" if reached < count else "postures clear of the other arm and the floor"
        problem = f"ball and socket meet in only {count_clear} {postures}, with the bases {apart:.0f} mm apart"
        remedy = "give the base of the second arm with --base, or move the arms closer together"
        raise FileError(where, problem, remedy, code="pair.invalid")
    return np.concatenate(qs)[:count], np.concatenate(ps)[:count]


def _reach_mm(arm: Arm, point_mm: Array) -> float:
    tool = arm.T_flange_tool[:3, 3] + arm.T_flange_tool[:3, :3] @ point_mm
    return float(np.hypot(arm.a, arm.d).sum() + np.linalg.norm(tool))


def seated(arm: Arm, q: Array, point_mm: Array, goal: Array) -> Array:
    """Angles (n, axes) near q that move a point (3,) of the tool to goals (n, 3) mm, by damped least squares."""
    q = q.copy()
    for _ in range(_ROUNDS):
        T, J = forward_and_jacobian(arm, q)
        places = tool_points(T, point_mm)
        slope = J[:, :3] + np.cross(J[:, 3:], (places - T[:, :3, 3])[:, :, None], axis=1)
        inner = slope @ slope.transpose(0, 2, 1) + _DAMPING_MM**2 * np.eye(3)
        step = np.einsum("nji,nj->ni", slope, np.linalg.solve(inner, (goal - places)[..., None])[..., 0])
        q += step * np.minimum(1.0, _STEP_RAD / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-12))
    return np.asarray((q + np.pi) % (2 * np.pi) - np.pi)


def is_clear(arms: tuple[Arm, Arm], q: Array, p: Array, ball: Array) -> Mask:
    """True (n,) if both arms are clear of each other and of the floor. ball (n, 3): in the world."""
    lines = [_middle_lines(arm, angles) for arm, angles in zip(arms, (q, p), strict=True)]
    stand = all(arm.T_world_base[2, 2] > _UPRIGHT for arm in arms)
    floor = min(arm.T_world_base[2, 3] for arm in arms) if stand else -np.inf
    clear = ball[:, 2] > floor
    for line in lines:
        clear &= (line[:, :, 2] > floor - 1.0).all(axis=1)
    ends = [_POINTS * 2] * 2  # the last two links carry ball and socket
    for line, other_line in ((lines[0], lines[1][:, : -ends[1]]), (lines[0][:, : -ends[0]], lines[1])):
        apart = np.linalg.norm(line[:, :, None] - other_line[:, None], axis=3)
        clear &= apart.min(axis=(1, 2), initial=np.inf) > _CLEAR_MM
    return np.asarray(clear)


def _middle_lines(arm: Arm, q: Array) -> Array:
    base = np.broadcast_to(arm.T_world_base[:3, 3], (len(q), 1, 3))
    joints = np.concatenate([base, link_frames(arm, q)[:, :, :3, 3]], axis=1)
    along = np.linspace(0.0, 1.0, _POINTS)[:, None]
    lines = joints[:, :-1, None] * (1 - along) + joints[:, 1:, None] * along
    return np.asarray(lines.reshape(len(q), -1, 3))
