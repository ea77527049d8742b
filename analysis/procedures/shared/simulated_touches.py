"""Simulated touches: postures with the ball in a socket, and the joint readings.

A rig file contains no socket positions, because users choose them. For plans and simulations they are placed within
reach, around the base, where the arm has many postures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.robot.geometry.pose_setup import moved_by
from analysis.robot.kinematics.arm import Arm, Array, arm_of, forward, forward_and_jacobian
from analysis.robot.model.predict import model_of, moved, visits
from analysis.runs.noise.cell_noise import SEAT_MM
from analysis.runs.tables import TouchTable
from rigs.effects import Effect
from rigs.errors import FileError
from rigs.readiness import require_part
from rigs.rig import Rig
from rigs.schema.declared_tests import Touch

STOPS_MM = 0.02
"""Scatter of a coordinate for a guided arm at rest: half of that of programmed stops."""
_APPROACH_RAD = (0.1, 0.4)
"""Joint motion before a touch, in one direction: the user swings elbow or wrist to the next posture."""
_POSTURES, _TRIES, _STEPS, _LARGEST_RAD = 300, 20, 25, 0.3
"""Number of postures tried together, number of attempts, number of steps to the socket, and largest joint step."""
_THERE_MM = 1e-6
_OFF_LIMIT = 0.05
"""Margin to the joint limits, relative to the range."""
_REACHED = (0.35, 0.7)
"""Socket distances relative to the reach: close to the base and at the end of the reach there are few postures."""


def touch_of(rig: Rig) -> Touch:
    """Touch test of a rig. Raises FileError if the rig file has none."""
    return require_part(rig, rig.tests.touch, "touch")


def planned_touches(rig: Rig, seed: int = 0) -> TouchTable:
    """Touches of the nominal arm, distributed over the sockets of the rig file. Raises FileError without a touch
    test, or without postures."""
    return _standing(rig, _planned(rig, np.random.default_rng(seed))[0])


def simulated_touches(rig: Rig, seed: int | None, effects: Sequence[Effect] | None = None) -> TouchTable:
    """Touches of an arm with effects, `seed` None for no scatter.

    effects: in place of those of the rig file. Raises FileError like `planned_touches`.
    """
    rng = np.random.default_rng(seed or 0)
    table, sockets = _planned(rig, rng)
    model = model_of(rig, effects)
    scatter = 0.0 if seed is None else float(np.hypot(SEAT_MM, STOPS_MM))
    places = sockets + rng.normal(0.0, 1.0, sockets.shape) * scatter
    arm = with_ball(model.arm, touch_of(rig))
    for _ in range(_STEPS):
        path = visits(table.q, table.came_from)
        away = places - np.asarray(moved(replace(model, arm=arm), path).T[:, :3, 3])
        if np.abs(away).max() < _THERE_MM:
            break
        _, jacobian = forward_and_jacobian(arm, table.q)
        table = replace(table, q=table.q + np.einsum("nij,nj->ni", np.linalg.pinv(jacobian[:, :3]), away))
    return _standing(rig, table)


def _standing(rig: Rig, table: TouchTable) -> TouchTable:
    """Touches with the rail at position 0; touches of an arm that has no rail are unchanged."""
    if rig.robot.rail is None:
        return table
    assert table.came_from is not None  # noqa: S101 - planned touches say it
    stands = np.zeros(len(table.q))
    q, came_from = (np.column_stack([angles, stands]) for angles in (table.q, table.came_from))
    return replace(table, q=q, came_from=came_from, rail=True)


def _planned(rig: Rig, rng: np.random.Generator) -> tuple[TouchTable, Array]:
    """Touches of the nominal arm, and the socket position (n, 3) mm of each."""
    touch, q, places, names = touch_of(rig), [], [], []
    arm = with_ball(arm_of(rig.robot), touch)
    count = -(-touch.touches // len(touch.sockets))
    where: dict[str, Array] = {}
    for socket in touch.sockets:
        # Sockets with a position (3,) mm and a known distance in mm from this one.
        pairs = {frozenset(stated.between): stated.distance_mm for stated in touch.distances}
        distances = [
            (place, pairs[pair]) for placed, place in where.items() if (pair := frozenset((socket, placed))) in pairs
        ]
        place, postures = _somewhere(arm, count, rng, rig.name, distances)
        where[socket] = place
        q.append(postures)
        places += [place] * count
        names += [socket] * count
    order = np.concatenate(q)
    swing = rng.choice([-1.0, 1.0], order.shape) * rng.uniform(*_APPROACH_RAD, order.shape)
    return TouchTable(np.array(names), order, order + swing), np.array(places)


def _somewhere(
    arm: Arm, count: int, rng: np.random.Generator, where: str, distances: Sequence[tuple[Array, float]]
) -> tuple[Array, Array]:
    """A random socket position (3,) mm at given distances from other sockets, and postures (count, axes) rad."""
    low, high = arm.limits.T
    free = forward(arm, rng.uniform(low, high, (_POSTURES, arm.axes)))[:, :3, 3]
    base = arm.T_world_base[:3, 3]
    at = free
    if distances:  # moved to satisfy the known distances, as far as possible
        others, apart_mm = np.array([place for place, _ in distances]), np.array([mm for _, mm in distances])
        for _ in range(_STEPS):
            away = at[:, None] - others
            apart = np.linalg.norm(away, axis=2)
            at = at + np.einsum("nij,nj->ni", np.linalg.pinv(away / apart[..., None]), apart_mm - apart)
        misses = np.abs(np.linalg.norm(at[:, None] - others, axis=2) - apart_mm)
        at = at[misses.max(axis=1) < _THERE_MM]
    share = np.linalg.norm(at - base, axis=1) / np.linalg.norm(free - base, axis=1).max()
    for place in at[(share > _REACHED[0]) & (share < _REACHED[1]) & (at[:, 2] > base[2])]:
        postures = postures_at(arm, place, count, rng)
        if len(postures) == count:
            return place, postures
    remedy = "check tests.touch.distances, and limits_deg" if distances else "check limits_deg"
    raise FileError(
        f"rig {where}", "the arm has no place for a socket with enough postures", remedy, code="touch.no_postures"
    )


def postures_at(arm: Arm, place: Array, count: int, rng: np.random.Generator) -> Array:
    """Return random postures (at most count, axes) rad with the tool at a position (3,) mm in any orientation."""
    low, high = arm.limits.T
    free = _OFF_LIMIT * (high - low)
    postures = np.empty((0, arm.axes))
    for _ in range(_TRIES):
        q = rng.uniform(low, high, (_POSTURES, arm.axes))
        for _ in range(_STEPS):
            T, jacobian = forward_and_jacobian(arm, q)
            step = np.einsum("nij,nj->ni", np.linalg.pinv(jacobian[:, :3]), place - T[:, :3, 3])
            q = q + np.clip(step, -_LARGEST_RAD, _LARGEST_RAD)
        at_place = np.linalg.norm(forward(arm, q)[:, :3, 3] - place, axis=1) < _THERE_MM
        kept = q[at_place & (q > low + free).all(axis=1) & (q < high - free).all(axis=1)]
        postures = np.concatenate([postures, kept])
        if len(postures) >= count:
            break
    return postures[:count]


def with_ball(arm: Arm, touch: Touch) -> Arm:
    """Return an arm with the ball as the tool."""
    ball = moved_by(np.eye(4), np.array(touch.ball_mm), np.zeros(3))
    return replace(arm, T_flange_tool=arm.T_flange_tool @ ball)
