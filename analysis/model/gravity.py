"""Gravity torques: what the links and the payload weigh on each joint."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from analysis.kinematics.arm import Arm, Array, link_frames
from rigs.schema.robot import Robot

_G = np.array([0.0, 0.0, -9.80665])


@dataclass(frozen=True)
class Load:
    """mass (6,) kg of each link, centre (6, 3) mm in its frame, payload_kg at the flange."""

    mass: Array
    centre: Array
    payload_kg: float


def load_of(robot: Robot) -> Load:
    """What a rig file says that the links weigh."""
    mass = np.array([axis.mass_kg for axis in robot.axes])
    return Load(mass, np.array([axis.centre_mm for axis in robot.axes], dtype=float), robot.payload_kg)


_recent: deque[tuple[Arm, Load, Array, Array]] = deque(maxlen=32)
"""Torques of the last traces: a fit asks for those of the same few over and over. Nothing is changed in place."""


def torques(arm: Arm, load: Load, q: Array) -> Array:
    """Torque of gravity on each joint of the controller, (n, 6) Nm, for angles q (n, 6) rad."""
    for known_arm, known_load, known_q, torque in _recent:
        if known_q is q and known_arm is arm and _same(known_load, load):
            return torque
    torque = _torques(arm, load, q)
    _recent.append((arm, load, q, torque))
    return torque


def _same(one: Load, other: Load) -> bool:
    return one.mass is other.mass and one.centre is other.centre and one.payload_kg == other.payload_kg


def _torques(arm: Arm, load: Load, q: Array) -> Array:
    frames = link_frames(arm, q)
    origins, axes = frames[:, :, :3, 3], frames[:, :, :3, 2]
    centres = np.einsum("nkij,kj->nki", frames[:, :, :3, :3], load.centre) + origins
    weights = np.broadcast_to(load.mass, (len(q), 6)).copy()
    weights[:, 5] += load.payload_kg
    # The payload hangs at the flange: it shifts the last link's centre of mass.
    if weights[0, 5] > 0:
        share = load.payload_kg / weights[0, 5]
        centres[:, 5] += share * (origins[:, 5] - centres[:, 5])
    force = weights[:, :, None] * _G
    # First moment of all weights from link k outwards, about the origin of joint k, in N mm.
    moment = np.cumsum(np.cross(centres, force)[:, ::-1], axis=1)[:, ::-1]
    total = np.cumsum(force[:, ::-1], axis=1)[:, ::-1]
    per_theta = np.einsum("nki,nki->nk", axes, moment - np.cross(origins, total))
    torque: Array = per_theta @ arm.coupling / 1000.0
    return torque
